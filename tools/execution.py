"""One run of the bench, with progress, Ctrl-C and the wall clock around it.

The only place where the wall clock and the terminal meet a run: the bench itself knows neither, so
that what it computes cannot depend on them.
"""

from __future__ import annotations

import contextlib
import gc
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from types import FrameType
from typing import TYPE_CHECKING, Any

from firmware_model.time import FS_PER_S

if TYPE_CHECKING:
    from firmware_model.scheduler import Scheduler
    from tools.bench import Bench
    from tools.bench.plant_rig import PlantRig
    from tools.configuration import Scenario
    from tools.records.data import RunData
    from tools.records.folder import RunFolder
    from tools.records.shoal_data import ShoalData
    from tools.shoal import ShoalBench


FULL_COLLECTIONS_APART = 1_000_000
"""Collections of the middle generation between full ones in real time: hours."""


def execute(
    config: Scenario,
    folder: RunFolder | None = None,
    *,
    speed: float | None = None,
    show_progress: bool = False,
) -> RunData | ShoalData:
    """Assemble the bench, run it, and return what it knows.

    `folder` gets the streamed files (spi.vcd, radio.pcap); `speed` is the multiple of real time to
    keep to, None for as fast as it goes.
    """
    from tools.compiling import compiling_shown
    from tools.records.stream import StreamedFiles

    begin = time.perf_counter()
    assembler = _assembler(config)
    with contextlib.ExitStack() as stack:
        stack.enter_context(compiling_shown(show_progress))
        bench = assembler.from_scenario(config, speed=speed, announce=_announce)
        stack.callback(bench.close)
        if folder is not None:
            stack.enter_context(StreamedFiles(bench.trace, folder, _waveforms(config)))
        interrupted = stack.enter_context(_interrupt_flag())
        report = stack.enter_context(_progress(config.scenario.duration_s, show_progress))
        if config.hil.live:
            stack.enter_context(_few_pauses(bench.scheduler))
        bench.run(report, interrupted)
        bench.trace.flush()
    return replace(bench.run_data(), wall_s=time.perf_counter() - begin)


def _assembler(config: Scenario) -> type[Bench] | type[PlantRig] | type[ShoalBench]:
    """Return what puts such a run together; only that is loaded."""
    if config.shoal.robots:
        from tools.shoal import ShoalBench

        return ShoalBench
    if config.hil.plant_for:
        from tools.bench.plant_rig import PlantRig

        return PlantRig
    from tools.bench import Bench

    return Bench


def _waveforms(config: Scenario) -> Mapping[str, str]:
    """Files for the wires of each robot, by what its trace channels begin with."""
    from tools.records.stream import ALONE
    from tools.shoal_section import addresses, names, recorded

    if not config.shoal.robots:
        return ALONE
    robots = zip(addresses(config), names(config), strict=True)
    wanted = recorded(config)
    return {f"{name}.": f"{name}/{ALONE['']}" for address, name in robots if address in wanted}


def serve(config: Scenario) -> dict[str, Any]:
    """Run one emulated board for as long as the scenario says, and return its figures.

    Nothing is kept of what happens, so that it may serve for days.
    """
    from tools.bench import Bench

    bench = Bench.from_scenario(config, announce=_announce, keep=False)
    assert bench.live is not None  # a board alone has a line
    with contextlib.ExitStack() as stack:
        stack.callback(bench.close)
        interrupted = stack.enter_context(_interrupt_flag("stopping"))
        stack.enter_context(_few_pauses(bench.live.scheduler))
        bench.run(lambda _seconds: None, interrupted)
        bench.trace.flush()
    return {"duration_s": bench.scheduler.now / FS_PER_S, **bench.live.summary()}


def _announce(place: str) -> None:
    """Say who is expected where: a pty has no name before."""
    print(f"fishbed: {place}", file=sys.stderr, flush=True)


@contextlib.contextmanager
def _few_pauses(scheduler: Scheduler) -> Iterator[None]:
    """Put full garbage collections off: one of 70 ms (measured) would be lateness.

    What stays anyway is frozen, and young objects are collected as always, under the clock of
    whoever looks for stalls.
    """
    from tools.bench.pace import LineScheduler

    assert isinstance(scheduler, LineScheduler)  # somebody takes part from outside
    thresholds = gc.get_threshold()
    gc.collect()
    gc.freeze()
    gc.set_threshold(*thresholds[:2], FULL_COLLECTIONS_APART)
    try:
        with scheduler.stalls.collections():
            yield
    finally:
        gc.set_threshold(*thresholds)
        gc.unfreeze()


@contextlib.contextmanager
def _interrupt_flag(
    says: str = "stopping; what there is will be written",
) -> Iterator[Callable[[], bool]]:
    """Turn the first Ctrl-C into a question that the run asks; the second one is as always."""
    asked = False

    def note(number: int, frame: FrameType | None) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True
        print(f"\nfishbed: {says}", file=sys.stderr)

    try:
        before = signal.signal(signal.SIGINT, note)
    except ValueError:  # not in the main thread: there, nobody can press Ctrl-C
        yield lambda: asked
        return
    try:
        yield lambda: asked
    finally:
        signal.signal(signal.SIGINT, before)


@contextlib.contextmanager
def _progress(duration_s: float, wanted: bool) -> Iterator[Callable[[float], None]]:
    """A bar with the remaining time, where somebody can see it."""
    if not (wanted and sys.stderr.isatty()):
        yield lambda seconds: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("swimming"),
        BarColumn(),
        TextColumn("{task.completed:.0f} of {task.total:.0f} s"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("run", total=duration_s)
        yield lambda seconds: progress.update(task, completed=seconds)
