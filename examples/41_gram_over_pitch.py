"""The Gram determinant det(J'Q_h J) over h: its roots are the principal pitches, where there is no J^{+h}.

Near a root |J^{+h}|, here about the base's origin, grows without bound; the damped pseudoinverse is bounded through
every root, where it leaves the root's screw undone. Three screws that combine to no translation have three roots, four
have two, five have one: Donelan and Selig, Sect. 5.

Run: python examples/41_gram_over_pitch.py [FILE]      draws FILE (gram_over_pitch.png); needs the extra `pictures`
"""

import sys

import numpy as np
from matplotlib.figure import Figure

import invariantqp as iq
from invariantqp.systems import ScrewSystem

HINGES = [
    iq.revolute((0, 0, 1)),
    iq.revolute((0, 1, 0), point=(0.0, 0.0, 0.3)),
    iq.revolute((1, 0, 0.4), point=(0.0, 0.3, 0.5)),
    iq.revolute((1, 1, 0), point=(0.2, 0.0, 0.6)),
    iq.revolute((0, 0.3, 1), point=(0.4, 0.1, 0.0)),
]
DAMPING = 0.02  # [m]
pitches = np.linspace(-0.5, 0.5, 1001)  # [m/rad]

figure = Figure(figsize=(9.0, 5.2), layout="constrained")
top, bottom = figure.subplots(2, 1, sharex=True)
for i, joints in enumerate((3, 4, 5)):
    system = ScrewSystem(np.column_stack(HINGES[:joints]))
    roots = system.principal_pitches
    print(f"{joints} hinges, type {system.type}: principal pitches {np.round(roots, 4) + 0.0} m/rad")
    det = np.array([np.linalg.det(system.gram(h)) for h in pitches])
    size = [np.linalg.norm(system.pseudoinverse(h), 2) if system.has_pseudoinverse(h) else np.inf for h in pitches]
    damped = [np.linalg.norm(system.damped_pseudoinverse(h, DAMPING), 2) for h in pitches]
    top.plot(pitches, det / np.abs(det).max(), color=f"C{i}", label=f"{joints} hinges")
    top.plot(roots, np.zeros(len(roots)), "o", color=f"C{i}")
    bottom.semilogy(pitches, size, color=f"C{i}")
    bottom.semilogy(pitches, damped, color=f"C{i}", linestyle="--")
top.axhline(0.0, color="grey", linewidth=0.8)
top.set_yscale("function", functions=(np.cbrt, lambda y: y**3))
top.set(ylabel="det($J^TQ_hJ$) / largest", title="dots: principal pitches; scale of cube roots")
top.legend()
bottom.set(
    xlabel="h [m/rad]", ylabel="|J$^{+h}$|", ylim=(1.0, 3e3), title=f"solid: $J^{{+h}}$   dashed: damped, {DAMPING} m"
)
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "gram_over_pitch.png", dpi=120)
