"""Following what comes in over time: paths, action chunks of policies, hands, twists."""
