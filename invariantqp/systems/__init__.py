"""Screw systems: spans of twists, their Gram matrices, and the hyperbolic pseudoinverse. numpy alone."""
