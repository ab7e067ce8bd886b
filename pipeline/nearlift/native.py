"""Compiled loops without their compiler: machine code that is kept, linked anew in milliseconds,
and called outside the GIL.

numba takes half a second of processor time to be imported and to find what it compiled once, more
than parsing a thousand records. What it makes of a function of bare pointers is a few kilobytes
that need nothing of it, nor of Python: they are kept in a file whose name digests the function's
source, the processor and LLVM's version, and LLVM's own linker loads them.
"""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import importlib
import platform
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from nearlift import isolation

POINTER, TEXT, WHOLE, REAL = ctypes.c_void_p, ctypes.c_char_p, ctypes.c_uint64, ctypes.c_double

Call = Callable[..., int]
#: Two threads that begin at once shall not both compile.
_ONE_AT_A_TIME = threading.Lock()


class Kernel:
    """One compiled function, made ready when it is first called.

    Parameters
    ----------
    module, name : str
        Full name of the module that has it in its `KERNELS`: name to function, numba signature
        (which returns a 64-bit whole number) and options of numba's. That module is imported only
        to be compiled; its functions neither raise nor allocate, and use nothing of nearlift's
        other modules, whose changes would not show.
    *arguments : type
        `POINTER`, `TEXT` (bytes), `WHOLE` or `REAL` for each argument.
    """

    def __init__(self, module: str, name: str, *arguments: Any) -> None:
        self.module, self.name, self.arguments = module, name, arguments
        self.file = Path(__file__).parent.joinpath(*module.split(".")[1:]).with_suffix(".py")
        self.call: Call | None = None

    def __call__(self, *arguments: Any) -> int:
        """Call it; numbers and addresses are not checked."""
        return (self.call or self.prepare())(*arguments)

    def prepare(self) -> Call:
        """Make it ready, which is done once."""
        with _ONE_AT_A_TIME:
            self.call = self.call or self._ready()
        return self.call

    def _ready(self) -> Call:
        """The machine code, loaded if this machine has it, else compiled and kept."""
        import llvmlite.binding as llvm

        features = llvm.get_host_cpu_features().flatten()
        source = hashlib.sha256(self.file.read_bytes()).hexdigest()
        about = [
            source,
            llvm.get_host_cpu_name(),
            features,
            platform.machine(),
            str(llvm.llvm_version_info),
        ]
        name = f"{self.name}-{hashlib.sha256(' '.join(about).encode()).hexdigest()[:24]}.code"
        folder = isolation.code_folder()
        if folder is not None:
            with contextlib.suppress(OSError):
                if (kept := checked(isolation.private_bytes(folder / name))) is not None:
                    return self._linked(*kept)
        try:
            symbol, code = self.compiled()
        except AttributeError:
            # another numba keeps its machine code elsewhere: slower to start, the same answers
            return self._by_numba()
        if folder is not None:
            with contextlib.suppress(OSError):
                content = symbol.encode() + b"\n" + code
                isolation.keep_private(folder / name, hashlib.sha256(content).digest() + content)
        return self._linked(symbol, code)

    def compiled(self) -> tuple[str, bytes]:
        """Symbol and machine code, which must ask for nothing outside itself.

        Raises
        ------
        AttributeError
            numba has no such thing, or its code calls something that a linker would have to find.
        """
        from nearlift.compiler import numba

        source, signature, keywords = importlib.import_module(self.module).KERNELS[self.name]
        # wrappers would call Python; an error model of Python's would raise
        options: dict[str, object] = {
            "nogil": True,
            "no_cpython_wrapper": True,
            "no_cfunc_wrapper": True,
            "error_model": "numpy",
            **keywords,
        }
        function = numba.njit(**options)(source)
        function.compile(signature.args)
        overload = function.overloads[signature.args]
        module = overload.library._final_module
        outside = [
            f.name for f in module.functions if f.is_declaration and not f.name.startswith("llvm.")
        ]
        if outside or overload.signature != signature:
            raise AttributeError(f"{self.name} is {overload.signature} and calls {outside}")
        return overload.fndesc.llvm_func_name, overload.library._get_compiled_object()

    def _linked(self, symbol: str, code: bytes) -> Call:
        """Callable machine code, by numba's convention: where the answer goes, where an exception
        would, the arguments; 0 for no exception.
        """
        import llvmlite.binding as llvm

        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        machine = llvm.Target.from_default_triple().create_target_machine()
        engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
        engine.add_object_file(llvm.ObjectFileRef.from_data(code))
        engine.finalize_object()
        function = ctypes.CFUNCTYPE(ctypes.c_int32, POINTER, POINTER, *self.arguments)(
            engine.get_function_address(symbol)
        )

        def call(*arguments: Any) -> int:
            answer = ctypes.c_int64()
            function(ctypes.byref(answer), None, *arguments)
            return answer.value

        # the code lives as long as the engine does
        call.engine = engine  # type: ignore[attr-defined]
        return call

    def _by_numba(self) -> Call:
        """The same by numba's public road."""
        from nearlift.compiler import numba

        source, signature, options = importlib.import_module(self.module).KERNELS[self.name]
        compiled = numba.cfunc(signature, error_model="numpy", **options)(source)
        function = ctypes.CFUNCTYPE(ctypes.c_int64, *self.arguments)(int(compiled.address or 0))

        def call(*arguments: Any) -> int:
            return int(function(*arguments))

        call.compiled = compiled  # type: ignore[attr-defined]
        return call


def address(values: Any) -> int:
    """Where an array's first number stands."""
    try:
        # a tenth of the time that the array's own answer takes
        return ctypes.addressof(ctypes.c_char.from_buffer(values))
    except (TypeError, ValueError):
        # it is read-only, or empty
        place: int = values.__array_interface__["data"][0]
        return place


def checked(content: bytes) -> tuple[str, bytes] | None:
    """Symbol and code of a kept file; None where it is not what was written."""
    digest, content = content[:32], content[32:]
    if hashlib.sha256(content).digest() != digest:
        return None
    symbol, _, code = content.partition(b"\n")
    return symbol.decode(), code
