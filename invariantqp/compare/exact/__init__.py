"""Exact answers to the problems that the methods solve."""
