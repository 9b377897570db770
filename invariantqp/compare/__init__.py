"""Other methods of velocity control beside ours, measured on the same problems.

method  names        what a method is and what it may know; names that reports look for
laws/                the methods themselves
registry             the table of all methods
exact/               exact answers that errors are measured against
cell                 one piece of work of a sweep
measure/             what is measured
sweep                every measurement of every method on every task
results  report/     results.json; charts, tables and the page made from it
"""
