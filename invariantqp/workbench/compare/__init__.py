"""Other methods of velocity control beside ours, measured on the same tasks at equal information.

method                     what a method is, and what all are given
ours  by_hand  libraries   the methods
arms  tasks                the bed: kinds of tasks on five arms
worker  drive              a process for each environment; methods in turn
environments               environments for libraries that exclude one another
figures                    what a run is judged by, and when one dominates another
sweep  results             all methods on all tasks; results.json
tables  report             tables, chart and page made from it
"""
