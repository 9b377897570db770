"""Nyquist curves of the force loop as told, and on contacts that are softer or less damped than that.

What a press sees is a spring k and a damper b, and everything that is late, T. A curve stays as far from -1 as its
margins say: the circle is the largest sensitivity over all of them.

Run: python examples/45_force_margins.py [FILE]      draws FILE (force_margins.png); needs the extra `pictures`
"""

import sys

import numpy as np
from matplotlib.figure import Figure

from invariantqp.force import margins

LATE = 0.02  # [s] all of it: tick, low-pass, dead time, joints
STIFF = 2e4  # [N/m], told
RATIOS = (0.0, 0.01, 0.1)  # [s] damping over stiffness, told
COLOURS = ("#0072B2", "#E69F00", "#009E73")
w = np.geomspace(0.05, 300.0, 4000) / LATE  # [rad/s]

figure = Figure(figsize=(6.4, 5.6), layout="constrained")
axes = figure.subplots()
worst = 0.0
print("told: b/k    true: k, b of told    gain margin   phase margin   Ms")
for ratio, colour in zip(RATIOS, COLOURS, strict=True):
    for k, b in ((1.0, 1.0), (0.25, 1.0), (0.25, 0.0), (1.0, 0.0)):
        if ratio == 0.0 and b == 0.0:
            continue
        told = {"k_bound": STIFF, "b_bound": ratio * STIFF}
        found = margins(k * STIFF, b * ratio * STIFF, LATE, **told)
        worst = max(worst, found.sensitivity)
        print(
            f"{1e3 * ratio:6.0f} ms    {k:8.2f} {b:8.2f}    {found.gain:12.2f}"
            f" {found.phase:12.1f} deg {found.sensitivity:8.2f}"
        )
        s = 1j * w
        law = found.g * (1.0 + 1.0 / (found.Ti * s)) / (1.0 + found.tau * s)
        L = law * (k * STIFF + b * ratio * STIFF * s) / s * np.exp(-LATE * s)
        solid = k == b == 1.0
        label = f"b/k = {1e3 * ratio:.0f} ms" if solid else None
        axes.plot(
            L.real, L.imag, color=colour, linewidth=1.6 if solid else 0.8, alpha=1.0 if solid else 0.6, label=label
        )
turn = np.linspace(0.0, 2.0 * np.pi, 200)
axes.plot(-1.0 + np.cos(turn) / worst, np.sin(turn) / worst, color="#777777", linestyle="--", label=f"Ms = {worst:.2f}")
axes.plot(-1.0, 0.0, "+", color="black", markersize=10)
axes.set(xlim=(-2.2, 0.8), ylim=(-2.2, 0.8), xlabel="Re L", ylabel="Im L", aspect="equal")
axes.set_title("thick: as told; thin: a quarter of the stiffness, or no damping")
axes.legend(loc="lower right")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "force_margins.png", dpi=120)
