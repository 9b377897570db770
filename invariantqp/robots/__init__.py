"""Arms: from joint positions to tool pose and joint twists, all in the base frame."""
