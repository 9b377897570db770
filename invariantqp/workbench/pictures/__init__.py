"""Pictures of runs and of inspected arms, by Matplotlib, and the curves that pages share with them."""
