"""The command line; an interrupt ends it quietly while its modules are still being imported."""

import gc
import sys

from nearlift.errors import INTERRUPTED, InputRefused

#: Objects made between two searches for garbage. Python's 700 takes a twentieth of a run: most
#: objects are those of libraries, which stay.
OBJECTS = 20_000


def main() -> None:
    """Run the command line."""
    gc.set_threshold(OBJECTS)
    try:
        from nearlift.cli import main as commands
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    try:
        commands()
    except (OSError, MemoryError) as fault:
        # the help or the version on a full disk; commands answer themselves
        reason = str(fault) or "not enough memory: use --executor serial, or a larger machine"
        sys.stderr.write(f"error: {reason}\n")
        sys.exit(InputRefused.exit_code)
    finally:
        # the interpreter would search all of them three times at its end (0.6 s)
        gc.freeze()


if __name__ == "__main__":
    main()
