"""The h-pseudoinverse, the same in every frame, and what it says where it does not exist.

Run: python examples/02_pseudoinverse.py
"""

import numpy as np

import invariantqp as iq

# Three hinges, [DS] Example 2: two meet, two are parallel. Columns are joint twists (omega; v), length l = 0.3 m.
J = np.column_stack(
    [
        iq.revolute([0, 0, 1]),
        iq.revolute([1, 0, 0]),
        iq.revolute([1, 0, 0], point=[0, 0.3, 0]),
    ]
)
twist = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])

x = iq.pseudoinverse(J, h=0.5) @ twist
print("joint velocities:", x.round(4))

# Somebody measures from another frame: the same machine, the same motion, the same answer.
Ad = iq.adjoint(iq.transform(translation=[1.0, -2.0, 0.5]))
print("moved frame:     ", (iq.pseudoinverse(Ad @ J, h=0.5) @ Ad @ twist).round(4))
print("Moore-Penrose:   ", (np.linalg.pinv(J) @ twist).round(4))
print("  in that frame: ", (np.linalg.pinv(Ad @ J) @ Ad @ twist).round(4))

try:
    iq.pseudoinverse(J, h=0.0)
except iq.NoPseudoinverse as refusal:
    print("\nh = 0:", refusal)

# The velocity law is defined there too: it damps the lost direction and says so.
solution = iq.solve_velocity(J, twist, form=0.0, bounds=iq.Bounds([-1, -1, -1], [1, 1, 1]))
print(f"\nlaw at h = 0: {solution.velocity.round(4)}  method {solution.method}, status {solution.status}")
print(solution.reason)
