"""The command `invariantqp`, and `python -m invariantqp`; it needs the extra `cli`."""

from __future__ import annotations

import sys

from invariantqp.errors import MissingExtra
from invariantqp.extras import require


def main() -> None:
    """Run the command line, or say how to install it."""
    try:
        require("cli", "typer", "rich")
    except MissingExtra as error:
        sys.stderr.write(f"error: {error}\n")
        sys.exit(2)  # `invariantqp.workbench.cli.console.Exit.BAD_INPUT`
    from invariantqp.workbench.cli import main as run

    run()


if __name__ == "__main__":
    main()
