"""The C example program and the Python link at the two ends of a pty, with faults in between.

Two processes and real file descriptors. The test reads and writes the pty's master end and treats
the bytes of both directions badly: lost, changed, cut, repeated, and zeros put in. What must come
out does not depend on time; only the patience has a limit.
"""

from __future__ import annotations

import os
import pty
import select
import subprocess
import time
import tty
from pathlib import Path
from random import Random

import pytest

from spi_bus.errors import LinkFull
from spi_bus.link import Link, LinkConfig, MessageAcknowledged, MessageReceived, Role
from spi_bus.messages import CommandApplied, Ping, Pong, TailBeat

SOURCES = Path(__file__).resolve().parents[3] / "spi_bus" / "firmware_c"
CONFIG = LinkConfig(
    queue_limit=8, ack_delay_us=2_000, retransmit_us=20_000, retransmit_max_us=200_000
)
PATIENCE_S = 60.0
COUNT = 300


@pytest.fixture
def program(build):
    sources = [SOURCES / f"{name}.c" for name in ("example_posix", "fishbed_link", "fishbed_frame")]
    return build("example", "sanitized", *sources)


class BadLine:
    """Passes bytes on, and about one piece in `one_in` not as they were."""

    def __init__(self, seed: int, one_in: int) -> None:
        self.rng = Random(seed)
        self.one_in = one_in
        self.hurt = 0

    def __call__(self, data: bytes) -> bytes:
        rng = self.rng
        if not data or not self.one_in or rng.randrange(self.one_in):
            return data
        self.hurt += 1
        at = rng.randrange(len(data))
        return (
            b"",
            data[:at],
            data[at:],
            data[:at] + bytes((data[at] ^ 1 << rng.randrange(8),)) + data[at + 1 :],
            data + data,
            data[:at] + b"\0" + data[at:],
            rng.randbytes(7) + data,
        )[rng.randrange(7)]


class PtyLink:
    """A Python link at the master end of a pty."""

    def __init__(self, role: Role, one_in: int) -> None:
        self.descriptor, self._other = pty.openpty()
        tty.setraw(self.descriptor)
        self.path = os.ttyname(self._other)
        self.link = Link(role, 7, CONFIG)
        self.to_c, self.from_c = BadLine(1, one_in), BadLine(2, one_in)
        self.begun_s = time.monotonic()

    def close(self) -> None:
        for descriptor in (self.descriptor, self._other):
            if descriptor >= 0:
                os.close(descriptor)
        self.descriptor = self._other = -1

    def turn(self) -> list:
        elapsed_s = time.monotonic() - self.begun_s
        assert elapsed_s < PATIENCE_S, "they do not come to an end"
        now = round(elapsed_s * 1e6)
        self.link.handle_timer(now)
        if data := self.to_c(self.link.data_to_send(now, 200)):
            os.write(self.descriptor, data)
        if not select.select([self.descriptor], [], [], 0.001)[0]:
            return []
        return self.link.receive(self.from_c(os.read(self.descriptor, 200)), now)


@pytest.fixture
def line(request):
    line = PtyLink(*request.param)
    yield line
    line.close()


@pytest.mark.parametrize("line", [(Role.MASTER, 0), (Role.MASTER, 8)], indirect=True)
def test_the_c_side_answers_everything_once_and_in_order(program, line):
    with subprocess.Popen(
        [program, line.path, "slave", "2"], stdout=subprocess.PIPE, text=True
    ) as other:
        try:
            answers: list[object] = []
            asked = 0
            while len(answers) < COUNT or line.link.queued:
                try:
                    while asked < COUNT:
                        line.link.send(
                            TailBeat(asked, 0.1, 0.2, 0.9, 5.0) if asked % 3 == 0 else Ping(asked)
                        )
                        asked += 1
                except LinkFull:
                    pass
                answers += [
                    event.message for event in line.turn() if isinstance(event, MessageReceived)
                ]
            one_in = line.to_c.one_in
            line.close()  # hangs up
            said, _ = other.communicate(timeout=PATIENCE_S)
        finally:
            other.kill()
    numbers = [
        answer.command_id if isinstance(answer, CommandApplied) else answer.token
        for answer in answers
    ]
    assert numbers == list(range(COUNT))
    assert all(isinstance(a, CommandApplied) == (n % 3 == 0) for n, a in enumerate(answers))
    assert other.returncode == 0, said
    assert said.split()[:2] == ["received", str(COUNT)]
    assert (line.to_c.hurt > 10 and line.from_c.hurt > 10) == bool(one_in)


@pytest.mark.parametrize("line", [(Role.SLAVE, 0), (Role.SLAVE, 8)], indirect=True)
def test_the_c_side_asks_and_hears_everything_once_and_in_order(program, line):
    with subprocess.Popen(
        [program, line.path, "master", "2", str(COUNT)], stdout=subprocess.PIPE, text=True
    ) as other:
        try:
            asked: list[int] = []
            waiting: list[int] = []
            acknowledged = 0
            while other.poll() is None:
                for event in line.turn():
                    if isinstance(event, MessageReceived):
                        asked.append(event.message.token)
                        waiting.append(event.message.token)
                    acknowledged += isinstance(event, MessageAcknowledged)
                while waiting and line.link.queued < CONFIG.queue_limit:
                    line.link.send(Pong(waiting.pop(0)))
            said, _ = other.communicate(timeout=PATIENCE_S)
        finally:
            other.kill()
    assert asked == list(range(COUNT))
    assert other.returncode == 0, said
    words = said.split()
    assert words[words.index("received") + 1] == words[words.index("acknowledged") + 1] == "300"
    assert words[words.index("wrong") + 1] == "0"
    assert acknowledged >= COUNT - CONFIG.queue_limit  # its last acknowledgement may be lost
