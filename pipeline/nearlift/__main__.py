"""The command line; an interrupt ends it quietly while its modules are still being imported."""

import sys

from nearlift.errors import INTERRUPTED, InputRefused


def main() -> None:
    """Run the command line."""
    try:
        from nearlift.cli import main as commands
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    try:
        commands()
    except OSError as fault:
        # the help or the version on a full disk; commands answer themselves
        sys.stderr.write(f"error: {fault}\n")
        sys.exit(InputRefused.exit_code)


if __name__ == "__main__":
    main()
