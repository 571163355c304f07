"""One conversation byte for byte as it stands on the wire, in Python, in C, and between the two.

It goes through a handshake, data both ways, an acknowledgement alone, a lost frame and the gap that
shows it, a lost frame and the time-out, and a reset of one side. Made once by the Python link and
read by eye against docs/link.md; it must never change without a new protocol version.
"""

from __future__ import annotations

import binascii
from dataclasses import dataclass

import pytest

from spi_bus.frame import Decoder, Frame
from spi_bus.link import (
    Link,
    LinkConfig,
    LinkUp,
    MessageAcknowledged,
    MessageReceived,
    PeerReset,
    Role,
)
from spi_bus.messages import BoardEvent, CommandApplied, Ping, Pong, SensorReport, TailBeat

BEAT = TailBeat(1, 0.0, 0.25, 0.9, 5.0)
APPLIED = CommandApplied(1, 1_000)
COMPASS_RAD = 18769 / 10430.378350470453
REPORT = SensorReport(
    2_000_000, 1, 0.5, 0.1, -0.2, 9.81, COMPASS_RAD, None, 0.25, 7.4, 0.33, 21.5, None
)
RESET = BoardEvent(5, 1, 3)
MASTER, SLAVE = "master", "slave"


@dataclass(frozen=True)
class Said:
    """Who says what at which time; what the other side makes of it, None where it never arrives."""

    by: str
    now_us: int
    wire: str
    heard: tuple[object, ...] | None = ()
    send: tuple[object, ...] = ()
    boot: int = 0


# fmt: off
CONVERSATION = (
    # HELLO of epoch 0x0101: who is there?
    Said(MASTER, 0, "03 11 10 01 04 44 01 01 01 01 01 03 c1 c9 00", send=(BEAT,)),
    # HELLO of epoch 0x0202, which repeats the master's epoch and challenge: alive.
    Said(SLAVE, 0, "03 11 21 01 04 54 02 02 03 01 01 03 10 5f 00", (LinkUp(0x0202),)),
    # HELLO with the slave's, and the first message behind it.
    Said(MASTER, 0, "03 11 12 01 07 04 01 01 01 02 02 03 bc 19 00"
                    "03 12 12 01 04 04 01 01 01 01 09 88 13 84 03 f4 01 fd 4a 00",
         (LinkUp(0x0101), MessageReceived(BEAT))),
    # The acknowledgement rides on the answer.
    Said(SLAVE, 1_000, "03 12 21 05 01 14 83 01 03 e8 03 01 01 01 03 52 cc 00",
         (MessageAcknowledged(1), MessageReceived(APPLIED)), (APPLIED,)),
    # 10 ms later, alone.
    Said(MASTER, 11_000, "08 13 12 01 01 04 b6 31 00", (MessageAcknowledged(1),)),
    # A report that is lost, and a message behind it: the master sees a gap and says so (flag 0x20).
    Said(SLAVE, 20_000, "0c 12 21 01 01 14 81 df 03 80 84 1e 01 01 02 01 04 e8 03 14 07 d8 ff aa 07"
                        "51 49 01 09 c4 09 e8 1c 4a 01 66 08 01 03 50 80 00", None, (REPORT,)),
    Said(SLAVE, 21_000, "08 12 21 02 01 14 85 07 03 13 3e 00", (), (Pong(7),)),
    Said(MASTER, 21_000, "08 13 12 01 01 24 92 53 00"),
    # The slave goes back at once.
    Said(SLAVE, 22_000, "0c 12 21 01 01 14 81 df 03 80 84 1e 01 01 02 01 04 e8 03 14 07 d8 ff aa 07"
                        "51 49 01 09 c4 09 e8 1c 4a 01 66 08 01 03 50 80 00"
                        "08 12 21 02 01 14 85 07 03 13 3e 00",
         (MessageReceived(REPORT), MessageReceived(Pong(7)))),
    # Half a window: acknowledged at once.
    Said(MASTER, 22_000, "08 13 12 01 03 04 d0 53 00",
         (MessageAcknowledged(2), MessageAcknowledged(3))),
    # A Ping that is lost, and again after 60 ms.
    Said(MASTER, 30_000, "08 12 12 01 03 04 03 08 03 9a 31 00", None, (Ping(8),)),
    Said(MASTER, 90_000, "08 12 12 01 03 04 03 08 03 9a 31 00", (MessageReceived(Ping(8)),)),
    Said(SLAVE, 100_000, "08 13 21 03 02 14 28 06 00", (MessageAcknowledged(2),)),
    # The slave resets: a new epoch; the master asks whether it is alive before it believes.
    Said(SLAVE, 200_000, "03 11 30 01 04 54 03 02 01 01 01 03 aa 2d 00",
         send=(RESET,), boot=0x0203),
    Said(MASTER, 200_000, "03 11 13 01 07 44 01 01 02 03 02 03 a2 5c 00", (LinkUp(0x0101),)),
    Said(SLAVE, 200_000, "03 11 31 01 0a 14 03 02 01 01 01 02 4a 73 00"
                         "03 12 31 01 04 14 84 05 01 01 01 01 03 01 03 03 ca e2 00",
         (PeerReset(0x0203, 0x0202, 0), MessageReceived(RESET))),
    Said(MASTER, 210_000, "03 13 13 05 01 04 f7 b5 00", (MessageAcknowledged(1),)),
)
# fmt: on


@pytest.fixture(params=["Python and Python", "Python and C", "C and Python", "C and C"])
def makers(request):
    def maker(language):
        return Link if language == "Python" else request.getfixturevalue("new_c_link")

    return [maker(language) for language in request.param.split(" and ")]


def test_word_for_word(makers):
    config = LinkConfig()
    epochs = {MASTER: 0x0101, SLAVE: 0x0202}
    make = dict(zip((MASTER, SLAVE), makers, strict=True))
    links = {side: make[side](Role(side), epochs[side], config) for side in (MASTER, SLAVE)}
    for said in CONVERSATION:
        if said.boot:
            links[said.by] = make[said.by](Role(said.by), said.boot, config)
        speaker = links[said.by]
        listener = links[SLAVE if said.by == MASTER else MASTER]
        for message in said.send:
            speaker.send(message)
        speaker.handle_timer(said.now_us)
        wire = speaker.data_to_send(said.now_us)
        assert wire.hex(" ") == bytes.fromhex(said.wire).hex(" "), said
        if said.heard is not None:
            assert tuple(listener.receive(wire, said.now_us)) == said.heard
    assert not any(link.wants_to_send or link.queued for link in links.values())


def test_the_checks_in_it_are_those_of_another_implementation():
    """Stuffing undone by hand and the CRC by Python's own code, so that no literal is our echo."""
    count = 0
    for said in CONVERSATION:
        for block in bytes.fromhex(said.wire).split(b"\0")[:-1]:
            frame = bytearray(block)
            at = 0
            while at < len(block):
                frame[at], at = 0, at + block[at]
            body, crc = bytes(frame[1:-2]), int.from_bytes(frame[-2:], "big")
            assert binascii.crc_hqx(body, 0xFFFF) ^ 0xFFFF == crc
            assert [Frame.parse(body)] == [
                Frame.parse(found) for found in Decoder().receive(block + b"\0")
            ]
            count += 1
    assert count == 20
