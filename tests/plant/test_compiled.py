"""What is compiled keeps its promises: no fused multiply-add, a cache that knows its sources."""

from typing import Any, cast

from numba import njit

from plant.compiled import _PackageCache, _sources_digest
from plant.integrate import march
from plant.layout import Drive, State
from plant.parameters import pack, wang2014
from plant.rigid_tail import rates


def test_no_multiply_add_is_fused() -> None:
    # compiled afresh: machine code from the cache cannot be looked into
    fresh: Any = njit(error_model="numpy")(cast(Any, rates).py_func)
    packed = pack(wang2014())
    fresh(packed, Drive(0.1, 0.2, 5.0, 0.0, 1.0), 0.3, State(*(0.1,) * 9))
    for text in fresh.inspect_llvm().values():
        assert " fmul double " in text  # the physics is in there, inlined
        for fused in ("llvm.fma", "fmuladd", "fmul fast", "fmul contract", "fmul reassoc"):
            assert fused not in text
    for text in fresh.inspect_asm().values():
        assert "vfmadd" not in text
        assert "vfnmadd" not in text


def test_the_cache_key_holds_the_digest_of_all_sources() -> None:
    cache = cast(Any, march)._cache
    assert isinstance(cache, _PackageCache)

    class Codegen:
        def magic_tuple(self) -> tuple[str, ...]:
            return ("target",)

    assert _sources_digest() in cache._index_key(("signature",), Codegen())
