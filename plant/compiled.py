"""The one door to Numba: typed, with the settings that keep results the same everywhere.

No fast-math, so nothing is reassociated and no multiply-add is fused. Division follows NumPy (no
exception inside a step; divergence is detected by the integrator).

Machine code is cached beside the sources. Numba invalidates a cached function only when its *own*
file changes, although helpers and constants from other files are compiled into it; here the digest
of all sources of this package, and of those beside the function, is part of the cache key, so that
an edited helper never leaves a stale caller behind. Numba also lets two processes that save at
once give one file name to two functions' code; here they take turns.
"""

import contextlib
import hashlib
import sys
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

from numba import config, njit
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.np.unsafe.ndarray import to_fixed_tuple

_P = ParamSpec("_P")
_R = TypeVar("_R")


@cache
def _sources_digest(package: Path) -> str:
    """SHA-256 over the sources of a package, in name order."""
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        digest.update(path.relative_to(package).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


class _SharedFile(IndexDataCacheFile):
    """Index and data of one function, read and written by one process at a time."""

    def save(self, key: Any, data: Any) -> None:
        """Find a file name that is free, and take it, before anyone else looks."""
        with self._alone():
            super().save(key, data)  # type: ignore[no-untyped-call]

    def load(self, key: Any) -> Any:
        """Return what was saved, or None; never an index with a file that is not there yet."""
        with self._alone():
            return super().load(key)  # type: ignore[no-untyped-call]

    @contextlib.contextmanager
    def _alone(self) -> Iterator[None]:
        if sys.platform == "win32":
            yield
            return
        import fcntl

        with contextlib.ExitStack() as stack:
            # no folder yet, or one that cannot be written: nobody is there to meet
            with contextlib.suppress(OSError):
                file = stack.enter_context(Path(f"{self._index_path}.lock").open("wb"))
                fcntl.flock(file, fcntl.LOCK_EX)
            yield


class _PackageCache(FunctionCache):
    """Numba's on-disk cache of one function, keyed by the plant's and its own package as well."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)  # type: ignore[no-untyped-call]
        self._packages = {Path(__file__).parent, Path(function.__code__.co_filename).parent}
        self._cache_file = _SharedFile(  # type: ignore[no-untyped-call]
            cache_path=self._cache_path,
            filename_base=self._impl.filename_base,
            source_stamp=self._impl.locator.get_source_stamp(),
        )

    def _index_key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
        key: tuple[Any, ...] = super()._index_key(sig, codegen)  # type: ignore[no-untyped-call]
        return (*key, *(_sources_digest(package) for package in sorted(self._packages)))


def _interpreted_tuple(vector: Any, length: int) -> tuple[float, ...]:
    """``fixed_tuple`` where Numba compiles nothing (NUMBA_DISABLE_JIT)."""
    return tuple(vector[:length].tolist())


fixed_tuple: Any = _interpreted_tuple if vars(config)["DISABLE_JIT"] else to_fixed_tuple
"""The first ``length`` (a constant) elements of a vector as a tuple: how a record crosses over."""


def _dispatcher(function: Callable[_P, _R], *, inline: bool) -> Callable[_P, _R]:
    # Without the interpreter's lock, since nothing in here touches an object: threads run at once.
    dispatcher: Any = njit(
        cache=True, fastmath=False, error_model="numpy", forceinline=inline, nogil=True
    )(function)
    # With NUMBA_DISABLE_JIT the plain function comes back, and there is nothing to cache.
    if hasattr(dispatcher, "enable_caching"):
        dispatcher._cache = _PackageCache(function)
    return cast(Callable[_P, _R], dispatcher)


def compiled(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile ``function`` on first call; keep its Python signature for the type checker.

    It becomes part of every compiled caller, as what stands within a step should.
    """
    return _dispatcher(function, inline=True)


def compiled_apart(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """As ``compiled``, but compiled callers call it: for a loop that should exist once."""
    return _dispatcher(function, inline=False)
