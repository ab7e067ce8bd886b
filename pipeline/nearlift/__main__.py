"""The command line; an interrupt ends it quietly while its modules are still being imported."""

import sys

from nearlift.errors import INTERRUPTED


def main() -> None:
    """Run the command line."""
    try:
        from nearlift.cli import main as commands
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    commands()


if __name__ == "__main__":
    main()
