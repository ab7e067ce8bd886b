"""What the command ``nearlift`` starts: loads the command line, which takes a while, and can be interrupted in it."""

import sys


def main() -> None:
    """Run the command line."""
    try:
        from nearlift import cli

        cli.main()
    except KeyboardInterrupt:
        # before any command has begun; from there on they answer themselves
        sys.stderr.write("interrupted; nothing was begun\n")
        sys.exit(130)
