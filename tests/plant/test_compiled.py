"""What is compiled keeps its promises: no fused multiply-add, a cache that knows its sources."""

from typing import Any, cast

from plant.compiled import _PackageCache, _sources_digest
from plant.integrate import march, simulate
from plant.parameters import wang2014
from plant.tail_input import TailBeat, TailProgramme


def test_no_multiply_add_is_fused() -> None:
    simulate(wang2014(), TailProgramme.steady(TailBeat(0.0, 0.2, 1.0)), 0.01)
    ir = cast(Any, march).inspect_llvm()
    for text in ir.values():
        assert "llvm.fma" not in text
        assert "fmuladd" not in text
        assert " fast " not in text
        assert " contract " not in text


def test_the_cache_key_holds_the_digest_of_all_sources() -> None:
    cache = cast(Any, march)._cache
    assert isinstance(cache, _PackageCache)

    class Codegen:
        def magic_tuple(self) -> tuple[str, ...]:
            return ("target",)

    assert _sources_digest() in cache._index_key(("signature",), Codegen())
