"""Pictures of runs, contacts and pitches."""
