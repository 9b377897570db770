"""What is measured of each method, one measurement in a file."""
