"""Isolation from code in the folder of the data, for Python, numba and matplotlib.

Measurements from another person may be analysed in a folder that this person filled. A fresh
interpreter imports modules from the current folder, numba and matplotlib read settings there. A
cache of compiled code can hold foreign code as well.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import stat
import sys
import threading
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

#: Set, it keeps Python from importing from the current folder
#: (docs.python.org/3/using/cmdline.html#envvar-PYTHONSAFEPATH).
SAFE_PATH = "PYTHONSAFEPATH"
#: What numba and matplotlib read when they are imported: the one can name code to be loaded, the
#: other's values have been evaluated as code.
SETTINGS = (".numba_config.yaml", "matplotlibrc")
#: A library may load another.
_ONE_AT_A_TIME = threading.RLock()


@contextlib.contextmanager
def safe_path() -> Iterator[None]:
    """Processes that `multiprocessing` starts meanwhile import nothing from the current folder;
    they inherit this process's environment.
    """
    with _ONE_AT_A_TIME:
        before = os.environ.get(SAFE_PATH)
        os.environ[SAFE_PATH] = "1"
        try:
            yield
        finally:
            if before is None:
                del os.environ[SAFE_PATH]
            else:
                os.environ[SAFE_PATH] = before


def library(name: str) -> Any:
    """A library, imported as if there were no settings for it in the current folder: the user's
    own, and the environment's, hold.
    """
    if name not in sys.modules:
        with _ONE_AT_A_TIME:
            real = os.path.exists
            # neither library has a switch for this; both ask so before they read
            os.path.exists = lambda path: path not in SETTINGS and real(path)
            try:
                importlib.import_module(name)
            finally:
                os.path.exists = real
    return importlib.import_module(name)


def load(names: Iterable[str]) -> None:
    """Import modules ahead of their use, in this process."""
    for name in names:
        library(name)


def end_with_parent() -> None:
    """A process of `multiprocessing` ends as soon as the one that started it does, were it by `kill
    -9`.
    """
    import multiprocessing

    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_await_end, args=(parent.sentinel,), daemon=True).start()


def _await_end(sentinel: int) -> None:
    from multiprocessing import connection

    connection.wait([sentinel])
    # no process is left to hand anything over to
    os._exit(1)


def code_folder() -> Path | None:
    """Folder of compiled code: ``nearlift/code`` in the user's cache (XDG_CACHE_HOME), mode 0700.

    None if another user could write there. The folder is then a link, another user's, or of another
    mode; or one above it is another user's, or everybody's without the sticky bit. None also where
    it cannot be made.
    """
    try:
        folder = Path(
            os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser(), "nearlift", "code"
        )
        # the standard has relative ones ignored: they would lie in the current folder
        if not folder.is_absolute():
            return None
        for part in (*reversed(folder.parents), folder):
            if not part.exists():
                part.mkdir(mode=0o700, exist_ok=True)
        return folder if os.name != "posix" or _is_private(folder) else None
    except (OSError, RuntimeError):
        # RuntimeError: there is no home
        return None


def _is_private(folder: Path) -> bool:
    here = folder.lstat()
    if (
        not stat.S_ISDIR(here.st_mode)
        or here.st_uid != os.geteuid()
        or stat.S_IMODE(here.st_mode) != 0o700
    ):
        return False
    return not any(_is_open(above) for above in {*folder.parents, *folder.resolve().parents})


def _is_open(above: Path) -> bool:
    """Whether another user could put another folder in the place of one that lies in this, or of
    this where it is a link.
    """
    here = above.stat()
    if not {here.st_uid, above.lstat().st_uid} <= {0, os.geteuid()}:
        return True
    return here.st_mode & stat.S_IWOTH != 0 and here.st_mode & stat.S_ISVTX == 0
