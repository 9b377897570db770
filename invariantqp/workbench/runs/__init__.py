"""Tasks from files, and their runs in closed loop."""
