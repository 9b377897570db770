"""The velocity law: a twist and its joint limits in, a joint velocity and the reason for it out."""
