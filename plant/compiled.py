"""The one door to Numba: typed, with the settings that keep results the same everywhere.

No fast-math, so nothing is reassociated and no multiply-add is fused. Division follows NumPy (no
exception inside a step; divergence is detected by the integrator).

Machine code is cached beside the sources. Numba invalidates a cached function only when its *own*
file changes, although helpers and constants from other files are compiled into it; here the digest
of all sources of this package is part of the cache key, so that an edited helper never leaves a
stale caller behind.
"""

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

from numba import njit
from numba.core.caching import FunctionCache

_P = ParamSpec("_P")
_R = TypeVar("_R")


@cache
def _sources_digest() -> str:
    """SHA-256 over the sources of this package, in name order."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.name.encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


class _PackageCache(FunctionCache):
    """Numba's on-disk cache of one function, keyed by all sources of the package as well."""

    def _index_key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
        key: tuple[Any, ...] = super()._index_key(sig, codegen)  # type: ignore[no-untyped-call]
        return (*key, _sources_digest())


def compiled(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile ``function`` on first call; keep its Python signature for the type checker."""
    dispatcher: Any = njit(cache=True, fastmath=False, error_model="numpy", forceinline=True)(
        function
    )
    # With NUMBA_DISABLE_JIT the plain function comes back, and there is nothing to cache.
    if hasattr(dispatcher, "enable_caching"):
        dispatcher._cache = _PackageCache(function)  # type: ignore[no-untyped-call]
    return cast(Callable[_P, _R], dispatcher)
