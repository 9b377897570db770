"""The h-pseudoinverse of a few joints: the same in every frame; where it does not exist; what to do there.

Run: python examples/01_pseudoinverse.py
"""

import numpy as np

import invariantqp as iq

# Three hinges, [DS] Example 2: two meet, two are parallel. Columns are joint twists (omega; v), link l = 0.3 m.
J = np.column_stack([iq.revolute([0, 0, 1]), iq.revolute([1, 0, 0]), iq.revolute([1, 0, 0], point=[0, 0.3, 0])])
twist = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])  # wanted of the tool [rad/s; m/s]

# Somebody else measures from another frame: the same machine, the same motion.
Ad = iq.adjoint(iq.transform(translation=[1.0, -2.0, 0.5]))

print("Three joints cannot do all six numbers of a twist, so what they do instead is a matter of measure [rad/s]:")
print("  h-pseudoinverse, h = 0.5 m:", (iq.pseudoinverse(J, h=0.5) @ twist).round(4))
print("    from the other frame:    ", (iq.pseudoinverse(Ad @ J, h=0.5) @ Ad @ twist).round(4))
print("  Moore-Penrose:             ", (np.linalg.pinv(J) @ twist).round(4))
print("    from the other frame:    ", (np.linalg.pinv(Ad @ J) @ Ad @ twist).round(4))

print("\nIt fails at the principal pitches of the joints, and says which they are:")
try:
    iq.pseudoinverse(J, h=0.0)
except iq.NoPseudoinverse as refusal:
    print("  h = 0:", refusal)

print("\nThe velocity law gives it inside limits. Where it does not exist, a damping is needed:")
bounds = iq.Bounds([-1, -1, -1], [1, 1, 1])  # [rad/s]
for options in ({"form": 0.5}, {"form": 0.5, "bounds": bounds}, {"form": 0.0, "damping": 0.1}):
    solution = iq.solve_velocity(J, twist, **options)
    print(f"  {solution.velocity.round(4)} rad/s, method {solution.method}, status {solution.status}")

print("\nSome systems have no h at all. A planar arm, and what a face on a table may still do:")
planar = np.column_stack([iq.revolute([0, 0, 1], point=[x, y, 0]) for x, y in ((0, 0), (0.4, 0), (0.5, 0.3))])
sliding = np.column_stack([iq.revolute([0, 0, 1]), iq.se3.prismatic([1, 0, 0]), iq.se3.prismatic([0, 1, 0])])
for name, system in (("planar arm", planar), ("face contact", sliding)):
    kind = iq.gibson_hunt(system)
    print(f"  {name}: type {kind}, an h that works: {'yes' if kind.admits_pseudoinverse else 'none'}")

print("\nThe law does what a planar arm can. What it cannot is missed by least squares, or given up as you say:")
x = iq.solve_velocity(planar, twist, point=[0.7, 0.5, 0.2]).velocity
print(f"  least squares at a point:  tool gets {(planar @ x).round(4)} (omega; v)")
given_up = np.eye(6)[:, [0, 1, 5]]  # the tilts about x and y, and the height
x = iq.solve_velocity(planar, twist, form=iq.Complement(given_up)).velocity
print(f"  given up tilts and height: tool gets {(planar @ x).round(4)}")
body = iq.CarriedMetric([0.1, 0.1, 0.1, 1.0, 1.0, 1.0], iq.transform(translation=[0.7, 0.5, 0.2]))
x = iq.solve_velocity(planar, twist, form=body).velocity
print(f"  least squares of a body:   tool gets {(planar @ x).round(4)}")
