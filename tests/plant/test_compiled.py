"""What is compiled keeps its promises: no fused multiply-add, a cache that knows its sources."""

import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any, cast

import pytest
from numba import njit

from plant import compiled
from plant.compiled import _PackageCache, _SharedFile, _sources_digest
from plant.integrate import march
from plant.layout import Drive, State
from plant.packing import pack
from plant.rigid_tail import rates
from plant.robots import wang2014


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

    digest = _sources_digest(Path(compiled.__file__).parent)
    assert digest in cache._index_key(("signature",), Codegen())


@pytest.mark.skipif(sys.platform == "win32", reason="no lock there")
def test_code_saved_at_the_same_time_keeps_apart(tmp_path: Path) -> None:
    # a lock belongs to an open file, so threads with a file each meet as processes do
    start = threading.Barrier(4)

    def save(who: int) -> None:
        start.wait()
        for number in range(25):
            cache.save((who, number), [who, number])

    cache: Any = _SharedFile(cache_path=str(tmp_path), filename_base="f", source_stamp=1)
    threads = [threading.Thread(target=save, args=(who,)) for who in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for who in range(4):
        for number in range(25):
            assert cache.load((who, number)) == [who, number]


SWIM = """
import hashlib
from plant.comparison import hold_targets
from plant.parameters import PlantParameters
from plant.tail_input import TailBeat
truth = hold_targets(PlantParameters(), TailBeat.degrees(20, 15, 0.9), 0.5).truth(5 * 10**14)
print(hashlib.sha256(truth.tobytes()).hexdigest(), truth.shape)
"""

SWIM_WITH_EFFECTS = """
import hashlib
from dataclasses import replace
from plant.effects import with_effects
from plant.integrate import simulate
from plant.parameters import Hydrodynamics, PlantParameters, Servo, Walls, Water
from plant.robots import wang2014
from plant.tail_input import TailBeat, TailProgramme
programme = TailProgramme((TailBeat.degrees(20, 15, 0.9), TailBeat.degrees(0, 20, 2)), (0.0, 0.2))
effects = {
    "servo_lag": {"tau_s": 0.05}, "servo_delay": {"delay_s": 0.03},
    "servo_rate_limit": {"excess_s_rad": 1.0}, "servo_deadband": {"delta_rad": 0.02},
    "servo_backlash": {"play_rad": 0.03}, "tail_gain": {"g": 0.1}, "tail_fade": {"k_per_s": 0.1},
    "wall_effect": {"k": 1.0}, "linear_drag": {"b_n_s_m": 0.01},
}
for servo in (Servo(ideal=True), Servo()):
    plant = replace(
        wang2014(),
        servo=servo,
        hydrodynamics=Hydrodynamics(lift_per_bias=0.9),
        walls=Walls(stiffness_n_m=20.0, x_max_m=0.05),
        water=Water(current_x_m_s=0.02, shear_x_per_y_s=0.3, shear_y_per_x_s=0.1),
    )
    rows = simulate(with_effects(plant, effects), programme, 0.5, 2e-3).rows
    print(hashlib.sha256(rows.tobytes()).hexdigest(), rows.shape)
"""


def swim(code: str = SWIM, **environment: str) -> str:
    """Digest of half a second of swimming in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout


def test_interpreted_and_compiled_runs_are_the_same_bytes() -> None:
    # the interpreter's arithmetic is plain IEEE 754, so this is what any machine must give
    compiled = swim()
    assert compiled.endswith("(51, 13)\n")
    assert swim(NUMBA_DISABLE_JIT="1") == compiled


def test_so_are_runs_with_effects() -> None:
    compiled = swim(SWIM_WITH_EFFECTS)
    assert compiled.count("(251, 22)") == 2
    assert swim(SWIM_WITH_EFFECTS, NUMBA_DISABLE_JIT="1") == compiled
