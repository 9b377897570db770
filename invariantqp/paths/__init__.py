"""Following what comes in over time: paths, action chunks of policies, hands, twists."""

from typing import TYPE_CHECKING

from invariantqp.lazy import loaded_on_use

if TYPE_CHECKING or not loaded_on_use(__name__):
    from invariantqp.paths.follower import Follower as Follower
    from invariantqp.paths.path_follower import PathFollower as PathFollower
    from invariantqp.paths.solution import FollowerSolution as FollowerSolution
