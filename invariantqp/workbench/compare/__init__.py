"""Methods of velocity control, ours and others, measured on the same tasks with equal information.

In: names of tasks and methods. Out: results.json, tables, a chart and a page.

method                     what a method is, and what every method is given
ours  by_hand  libraries   the methods
arms  tasks                the bed: kinds of tasks on five arms, and task files
worker  drive              a process for each environment, methods in turn
environments               Python environments of libraries that exclude one another
figures                    errors, accelerations and settling time of a run; dominance
sweep  results             all methods on all tasks; results.json
tables  report             tables, chart and page of it
"""
