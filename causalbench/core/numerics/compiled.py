"""Compilation of scalar loops: cached on disk, announced once, and with a slower path where it is not possible.

Numba compiles what is marked with `compiled` at its first use on a machine and keeps the machine code in
`NUMBA_CACHE_DIR`, else beside the source file, else in the user's cache folder, until the function or something that is
compiled into it changes, in whatever file (`_depending`). Where numba is missing, broken or switched off
(`NUMBA_DISABLE_JIT=1`) the same functions run as plain Python: equal results up to rounding, slower. Where no folder
can be written, a private one in the temporary directory serves, and without that every process compiles anew. Each is
said in one sentence, a warning of the logger `causalbench.core.numerics.compiled`, which goes to stderr unless the
program arranges for its logs.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import logging
import os
import stat
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import CellType, FunctionType, ModuleType
from typing import Any, TypeVar, overload

import numpy as np

Function = TypeVar("Function", bound=Callable[..., Any])

_TYPES = {"address": ("intp", ctypes.c_void_p), "int32": ("int32", ctypes.c_int32)}
_FOLDERS: dict[str, str] = {}
"""Modules with functions compiled here, and where their code is kept; others' compilations are not announced."""
_DIGESTS: dict[str, str] = {}
"""Those modules, and what their compiled code depends on, see `_digest`."""


@functools.cache
def problem() -> str:
    """Why nothing can be compiled in this process; "" if it can."""
    try:
        import numba
    except Exception as error:  # a numba that does not fit this numpy may raise anything
        return f"numba cannot be imported ({type(error).__name__}: {error})"
    return "NUMBA_DISABLE_JIT is set" if numba.config.DISABLE_JIT else ""  # type: ignore[attr-defined]


@functools.cache
def _say(sentence: str) -> None:
    """Warn, once a process."""
    logging.getLogger(__name__).warning(sentence)


@overload
def compiled(function: Function, /) -> Function: ...
@overload
def compiled(**options: Any) -> Callable[[Function], Function]: ...
def compiled(function: Any = None, /, **options: Any) -> Any:
    """A decorator, with or without options of `numba.njit`, for a function of scalars, arrays and named tuples."""
    if function is None:
        return functools.partial(compiled, **options)
    if not can_compile(function):
        return function
    import numba

    return cached(numba.njit, **options)(function)


def can_compile(function: Callable[..., Any]) -> bool:
    """Whether `function` can be compiled; if not, that is announced, and if so, the moment when it has to be."""
    if problem():
        _say(f"causalbench runs its inner loops as plain Python, many times slower, since {problem()}")
        return False
    if function.__module__ not in _FOLDERS:
        _FOLDERS[function.__module__] = cache_folder(function) or _in_temporary_folder(function)
    _DIGESTS[function.__module__] = _digest(function)
    _listen()
    return True


def cached(decorate: Callable[..., Any], *arguments: Any, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """`decorate(*arguments, cache=True, **options)` of numba, or without the cache where no folder can be written."""

    def apply(function: Callable[..., Any]) -> Any:
        try:
            return decorate(*arguments, cache=True, **options)(_depending(function))
        except RuntimeError as error:
            if "cannot cache" not in str(error):
                raise
            _say(
                "causalbench cannot keep compiled code, so every process compiles it again, a minute or so each time: "
                "set NUMBA_CACHE_DIR to a folder that you can write to"
            )
            return decorate(*arguments, **options)(function)

    return apply


def _depending(function: Any) -> Callable[..., Any]:
    """The same function, with the digest of its module among the values of its closure.

    Functions that a function calls and constants that it reads are compiled into it. Numba finds kept code by the
    function's own file, its bytecode and its closure, so without the digest a change elsewhere would go unnoticed.
    """
    code = function.__code__.replace(co_freevars=(*function.__code__.co_freevars, "digest"))
    cells = (*(function.__closure__ or ()), CellType(_DIGESTS[function.__module__]))
    return FunctionType(code, function.__globals__, function.__name__, function.__defaults__, cells)


def _digest(function: Any) -> str:
    """Digest of all that the functions of a module may have compiled in, of which `function` is the latest.

    That is its source and its constants; constants, records and external functions that it imports; and the digests of
    modules with compiled functions that it imports from: imports come first and make no circles, so those are complete.
    """
    names, own = function.__globals__, function.__module__
    modules = [value for value in names.values() if isinstance(value, ModuleType)]
    origins = {getattr(value, "__module__", "") for value in names.values()} | {module.__name__ for module in modules}
    digest = hashlib.sha256("".join(sorted(_DIGESTS[name] for name in _DIGESTS.keys() & origins - {own})).encode())
    source = Path(function.__code__.co_filename)
    digest.update(source.read_bytes() if source.exists() else b"typed in")
    digest.update("".join([_constants(names), *map(_constants_of, modules)]).encode())
    # Fields of records and what external functions take.
    shapes = [getattr(value, "_fields", None) or getattr(value, "sig", None) for value in names.values()]
    digest.update(repr([str(shape) for shape in shapes if shape]).encode())
    return digest.hexdigest()


def _constants(names: dict[str, Any]) -> str:
    """Those of a module's names that are written in capitals, with their values."""
    facts = {name: _baked(value) for name, value in names.items() if name.strip("_").isupper()}
    return repr(sorted((name, fact) for name, fact in facts.items() if fact))


@functools.cache
def _constants_of(module: ModuleType) -> str:
    """As `_constants`, of a module that has been imported to its end."""
    return _constants(vars(module))


def _baked(value: Any) -> str:
    """What compiled code has of a constant: its numbers; "" for what it cannot have."""
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape} {value.tobytes()!r}"
    if isinstance(value, tuple):
        return f"({','.join(map(_baked, value))})"
    return repr(value) if isinstance(value, bool | int | float | str | np.generic) else ""


