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
        sys.stderr.write(f"error: {error}\n")
        sys.exit(2)  # `invariantqp.workbench.cli.console.Exit.BAD_INPUT`
    from invariantqp.workbench.cli import main as run

    run()


if __name__ == "__main__":
    main()
