"""The command `invariantqp`, and `python -m invariantqp`; without the extra `cli`, one line that says so."""

from __future__ import annotations

import sys

from invariantqp.errors import MissingExtra
from invariantqp.extras import require


def main() -> None:
    """Run the command line, if it is installed."""
    try:
        require("cli", "typer", "rich")
    except MissingExtra as error:
        sys.exit(_told(error))
    from invariantqp.cli import main as run

    run()


def _told(error: MissingExtra) -> int:
    """Print what is missing; the status of `invariantqp.cli.console.BAD_INPUT`."""
    sys.stderr.write(f"error: {error}\n")
    return 2


if __name__ == "__main__":
    main()