def cache_folder(function: Callable[..., Any] = compiled) -> str:
    """Where the compiled code of `function` is kept, by default of this module's; "" if nowhere. Compiles nothing."""
    if problem():
        return ""
    import numba

    try:
        return str(numba.njit(cache=True)(function).stats.cache_path)
    except RuntimeError:
        return ""


def _in_temporary_folder(function: Callable[..., Any]) -> str:
    """Let numba keep its code in `private_folder`, for this process and those that it starts; "" where that is none.

    Else every command on a machine without a cache that can be written would compile first.
    """
    import numba

    folder, is_new = private_folder()
    if not folder:
        return ""
    os.environ["NUMBA_CACHE_DIR"] = numba.config.CACHE_DIR = folder  # type: ignore[attr-defined]
    if is_new:
        _say(
            f"causalbench keeps compiled code in {folder}, since it can write to no other place; set NUMBA_CACHE_DIR "
            "to a folder that lasts longer"
        )
    return cache_folder(function)


def private_folder() -> tuple[str, bool]:
    """A folder in the temporary directory and whether it is new; "" where others could put code into it."""
    path = Path(tempfile.gettempdir(), f"causalbench-numba-{os.getuid()}")
    is_new = not path.exists()
    try:
        path.mkdir(mode=0o700, exist_ok=True)
        found = path.lstat()
    except OSError:
        return "", False
    ours = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022
    return (str(path) if ours else ""), is_new


def external(library: str, name: str, *arguments: str) -> Any:
    """The C function `name` of the shared `library` (a path), which returns nothing, for use in `compiled` functions.

    `arguments` are "address" (of a struct or of an array's data, as an int) or "int32". Compiled code reaches it by
    name, not by pointer, so that it can be kept on disk.
    """
    if problem():
        function = getattr(ctypes.CDLL(library), name)
        function.argtypes = [_TYPES[argument][1] for argument in arguments]
        function.restype = None
        return function
    import llvmlite.binding
    import numba

    llvmlite.binding.load_library_permanently(library)
    types = [getattr(numba.types, _TYPES[argument][0]) for argument in arguments]
    return numba.types.ExternalFunction(name, numba.types.void(*types))


@functools.cache
def _listen() -> None:
    """Announce the first compilation of this process, at the moment when it begins: the cache did not have it."""
    from numba.core import event

    class Announcer(event.Listener):
        announced = False

        def on_start(self, event: Any) -> None:
            # Where there is no folder, `cached` has said that every process compiles.
            folder = _FOLDERS.get((event.data or {}).get("module", ""))
            if folder and not self.announced:
                self.announced = True
                _say(
                    "causalbench is compiling inner loops that this machine has not run yet, each once; it takes a "
                    f"minute or so. Cached in {folder}"
                )

        def on_end(self, event: Any) -> None:
            pass

    event.register("numba:run_pass", Announcer())  # type: ignore[no-untyped-call]
