"""What a controller is run against: an ideal arm, or MuJoCo's."""
