"""An arm in MuJoCo with a round peg at its tool, over a plate with a round hole: penalty contact, damping and friction.

MuJoCo's own shapes make no round hole. Here the rim of the peg's tip is tried against the plate and the wall of the
hole, and the mouth of the hole against the peg's side and its face, each at points on a circle; every half millisecond
their forces act on the arm in MuJoCo.
"""

import numpy as np
from shared.cells import DT, Cell

import invariantqp as iq

POINTS, STIFFNESS, DAMPING, FRICTION, CREEP = 32, 2e4, 0.002, 0.3, 2e-3  # each: [N/m], [s], and slower sticks [m/s]
STEP = 5e-4  # [s]
CIRCLE = np.array([[np.cos(a), np.sin(a), 0.0] for a in np.arange(POINTS) * 2.0 * np.pi / POINTS])


class PegCell(Cell):
    """A peg of a radius along the tool's z, its tip at the tool's origin; a hole whose mouth is at a pose, z up."""

    def __init__(self, arm, hole, peg, clearance, **options):
        super().__init__(arm, tick=STEP, **options)
        self.hole, self.peg, self.wide, self.before = hole, peg, peg + 0.5 * clearance, None
        self.mouth = (self.wide * CIRCLE) @ hole[:3, :3].T + hole[:3, 3]
        self.felt, self.body = np.zeros(3), self.plant.model.body("sensor").id

    def drive(self, velocity):
        for _ in range(round(DT / STEP)):
            self.touch()
            super().drive(velocity)

    def pressed(self):
        return self.felt

    def touch(self):
        """The forces of a moment, on the body of the tool in MuJoCo."""
        tool, hole = self.plant.state().pose, self.hole
        rim, mouth = (self.peg * CIRCLE) @ tool[:3, :3].T + tool[:3, 3], self.mouth
        in_hole = (rim - hole[:3, 3]) @ hole[:3, :3]
        across = np.hypot(in_hole[:, 0], in_hole[:, 1])
        on_peg = (mouth - tool[:3, 3]) @ tool[:3, :3] * [1.0, 1.0, -1.0]  # heights above the tip
        beside = np.hypot(on_peg[:, 0], on_peg[:, 1])
        along = np.concatenate((-in_hole[:, 2], on_peg[:, 2]))  # out of the plate, up; out of the peg, below its face
        aside = np.concatenate((across - self.wide, self.peg - beside))  # into the hole; out of the peg's side
        back, before = iq.inverse(tool), tool if self.before is None else self.before
        self.before = tool
        touching = np.flatnonzero((along > 0.0) & (aside > 0.0))
        if not len(touching):
            self.felt = self.plant.data.xfrc_applied[self.body, :3] = np.zeros(3)
            self.plant.data.xfrc_applied[self.body, 3:] = 0.0
            return
        walls = -(in_hole * [1.0, 1.0, 0.0] / across[:, None]) @ hole[:3, :3].T
        sides = -(on_peg * [1.0, 1.0, 0.0] / np.maximum(beside, 1e-9)[:, None]) @ tool[:3, :3].T
        ways = np.where(touching[:, None] < POINTS, hole[:3, 2], -tool[:3, 2])
        normals = np.where((along < aside)[touching, None], ways, np.concatenate((walls, sides))[touching])
        points, depth = np.concatenate((rim, mouth))[touching], np.minimum(along, aside)[touching]
        speed = (points - ((points @ back[:3, :3].T + back[:3, 3]) @ before[:3, :3].T + before[:3, 3])) / STEP
        into = -(speed * normals).sum(axis=1)
        push = np.maximum(STIFFNESS * (depth + DAMPING * into), 0.0)
        slip = speed + into[:, None] * normals
        drag = slip / np.maximum(np.linalg.norm(slip, axis=1), CREEP)[:, None]
        forces = push[:, None] * (normals - FRICTION * drag)
        self.felt = forces.sum(axis=0)
        each = (points - self.plant.data.xipos[self.body]).T @ forces  # the sum of r f', whose skew part is r x f
        moment = each[1, 2] - each[2, 1], each[2, 0] - each[0, 2], each[0, 1] - each[1, 0]
        self.plant.data.xfrc_applied[self.body] = [*self.felt, *moment]
