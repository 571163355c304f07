"""A processing board that starts beside a navigation board that has been up for long.

The one has reports waiting, and sends them as soon as the link is up. What the other's link
acknowledges its application gets, however long the radio takes to start.
"""

from __future__ import annotations

from typing import Any

import pytest

from firmware_model.time import FS_PER_S
from procboard.network import Network
from spi_bus.link import Link, MessageReceived, Role
from spi_bus.messages import LINK_MESSAGES, BoardEvent, SensorReport
from tools import scenario
from tools.bench import Bench
from tools.bench.power import PROC_V


@pytest.fixture
def delivered(monkeypatch: pytest.MonkeyPatch) -> list[bytes]:
    """What the master's link took, and so acknowledged."""
    payloads: list[bytes] = []
    receive = Link.receive

    def receiving(link: Link, data: bytes, now_us: int) -> list[Any]:
        events = receive(link, data, now_us)
        if link.role is Role.MASTER:
            payloads.extend(
                LINK_MESSAGES.encode(event.message)
                for event in events
                if isinstance(event, MessageReceived)
            )
        return events

    monkeypatch.setattr(Link, "receive", receiving)
    return payloads


@pytest.fixture
def slow_radio(monkeypatch: pytest.MonkeyPatch) -> None:
    """A crystal that takes 50 ms to swing, and with it the radio and the application."""
    start = Network.start

    def starting(network: Network, boot: int) -> Any:
        yield from network._alarms.sleep_us(50_000)
        return (yield from start(network, boot))

    monkeypatch.setattr(Network, "start", starting)


def late_start(off_at_s: float, on_at_s: float, duration_s: float) -> tuple[Bench, list[bytes]]:
    """Run with the processing board without supply for a while; return what its firmware saw."""
    config = scenario.load(sets=["navboard.report_period_s=0.02"], duration_s=duration_s)
    bench = Bench.from_scenario(config)
    samples: list[bytes] = []
    bench.trace.channel("proc.samples").sink(
        lambda block: samples.extend(payload for _, payload in block)  # type: ignore[misc]
    )
    rail = bench.robot.power.proc
    bench.scheduler.at(round(off_at_s * FS_PER_S), lambda: rail.set_volts(0.0))
    bench.scheduler.at(round(on_at_s * FS_PER_S), lambda: rail.set_volts(PROC_V))
    bench.run(lambda _seconds: None, lambda: False)
    bench.trace.flush()
    return bench, samples


@pytest.mark.usefixtures("slow_radio")
@pytest.mark.parametrize(("off_at_s", "on_at_s"), [(0.0, 1.5), (1.0, 1.6)])
def test_what_is_acknowledged_at_the_start_reaches_the_application(
    delivered: list[bytes], off_at_s: float, on_at_s: float
) -> None:
    _, samples = late_start(off_at_s, on_at_s, 3.0)
    assert samples == delivered[: len(samples)]
    assert len(delivered) - len(samples) <= 1  # one may be in its handler at the end
    messages = [LINK_MESSAGES.decode(payload) for payload in samples]
    assert sum(isinstance(message, SensorReport) for message in messages) > 20
    if not off_at_s:
        assert isinstance(messages[0], BoardEvent)  # of the other's reset, long ago
