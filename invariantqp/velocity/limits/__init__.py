"""What no velocity may leave: boxes, rows, braking distances, the tool's speed."""
