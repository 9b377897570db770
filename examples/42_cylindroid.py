"""The cylindroid: the axes of all screws of a 2-system, coloured by their pitch.

Two screws span a 2-system. The axes of its screws meet one line, the nodal line, at right angles, and lie on Plucker's
conoid z (x^2 + y^2) = (b - a) x y, within |a - b| of each other; the pitch goes from a to b (R. S. Ball, 1900).

Run: python examples/42_cylindroid.py [FILE]      draws FILE (cylindroid.png); needs the extra `pictures`
"""

import sys

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

import invariantqp as iq
from invariantqp import systems

J = np.column_stack(
    (
        iq.se3.helical((1, 0, 0.2), point=(0, 0, 0.05), pitch=0.10),
        iq.se3.helical((0.3, 1, 0), point=(0.05, 0, -0.05), pitch=-0.15),
    )
)
found = systems.cylindroid(J)
a, b = found.type.moduli
print(f"type {found.type}: principal pitches {a:.4f} and {b:.4f} m/rad, length {found.length:.4f} m")

angles = np.linspace(0.0, np.pi, 121)
coefficients = found.at(angles)
pitches, (directions, points) = found.pitches(coefficients), found.axes(coefficients)
for t in angles[:61:15]:
    c = found.at(t)
    print(f"at {np.degrees(t):3.0f} deg from the first axis: pitch {found.pitches(c)[0]:+.4f} m/rad")
home = iq.inverse(found.pose)  # drawn in the frame of its normal form: x, y the principal axes, z the nodal line
u, p = home[:3, :3] @ directions, home[:3, :3] @ points + home[:3, 3:]
norm, colours = Normalize(a, b), colormaps["viridis"]
figure = Figure(figsize=(6.6, 5.2), layout="constrained")
ax = figure.add_subplot(projection="3d")
for i in range(len(angles)):
    ends = np.stack((p[:, i] - 0.15 * u[:, i], p[:, i] + 0.15 * u[:, i]), axis=1)
    thick = 3.0 if i in (0, 60) else 0.9
    ax.plot(*ends, color=colours(norm(pitches[i])), linewidth=thick)
z = 0.5 * found.length * np.array([-1.2, 1.2])
ax.plot((0, 0), (0, 0), z, color="black", linestyle="--")
ax.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]", title="axes of a 2-system; thick: the principal screws")
ax.view_init(elev=28, azim=-55)
mappable = ScalarMappable(norm, colours)
figure.colorbar(mappable, ax=ax, shrink=0.6, label="pitch [m/rad]")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "cylindroid.png", dpi=120)
