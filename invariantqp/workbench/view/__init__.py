"""Views of a run: a page served while it runs, or one HTML file that needs nothing else."""
