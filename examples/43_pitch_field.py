"""The pitch field of a 3-system: the pitch of the screw in every direction, as in Figure 1 of Donelan and Selig.

A direction is a point (x : y : 1) of the projective plane, in the frame of the normal form. The screws of one pitch h
are a conic; at the principal pitches it is two lines, or a point. In space the axes of pitch h lie on a quadric.

Run: python examples/43_pitch_field.py [FILE]      draws FILE (pitch_field.png); needs the extra `pictures`
"""

import sys

import numpy as np
from matplotlib.figure import Figure

import invariantqp as iq
from invariantqp import systems

wrist = np.column_stack(  # three hinges that miss each other: an offset wrist
    (
        iq.revolute((0, 0, 1)),
        iq.revolute((0, 1, 0), point=(0.06, 0.0, 0.1)),
        iq.revolute((1, 0, 0.3), point=(0.0, 0.08, 0.15)),
    )
)
field = systems.pitch_field(wrist)
low, middle, high = field.type.moduli
print(f"type {field.type}: principal pitches {low:.4f}, {middle:.4f}, {high:.4f} m/rad")

x, y = np.meshgrid(np.linspace(-3.0, 3.0, 241), np.linspace(-3.0, 3.0, 241))
h = field.pitches(np.stack((x.ravel(), y.ravel(), np.ones(x.size)))).reshape(x.shape)
levels = np.linspace(low, high, 13)
figure = Figure(figsize=(6.4, 5.2), layout="constrained")
ax = figure.subplots()
filled = ax.contourf(x, y, h, levels, cmap="viridis")
ax.contour(x, y, h, levels, colors="white", linewidths=0.6)
ax.contour(x, y, h, [middle], colors="black", linewidths=2.0)
ax.contour(x, y, h, [0.0], colors="tab:red", linewidths=2.0)
hinges = iq.inverse(field.pose)[:3, :3] @ wrist[:3]
shown = np.abs(hinges[:2]).max(axis=0) < 3.0 * np.abs(hinges[2])
ax.plot(*(hinges[:2] / hinges[2])[:, shown], "o", color="tab:red")
ax.set(aspect="equal", xlabel="x / z", ylabel="y / z")
ax.set_title(
    "screws of one pitch are conics\nblack: the middle principal pitch   red: pitch 0, with two of the hinges",
    fontsize=10,
)
figure.colorbar(filled, label="pitch [m/rad]")
direction = [[0.2], [0.5], [1.0]]
point = np.append(field.axes(direction)[1], 1.0)
value = point @ field.quadric(field.pitches(direction)[0]) @ point
print(f"a point of an axis lies on the quadric of its pitch: {abs(value):.0e}")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "pitch_field.png", dpi=120)
