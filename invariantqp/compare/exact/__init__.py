"""Exact answers to the problems that the methods solve, each computed in two independent ways."""
