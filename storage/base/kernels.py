"""How inner loops are compiled, and when compiled code is still good.

Kernels run without the interpreter lock and without checks. numba keeps compiled code beside the source and compiles
again where that one file changed; but a kernel also takes in what it imports, functions as well as constants. So
compiled code is stamped here with all of it: changed code never meets old machine code.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from numba import config, njit, types
from numba.core import caching, event
from numba.core.caching import InTreeCacheLocator, UserWideCacheLocator
from numba.core.dispatcher import Dispatcher

from storage.base.compiling import announce

#: Values that are compiled into the kernels that name them.
CONSTANTS = (bool, int, float, complex, str, bytes, tuple)

F = TypeVar("F", bound=Callable[..., Any])

_stamps: dict[Callable[..., Any], str] = {}


class _StampedBySources:
    """A place for compiled code that knows what the code was made of."""

    def __init__(self, function: Callable[..., Any], file: str) -> None:
        super().__init__(function, file)  # type: ignore[call-arg]
        self._stamp = _stamps.setdefault(function, _stamp(function, file))

    def get_source_stamp(self) -> str:
        """The same for the same code and the same code and constants that it takes in from other files."""
        return self._stamp


class BesideSource(_StampedBySources, InTreeCacheLocator):
    """In __pycache__ beside the source."""


class InUsersCache(_StampedBySources, UserWideCacheLocator):
    """In the user's cache folder, where the source's folder may not be written."""


class _Index(caching.IndexDataCacheFile):
    """A list of what was compiled of a function."""

    def _load_index(self) -> dict[Any, str]:
        try:
            index: dict[Any, str] = super()._load_index()  # type: ignore[no-untyped-call]
        except (AttributeError, ImportError):  # it names classes that other code had
            return {}
        return index


def _stamp(function: Callable[..., Any], file: str) -> str:
    digest = hashlib.blake2b(Path(file).read_bytes(), digest_size=16)
    for name, value in sorted(function.__globals__.items()):
        if isinstance(value, Dispatcher) and value.py_func.__module__ != function.__module__:
            digest.update(f"{name} {_stamps.get(value.py_func)}\0".encode())
        elif isinstance(value, CONSTANTS) and not name.startswith("__"):
            digest.update(f"{name} {value!r}\0".encode())
    return digest.hexdigest()


caching.IndexDataCacheFile = _Index  # type: ignore[misc]
config.CACHE_LOCATOR_CLASSES = ",".join(f"{__name__}.{place.__name__}" for place in (BesideSource, InUsersCache))  # type: ignore[attr-defined]


class _Compiling(event.Listener):
    """Hears of every kernel that is compiled, and of those that it calls meanwhile."""

    def __init__(self) -> None:
        self._depth = 0

    def on_start(self, _event: event.Event) -> None:
        """A kernel is about to be compiled."""
        if self._depth == 0:
            announce(True)
        self._depth += 1

    def on_end(self, _event: event.Event) -> None:
        """It is."""
        self._depth -= 1
        if self._depth == 0:
            announce(False)


event.register("numba:compile", _Compiling())  # type: ignore[no-untyped-call]


def _wide(of: types.Type) -> types.Type:
    """The type by which something is handed over: no constant as such, and whole numbers with 64 bits."""
    plain: types.Type = types.unliteral(of)  # type: ignore[no-untyped-call]
    return types.int64 if plain in types.signed_domain else plain


def _compiled(function: F, **options: Any) -> F:
    """A kernel as numba has it, of which other kernels make it compile as few variants as can be.

    numba would compile it once more for each constant and each width of a whole number that it is called with, and all
    that it calls as well, which makes nothing faster.
    """
    compiled: F = njit(cache=True, nogil=True, error_model="numpy", **options)(function)
    if isinstance(compiled, Dispatcher):
        template = compiled.get_call_template

        def widened(args: tuple[types.Type, ...], kws: dict[str, types.Type]) -> Any:
            return template(tuple(_wide(of) for of in args), {name: _wide(of) for name, of in kws.items()})

        compiled.get_call_template = widened  # type: ignore[method-assign, assignment]
    return compiled


def allocating_kernel(**options: Any) -> Callable[[F], F]:
    """For kernels that make arrays. Divisions by zero give infinities and nans, as in numpy, and nothing is raised."""
    return partial(_compiled, **options)


def kernel(**options: Any) -> Callable[[F], F]:
    """For kernels that make no arrays.

    numba would count references to each array at each call, by atomic operations that took a fifth of the engine's
    time; without its memory manager there are none.
    """
    return partial(_compiled, _nrt=False, **options)
