"""What is measured of each method."""
