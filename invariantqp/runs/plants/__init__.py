"""What a run controls: an ideal arm, or one simulated by MuJoCo."""
