"""A live arm in the browser: a visitor drags its target, ghosts of other methods follow the same target.

session    the arm, its ghosts and their histories, tick by tick; no browser
recording  a recorded run, as the page of a run and as a task file
page       the page, by viser

In: a robot and names of methods of the comparison. Out: a page at an address of this machine. The loop never waits for
a browser. The room knows nothing of the command line.
"""
