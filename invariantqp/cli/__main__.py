"""`python -m invariantqp.cli`."""

from invariantqp.cli import main

main()
