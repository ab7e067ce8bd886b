"""The compiled scanner without its compiler: machine code that is kept, linked anew in milliseconds, and called outside the GIL.

numba takes half a second of processor time to be imported and to find what it compiled once, more than parsing a thousand records. What it
makes of a function of bare pointers is a few kilobytes that need nothing of it, nor of Python: they are kept in a file whose name
digests the function's source, the processor and LLVM's version, and LLVM's own linker loads them.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import hashlib
import os
import platform
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from nearlift.readers.seam import FloatArray

KERNEL = Path(__file__).with_name("kernel.py")
IRREGULAR = -1
POWERS = 10.0 ** np.arange(19)
_POINTER, _WHOLE = ctypes.c_void_p, ctypes.c_uint64
_ARGUMENTS = (_POINTER, *(_WHOLE,) * 5, _POINTER, _POINTER, _WHOLE, _WHOLE, _POINTER)

Call = Callable[..., int]
#: Two threads that begin at once shall not both compile.
_ONE_AT_A_TIME = threading.Lock()


def scan(text: bytes, at: int, columns: int, force_column: int, time_column: int | None, force: FloatArray, time: FloatArray) -> int | None:
    """Fill `force` and `time` from `text` after byte `at`; the number of rows, or None where a line is not plain.

    Bytes before `at` are the header; there must be some. `time_column` is None where there is none.
    """
    if at < 1 or at > len(text):
        return None
    there = {force_column: force} if time_column is None else {force_column: force, time_column: time}
    low, high = min(there), max(there)
    first, second = there[low], there[high]
    with _ONE_AT_A_TIME:
        scanner = _scanner()
    rows = scanner(
        _address(np.frombuffer(text, dtype=np.uint8)),
        len(text),
        at,
        low,
        max(high - low - 1, 0),
        columns - 1 - high,
        _address(first),
        _address(second),
        min(len(first), len(second)),
        int(high != low),
        _address(POWERS),
    )
    return None if rows == IRREGULAR else rows


def _address(values: Any) -> int:
    """Where an array's first number stands."""
    return int(values.ctypes.data)


@functools.cache
def _scanner() -> Call:
    """The compiled `kernel.scan`, loaded if this machine has it, else compiled and kept."""
    import llvmlite.binding as llvm

    features = llvm.get_host_cpu_features().flatten()
    about = [hashlib.sha256(KERNEL.read_bytes()).hexdigest(), llvm.get_host_cpu_name(), features, platform.machine(), str(llvm.llvm_version_info)]
    name = f"scan-{hashlib.sha256(' '.join(about).encode()).hexdigest()[:24]}.code"
    for folder in _folders():
        with contextlib.suppress(OSError):
            if (kept := _checked((folder / name).read_bytes())) is not None:
                return _linked(*kept)
    try:
        symbol, code = _compiled()
    except AttributeError:
        # another numba keeps its machine code elsewhere: slower to start, the same answers
        return _by_numba()
    for folder in _folders():
        with contextlib.suppress(OSError):
            _keep(folder / name, symbol, code)
            break
    return _linked(symbol, code)


def _folders() -> Iterator[Path]:
    """Where machine code may be kept: beside Python's own, else in the user's cache."""
    yield KERNEL.parent / "__pycache__"
    yield Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "nearlift"


def _keep(path: Path, symbol: str, code: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    content = symbol.encode() + b"\n" + code
    unfinished = path.with_name(f".{path.name}.{os.getpid()}")
    unfinished.write_bytes(hashlib.sha256(content).digest() + content)
    unfinished.replace(path)


def _checked(content: bytes) -> tuple[str, bytes] | None:
    """Symbol and code of a kept file; None where it is not what was written."""
    digest, content = content[:32], content[32:]
    if hashlib.sha256(content).digest() != digest:
        return None
    symbol, _, code = content.partition(b"\n")
    return symbol.decode(), code


def _compiled() -> tuple[str, bytes]:
    """Symbol and machine code of the scanner, which must ask for nothing outside itself.

    Raises
    ------
    AttributeError
        numba has no such thing, or its code calls something that a linker would have to find.
    """
    import numba

    from nearlift.readers import kernel

    # wrappers would call Python; an error model of Python's would raise
    options: dict[str, Any] = {"nogil": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True, "error_model": "numpy"}
    function = numba.njit(**options)(kernel.scan)
    function.compile(kernel.SIGNATURE.args)
    found = function.overloads[kernel.SIGNATURE.args]
    module = found.library._final_module
    outside = [f.name for f in module.functions if f.is_declaration and not f.name.startswith("llvm.")]
    if outside or found.signature != kernel.SIGNATURE:
        raise AttributeError(f"the scanner is {found.signature} and calls {outside}")
    return found.fndesc.llvm_func_name, found.library._get_compiled_object()


def _linked(symbol: str, code: bytes) -> Call:
    """Callable machine code, by numba's convention: where the answer goes, where an exception would, the arguments; 0 for no exception."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_default_triple().create_target_machine()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    function = ctypes.CFUNCTYPE(ctypes.c_int32, _POINTER, _POINTER, *_ARGUMENTS)(engine.get_function_address(symbol))

    def call(*arguments: int) -> int:
        answer = ctypes.c_int64(IRREGULAR)
        function(ctypes.addressof(answer), None, *arguments)
        return answer.value

    # the code lives as long as the engine does
    call.engine = engine  # type: ignore[attr-defined]
    return call


def _by_numba() -> Call:
    """The same by numba's public road."""
    import numba

    from nearlift.readers import kernel

    compiled = numba.cfunc(kernel.SIGNATURE, error_model="numpy")(kernel.scan)
    function = ctypes.CFUNCTYPE(ctypes.c_int64, *_ARGUMENTS)(int(compiled.address or 0))

    def call(*arguments: int) -> int:
        return int(function(*arguments))

    call.compiled = compiled  # type: ignore[attr-defined]
    return call
