"""Power loss: every sample that the mote reported as stored is in its flash, byte for byte.

`proc.appended` says which payload got which number and waits in RAM, `proc.stored` up to which
number all are stored. Numbers of samples that were only in RAM are given again after a reset, so
the account is kept boot by boot. At the end the flash is read as a mount would read it.
"""

from __future__ import annotations

from typing import Any

import pytest

from spi_bus.messages import LINK_MESSAGES, SensorReport


def flash_cuts(*cuts: tuple[float, float, float]) -> str:
    rows = ", ".join(
        f"{{after_s={after}, at_fraction={fraction}, duration_s={duration}}}"
        for after, fraction, duration in cuts
    )
    return f"faults.flash_cuts=[{rows}]"


def supply_cuts(*cuts: tuple[float, float]) -> str:
    rows = ", ".join(f"{{at_s={at}, duration_s={duration}}}" for at, duration in cuts)
    return f"faults.supply_cuts=[{rows}]"


CASES = {
    "as bundled": ((), None),
    **{
        f"fraction {fraction}": (
            (flash_cuts((1.2, fraction, 0.3), (2.6, fraction, 0.05), (4.0, fraction, 0.3)),),
            6.0,
        )
        for fraction in (0.0, 0.02, 0.3, 0.7, 0.98, 1.0)
    },
    # The first cycles of a blank flash open a sector: its erase, 0.6 s, and its control records.
    "first cycles": (
        (flash_cuts((0.0, 0.4, 0.2), (0.3, 0.6, 0.2), (2.5, 0.9, 0.2), (3.4, 0.1, 0.2)),),
        7.0,
    ),
    "again and again": ((flash_cuts(*((1.9 * n, 0.5, 0.1) for n in range(1, 6))),), 12.0),
    "at any moment": ((supply_cuts((1.2345, 0.2), (2.00071, 0.003), (3.3001, 0.5)),), 5.0),
    "with samples of GPS, few of them": (
        ("navboard.gps.fitted=true", flash_cuts((3.2, 0.5, 0.3))),
        6.0,
    ),
}
SEEDS = (1, 2)


@pytest.fixture(params=[(name, seed) for name in CASES for seed in SEEDS], ids=str)
def run(request: pytest.FixtureRequest, swim: Any) -> Any:
    name, seed = request.param
    sets, duration_s = CASES[name]
    return swim(
        "power-loss" if not sets else "swim-forward", *sets, duration_s=duration_s, seed=seed
    )


def account(run: Any) -> tuple[dict[int, bytes], int]:
    """Number → payload of all that was reported as stored, and how many boots there were."""
    promised: dict[int, bytes] = {}
    boots = [time_fs for time_fs, _ in run.channels["proc.boot"]]
    for begin_fs, end_fs in zip([0, *boots[1:]], [*boots[1:], 1 << 80], strict=True):
        appended = {
            number: payload
            for time_fs, (number, payload) in run.channels["proc.appended"]
            if begin_fs <= time_fs < end_fs
        }
        stored = [n for time_fs, n in run.channels["proc.stored"] if begin_fs <= time_fs < end_fs]
        assert stored == sorted(stored)
        last = max(stored, default=-1)
        fresh = {number: payload for number, payload in appended.items() if number <= last}
        assert not promised.keys() & fresh.keys(), "a number that was stored was given again"
        promised |= fresh
    return promised, len(boots)


def test_what_was_reported_as_stored_is_there(run: Any) -> None:
    promised, boots = account(run)
    records = run.bench.robot.proc.stored_records()
    found = {record.sequence: record.payload for record in records}
    assert len(found) == len(records), "a number stands in the log twice"
    lost = sorted(promised.keys() - found.keys())
    assert lost == []
    assert {number: found[number] for number in promised} == promised
    assert len(promised) > 8
    cuts = run.config.faults.flash_cuts or run.config.faults.supply_cuts
    assert boots >= 2, "the supply was never cut"
    assert run.bench.robot.proc.boot_number <= 1 + len(cuts)


def test_the_summary_counts_the_same(run: Any) -> None:
    promised, _ = account(run)
    assert run.data.metrics["samples_stored"] == len(promised)
    assert run.data.metrics["samples_lost"] == 0
    assert run.data.metrics["samples_recovered"] >= len(promised)


def test_what_is_there_was_measured(run: Any) -> None:
    """Nothing in the log that no link delivered: half-written records do not come back."""
    received = set(run.values("proc.samples"))
    records = run.bench.robot.proc.stored_records()
    assert all(record.payload in received for record in records)
    assert any(isinstance(LINK_MESSAGES.decode(record.payload), SensorReport) for record in records)


def test_cuts_fall_into_flash_cycles(swim: Any) -> None:
    """That the bundled scenario cuts where it hurts: within a program or erase, twice."""
    run = swim("power-loss", duration_s=None, seed=1)
    said = [event.what for event in run.data.events if event.where == "supply"]
    assert sum("flash operation" in what for what in said) == 2
    assert sum("restored" in what for what in said) == 2
    assert len(run.values("proc.boot")) == 3
