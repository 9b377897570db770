"""Task files and their runs in closed loop."""
