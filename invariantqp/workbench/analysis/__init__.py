"""What can be said of an arm before it moves: singular states, principal pitches, the form to give it."""
