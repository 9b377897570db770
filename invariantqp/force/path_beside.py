"""Where a tool in contact is beside its path: seen along S alone, how deep it is pressed counts for nothing."""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np

from invariantqp.control.asked import way_to
from invariantqp.control.beside import nearest
from invariantqp.control.given_path import GivenPath
from invariantqp.control.path_drive import STRAYED
from invariantqp.control.path_plan import PathPlan
from invariantqp.force.hybrid import HybridController
from invariantqp.geometry.arrays import Array
from invariantqp.systems.contacts import Contact

# A singular value below this share of the largest moves no tool: joints are free to move along it.
STILL = 1e-3


class BesideAlong(NamedTuple):
    """The tool and its path at the beginning of a tick.

    Attributes:
        place: nearest the tool along S.
        off: how far it is from there, along S.
        strayed: how far a joint is off the plan by motion that leaves the tool where it is [rad, length], 0 where that
            is less than STRAYED.
        astray: (m,) the way back of the joints to the plan, there.
    """

    place: float
    off: float
    strayed: float
    astray: Array


def look_along(
    hybrid: HybridController,
    path: GivenPath,
    plan: PathPlan | None,
    q: Array,
    tool: Array,
    contact: Contact,
    expected: float,
) -> BesideAlong:
    """Where the tool is; without a plan, beside the place where it is expected.

    Args:
        hybrid: with the arm and the task.
        path: the path.
        plan: the joint motion along it.
        q: (m,) joint positions.
        tool: (4, 4) its pose.
        contact: of this tick.
        expected: the place where the tool is expected.
    """
    loop, curve = hybrid.loop, path.curve
    way = way_to(loop, q, loop.robot.target(curve.pose(expected)))
    P = hybrid.splits.at(contact, tool).projectors.motion
    A, B = contact.adjoint, contact.coadjoint
    R = way.rows.dot(A).dot(P).dot(B.T)
    error = R.dot(way.error)
    if plan is None:
        return BesideAlong(expected, float(np.linalg.norm(error)), 0.0, np.zeros(len(q)))
    place, rest = nearest(path, plan, expected, R.dot(curve.tangent(expected)), error)
    astray, off = plan.joints(place) - q, sqrt(float(rest.dot(rest)))
    if float(astray.dot(astray)) <= STRAYED * STRAYED:  # nor is any part of it more
        return BesideAlong(place, off, 0.0, astray)
    _, sigma, Vt = np.linalg.svd(way.root.dot(way.sighting.J), full_matrices=False)
    moving = Vt[sigma > STILL * sigma[0]]
    free = astray - moving.T.dot(moving.dot(astray))
    return BesideAlong(place, off, float(np.abs(free).max()), astray)
