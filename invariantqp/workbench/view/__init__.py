"""A run to look at: in a browser while it is running, or as one HTML file that needs nothing else."""
