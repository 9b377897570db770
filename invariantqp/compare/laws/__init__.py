"""The methods compared."""
