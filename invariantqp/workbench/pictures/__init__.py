"""Pictures of runs, of contact and of the pitches of an arm, written to files."""
