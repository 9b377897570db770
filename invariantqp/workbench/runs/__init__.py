"""Task files and closed-loop runs: a TOML file becomes a `Task`, a run of it on a simulated arm becomes a `Trace`.

In: the file or name of a task, and a velocity controller, ours by default. Out: trajectory, errors, statuses and times,
and whether the task accepts them. The room knows nothing of the command line, pictures and the view.
"""
