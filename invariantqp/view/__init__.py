"""A run to look at: in a browser while it goes on, or as one file that needs nothing else."""
