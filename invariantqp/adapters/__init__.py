"""The library inside other people's programs: their class names, their units, our law.

A file for each program: Pink, mink (a frame task), LeRobot (kinematics, action chunks), robosuite (a part controller).
In: the other program's objects and units. Out: the same.
Users import `invariantqp.pink`, `invariantqp.mink`, `invariantqp.lerobot` and `invariantqp.robosuite`.
Nothing else in the library may know these programs.
"""
