"""The methods that are compared, one family in a file."""
