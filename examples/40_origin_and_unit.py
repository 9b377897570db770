"""Moore-Penrose changes with the origin and the unit of length, J^{+h} does not: one twist, three joints of an SO-101.

Three joints cannot do every twist. What they do of it is a matter of measure: the Moore-Penrose pseudoinverse takes the
numbers of J as they come, so it depends on where someone put the origin and on the unit; J^{+h} of Donelan and Selig
measures by the pitch form Q_h, which no rigid motion changes, and h is a length like any other.

Run: python examples/40_origin_and_unit.py [FILE]      draws FILE (origin_and_unit.png); needs the extra `pictures`
"""

import sys

import numpy as np
from matplotlib.figure import Figure

import invariantqp as iq

robot = iq.load_robot("so101")
J = robot.jacobian(np.array([0.3, -0.6, 0.8, 0.5, 0.4]))[:, :3]  # the last two joints are held
twist = np.array([0.1, 0.2, 0.3, 0.10, 0.05, -0.08])  # (omega; v) [rad/s, m/s]
h = 0.4  # [m/rad]


def moved(distance):
    """Joint velocities of both with the origin moved along x [m]."""
    Ad = iq.adjoint(iq.transform(translation=(distance, 0.0, 0.0)))
    return np.linalg.pinv(Ad @ J) @ Ad @ twist, iq.pseudoinverse(Ad @ J, h) @ Ad @ twist


def in_unit(length):
    """Joint velocities of both with lengths in units of `length` [m]."""
    D = np.diag(np.repeat([1.0, 1.0 / length], 3))
    return np.linalg.pinv(D @ J) @ D @ twist, iq.pseudoinverse(D @ J, h / length) @ D @ twist


sweeps = {
    "origin moved along x [m]": (np.linspace(-1.0, 1.0, 81), moved, "linear"),
    "unit of length [m]": (np.geomspace(1e-3, 1e3, 81), in_unit, "log"),
}
figure = Figure(figsize=(9.0, 3.8), layout="constrained")
for ax, (label, (values, law, scale)) in zip(figure.subplots(1, 2, sharey=True), sweeps.items(), strict=True):
    moore_penrose, ours = np.array([law(float(x)) for x in values]).transpose(1, 2, 0)
    print(f"{label:25s} changes: Moore-Penrose {np.ptp(moore_penrose, axis=1).max():.3f} rad/s, ", end="")
    print(f"J^+h {np.ptp(ours, axis=1).max():.0e} rad/s")
    for i, (name, one, other) in enumerate(zip(robot.names[:3], moore_penrose, ours, strict=True)):
        ax.plot(values, one, color=f"C{i}", label=name)
        ax.plot(values, other, color=f"C{i}", linestyle="--")
    ax.set(xlabel=label, xscale=scale, title="solid: Moore-Penrose   dashed: $J^{+h}$, h = 0.4 m/rad")
figure.axes[0].set_ylabel("joint velocity [rad/s]")
figure.axes[1].legend(loc="upper right", fontsize="small")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "origin_and_unit.png", dpi=120)
