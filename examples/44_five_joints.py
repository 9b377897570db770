"""Five joints and a twist that they cannot do: which laws depend on the tool frame and on the unit of length.

200 random arms of five revolute and helical joints are each asked for a random twist. The tool frame is displaced, then
the unit of length is changed, and the joint velocity is compared with the first one. Lengths (L, h and the damping of
Q_h) are stated in metres and converted to the unit. The damping of DLS is one number, since J has entries with and
without a unit. Least squares measures at the origin of the tool frame. With a physical point named instead, as in
`02_five_joint_arm.py`, it does not depend on the frame.

Run: python examples/44_five_joints.py [FILE]      draws FILE (five_joints.png); needs the extra `pictures`
"""

import sys

import numpy as np
from matplotlib.figure import Figure

import invariantqp as iq

ARMS = 200
H, LENGTH, DAMPING, DLS = 0.3, 0.4, 0.05, 0.05  # h and L [m/rad], damping of Q_h [m], damping of DLS


def root(unit):
    """The square root of L^2 |omega|^2 + |v|^2, with lengths in units of `unit` [m]."""
    return np.diag(np.repeat([LENGTH / unit, 1.0], 3))


def least_squares(J, s, unit):
    """What a QP minimises, without limits."""
    return np.linalg.lstsq(root(unit) @ J, root(unit) @ s, rcond=None)[0]


def of_the_engine(J, s, unit):
    """`solve_velocity` with a pitch, measured as in `least_squares`."""
    return iq.solve_velocity(J, s, form=H / unit, point=np.zeros(3), length=LENGTH / unit).velocity


laws = {  # the joint velocity for (J, s, unit), and how it is drawn
    "Moore-Penrose": (lambda J, s, _: np.linalg.pinv(J) @ s, "C3-"),
    "DLS": (lambda J, s, _: J.T @ np.linalg.solve(J @ J.T + DLS**2 * np.eye(6), s), "C1--"),
    "QP with L": (least_squares, "C4-."),
    "$J^{+h}$": (lambda J, s, unit: iq.pseudoinverse(J, H / unit) @ s, "C0-"),
    "$Q_h$, damped": (lambda J, s, unit: iq.systems.damped_pseudoinverse(J, H / unit, DAMPING / unit) @ s, "C2--"),
    "solve_velocity, form=h": (of_the_engine, "ko"),
}


def random_arms():
    """For each arm: five joints within half a metre of the tool, a twist, and the direction of the displacement."""
    rng = np.random.default_rng(44)
    for _ in range(ARMS):
        pitches = (0.0, 0.0, 0.0, *rng.uniform(-0.1, 0.1, 2))
        joints = [iq.se3.helical(rng.normal(size=3), rng.uniform(-0.5, 0.5, 3), h) for h in pitches]
        direction = rng.normal(size=3)
        yield np.column_stack(joints), 0.3 * rng.normal(size=6), direction / np.linalg.norm(direction)


def displaced(J, s, direction, distance):
    """The same in a tool frame that is `distance` [m] away."""
    Ad = iq.adjoint(iq.transform(translation=distance * direction))
    return Ad @ J, Ad @ s, 1.0


def in_unit(J, s, _, factor):
    """The same with a unit of length that is `factor` times smaller."""
    D = np.diag(np.repeat([1.0, factor], 3))
    return D @ J, D @ s, 1.0 / factor


arms = list(random_arms())
first = {name: [law(J, s, 1.0) for J, s, _ in arms] for name, (law, _) in laws.items()}
sweeps = {
    "tool frame displaced by [m]": (np.geomspace(0.01, 3.0, 12), displaced),
    "unit of length made smaller, by the factor": (np.geomspace(1.0, 1000.0, 13)[1:], in_unit),
}
last, worst = {}, {}
figure = Figure(figsize=(9.6, 4.4), layout="constrained")
for ax, (label, (values, change)) in zip(figure.subplots(1, 2, sharey=True), sweeps.items(), strict=True):
    for name, (law, style) in laws.items():
        changes = np.empty((len(values), ARMS))
        for i, value in enumerate(values):
            for j, (arm, x) in enumerate(zip(arms, first[name], strict=True)):
                changes[i, j] = np.linalg.norm(law(*change(*arm, value)) - x) / np.linalg.norm(x)
        median, most = np.median(changes, axis=1), changes.max(axis=1)
        last[label, name], worst[label, name] = median[-1], most.max()
        ax.loglog(values, median, style, label=name, markerfacecolor="none")
        ax.fill_between(values, median, most, color=style[:-1].rstrip("-"), alpha=0.12, linewidth=0)
    ax.set(xlabel=label, ylim=(1e-17, 1e3))
    ax.grid(alpha=0.3)
figure.axes[0].set_ylabel("relative change of the joint velocity")
figure.axes[0].legend(loc="center", fontsize="small", ncols=2, bbox_to_anchor=(0.5, 0.52))
figure.axes[1].text(25.0, 10.0**-7, "lines: median of 200 arms\nbands: up to the worst arm", ha="center", va="center")

moved, scaled = sweeps
old, with_pitch = list(laws)[:3], list(laws)[3:]
for label, title in (moved, "Tool frame displaced by 3 m"), (scaled, "Unit changed from m to mm"):
    figures = ", ".join(f"{name} {last[label, name]:.1g}" for name in old)
    print(f"{title}: the joint velocity changes (median, relative) by {figures}.")
most = max(worst[label, name] for label in sweeps for name in with_pitch)
print(f"With the pitch h = {H} m/rad it changes by rounding only: {most:.0e} at most, over {ARMS} arms and three laws.")
pairs = zip(first["$J^{+h}$"], first["solve_velocity, form=h"], strict=True)
apart = max(np.linalg.norm(x - y) / np.linalg.norm(x) for x, y in pairs)
print(f"iq.solve_velocity with form=h and no damping is J^+h s to {apart:.0e}.")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "five_joints.png", dpi=120)
