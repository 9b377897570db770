"""Limits on joint velocities: boxes, rows, braking distances, the tool's speed."""
