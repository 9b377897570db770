"""Following what comes in over time: paths, action chunks of policies, hands, twists."""

from invariantqp.lazy import lazily

with lazily(__name__):
    from invariantqp.paths.driver import Follower as Follower
    from invariantqp.paths.solution import FollowerSolution as FollowerSolution
