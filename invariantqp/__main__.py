"""`python -m invariantqp`."""

from __future__ import annotations

from invariantqp.cli import main

if __name__ == "__main__":
    main()
