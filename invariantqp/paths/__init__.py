"""Followers: joint velocities that follow inputs over time inside all limits.

In: a loop (`Controller` or `HybridController`), points with stamps (chunks of policies), functions of time, samples of
a stream (a hand), twists, or a path whose shape is kept; joint positions in every tick. Out: `FollowerSolution`. A
follower knows nothing of task files, runs or pictures.
"""

from typing import TYPE_CHECKING

from invariantqp.lazy import loaded_on_use

if TYPE_CHECKING or not loaded_on_use(__name__):
    from invariantqp.paths.follower import Follower as Follower
    from invariantqp.paths.path_follower import PathFollower as PathFollower
    from invariantqp.paths.solution import FollowerSolution as FollowerSolution
