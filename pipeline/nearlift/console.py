"""What the command ``nearlift`` starts: loads the command line, which takes a while, and can be
interrupted in it.
"""

import os
import signal
import sys
import threading


def main() -> None:
    """Run the command line."""
    sys.unraisablehook = _heard
    try:
        from nearlift import cli

        cli.main()
    except KeyboardInterrupt:
        # before any command has begun; from there on they answer themselves
        sys.stderr.write("interrupted; nothing was begun\n")
        sys.exit(130)
    except SystemExit as end:
        _leave(end.code)
        raise


def _heard(lost: "sys.UnraisableHookArgs") -> None:
    """Send an interrupt again that landed where none can be raised, as in a callback from C."""
    if issubclass(lost.exc_type, KeyboardInterrupt):
        heard = signal.getsignal(signal.SIGINT) is signal.default_int_handler
        again = signal.SIGINT if heard else signal.SIGTERM
        threading.Timer(0.05, os.kill, (os.getpid(), again)).start()
    else:
        sys.__unraisablehook__(lost)


def _leave(code: object) -> None:
    """End this process once everything is said and done: Python would take its modules apart first,
    a twentieth of a short command's time.
    """
    import atexit

    if not (isinstance(code, int) or code is None) or not all(
        t.daemon for t in threading.enumerate() if t is not threading.main_thread()
    ):
        return
    atexit._run_exitfuncs()
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except (OSError, ValueError, AttributeError):
        # nobody listens any more, which Python tells in its own way
        return
    os._exit(code or 0)
