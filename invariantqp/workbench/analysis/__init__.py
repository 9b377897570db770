"""Properties of an arm before it moves. In: a robot. Out: its screw systems over the joint range and a pitch for it."""
