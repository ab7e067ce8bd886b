"""The number of BLAS threads: one. Matrices are small here, and threads that wait for each other
take several times as long (docs/decisions.md#one-blas-thread).
"""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Iterator
from typing import Any

#: What BLAS libraries read their number of threads from, when they are loaded.
VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def default_to_one_thread() -> None:
    """Libraries loaded from now on, here and in processes begun here, start no threads, unless the
    environment says otherwise.
    """
    for name in VARIABLES:
        os.environ.setdefault(name, "1")


_lock = threading.Lock()
_users = 0
_limits: Any = None


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Meanwhile, libraries that somebody else's program has loaded use one thread; afterwards as
    many as before. Where the environment says a number, nothing is changed.

    The limit holds for the whole process, so where several threads enter, the first sets it and the
    last to leave takes it back.
    """
    global _users, _limits
    if any(name in os.environ for name in VARIABLES):
        yield
        return
    import scipy.linalg  # noqa: F401 - brings its own library, and only what is loaded is limited
    from threadpoolctl import threadpool_limits

    with _lock:
        if _users == 0:
            _limits = threadpool_limits(1, "blas")
        _users += 1
    try:
        yield
    finally:
        with _lock:
            _users -= 1
            if _users == 0:
                _limits.restore_original_limits()
