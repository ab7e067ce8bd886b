"""Entry point of the command ``nearlift``, which can be interrupted while modules are loaded."""

import os
import signal
import sys
import threading


def main() -> None:
    """Run the command line."""
    sys.unraisablehook = _repeat_interrupt
    try:
        from nearlift import cli

        cli.main()
    except KeyboardInterrupt:
        # no command has begun yet; later each command ends by itself
        sys.stderr.write("interrupted; nothing was begun\n")
        sys.exit(130)


def _repeat_interrupt(lost: "sys.UnraisableHookArgs") -> None:
    """Repeat an interrupt that arrived where nothing can be raised, as in a callback from C."""
    if issubclass(lost.exc_type, KeyboardInterrupt):
        heard = signal.getsignal(signal.SIGINT) is signal.default_int_handler
        again = signal.SIGINT if heard else signal.SIGTERM
        threading.Timer(0.05, os.kill, (os.getpid(), again)).start()
    else:
        sys.__unraisablehook__(lost)
