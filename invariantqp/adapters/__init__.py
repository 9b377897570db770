"""Adapters: this library behind the interfaces of other programs, one file for each.

Pink and mink: a frame task. LeRobot: kinematics and action chunks. robosuite: a part controller.
In and out: the other program's classes and units. Users import `invariantqp.pink`, `invariantqp.mink`,
`invariantqp.lerobot` and `invariantqp.robosuite`. No other room may know these programs.
"""
