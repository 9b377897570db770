"""Joint positions for a pose."""
