"""ISO-TP against the standard's frames and time-outs, and against the can-isotp package."""

from __future__ import annotations

from random import Random

import isotp
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spi_bus.transports.isotp import (
    CAN_LENGTHS,
    IsoTp,
    IsoTpConfig,
    Payload,
    ReceiveFailed,
    Result,
    SendFailed,
    Sent,
    separation_us,
)

FD = IsoTpConfig(frame_bytes=64)


def frame(text: str, size: int = 8) -> bytes:
    """A data field from hexadecimal, filled up with 0xCC."""
    return bytes.fromhex(text).ljust(size, b"\xcc")


def all_frames(end: IsoTp, now_us: int = 0) -> list[bytes]:
    found = []
    while data := end.next_frame(now_us)[0]:
        found.append(data)
    return found


def exchange(one: IsoTp, other: IsoTp, now_us: int = 0) -> list[object]:
    """Carry frames both ways until both are silent; time goes on where a separation asks for it."""
    events: list[object] = []
    while True:
        moved = False
        for source, sink in ((one, other), (other, one)):
            data, said = source.next_frame(now_us)
            events += said
            if data:
                moved = True
                events += sink.receive(data, now_us)
        if not moved:
            if not (one.sending or other.sending):
                return events
            now_us += 100
            assert now_us < 60_000_000


def test_single_frames_are_those_of_the_standard() -> None:
    end = IsoTp()
    end.send(b"\x3e\x00")
    assert end.next_frame(0) == (frame("02 3e 00"), [Sent()])
    end.send(bytes(7))
    assert end.next_frame(0)[0] == frame("07 00 00 00 00 00 00 00")
    unpadded = IsoTp(IsoTpConfig(padding=None))
    unpadded.send(b"\x3e\x00")
    assert unpadded.next_frame(0)[0] == bytes.fromhex("02 3e 00")
    wide = IsoTp(FD)
    wide.send(bytes(range(1, 9)))  # 8 bytes: the form with two header bytes, length 12
    assert wide.next_frame(0)[0] == frame("00 08 01 02 03 04 05 06 07 08", 12)
    wide.send(bytes(62))
    assert wide.next_frame(0) == (b"\x00\x3e" + bytes(62), [Sent()])
    wide.send(b"\x11")
    assert wide.next_frame(0)[0] == frame("01 11")


def test_a_segmented_payload_is_that_of_the_standard() -> None:
    """A vehicle identification number: 20 bytes, the conversation that every introduction shows."""
    answer = bytes.fromhex("49 02 01") + b"1G1JC5444R7252367"
    tester, vehicle = IsoTp(IsoTpConfig(block_size=0)), IsoTp()
    vehicle.send(answer)
    assert all_frames(vehicle) == [frame("10 14 49 02 01 31 47 31")]
    assert tester.receive(frame("10 14 49 02 01 31 47 31"), 0) == []
    assert all_frames(tester) == [frame("30 00 00")]
    assert vehicle.receive(frame("30 00 00"), 0) == []
    assert vehicle.next_frame(0) == (frame("21 4a 43 35 34 34 34 52"), [])
    assert vehicle.next_frame(0) == (frame("22 37 32 35 32 33 36 37"), [Sent()])
    assert tester.receive(frame("21 4a 43 35 34 34 34 52"), 0) == []
    assert tester.receive(frame("22 37 32 35 32 33 36 37"), 0) == [Payload(answer)]


def test_a_long_payload_has_a_32_bit_length_and_sequence_numbers_wrap() -> None:
    end = IsoTp()
    end.send(bytes(4096))
    assert all_frames(end) == [bytes.fromhex("10 00 00 00 10 00 00 00")]
    end.receive(frame("30 00 00"), 0)
    numbers = [data[0] for data in all_frames(end)]
    assert numbers[:17] == [0x20 | n % 16 for n in range(1, 18)]
    assert len(numbers) == (4096 - 2 + 6) // 7


def test_block_size_and_separation_are_obeyed() -> None:
    end = IsoTp()
    end.send(bytes(6 + 7 * 5))
    end.next_frame(0)
    end.receive(frame("30 02 f3"), 1_000)  # two frames, 300 µs apart
    assert end.next_frame(1_000)[0][0] == 0x21
    assert end.next_frame(1_299)[0] == b""
    assert end.next_deadline_us() == 1_300
    assert end.next_frame(1_300)[0][0] == 0x22
    assert end.next_frame(900_000)[0] == b"", "went on without flow control"
    assert end.next_deadline_us() == 1_300 + 1_000_000
    end.receive(frame("31 00 00"), 900_000)  # wait: the time-out begins anew
    assert end.next_deadline_us() == 1_900_000
    end.receive(frame("30 00 00"), 1_800_000)
    assert [data[0] for data in all_frames(end, 1_800_000)] == [0x23, 0x24, 0x25]
    assert not end.sending


@pytest.mark.parametrize(
    ("code", "time_us"),
    [
        (0, 0),
        (1, 1_000),
        (0x7F, 127_000),
        (0xF1, 100),
        (0xF9, 900),
        (0x80, 127_000),
        (0xFA, 127_000),
    ],
)
def test_separation_codes(code: int, time_us: int) -> None:
    assert separation_us(code) == time_us


@pytest.mark.parametrize(
    ("flow", "result"),
    [("32 00 00", Result.OVERFLOW), ("33 00 00", Result.INVALID_FS)],
)
def test_flow_control_ends_a_transfer(flow: str, result: Result) -> None:
    end = IsoTp()
    end.send(bytes(20))
    end.next_frame(0)
    assert end.receive(frame(flow), 0) == [SendFailed(result)]
    assert not end.sending
    end.send(b"next")
    assert end.next_frame(0)[1] == [Sent()]


def test_time_outs_are_those_of_table_16() -> None:
    sender = IsoTp()
    sender.send(bytes(20))
    sender.next_frame(500)
    assert sender.handle_timer(1_000_499) == []
    assert sender.handle_timer(1_000_500) == [SendFailed(Result.TIMEOUT_BS)]
    receiver = IsoTp()
    receiver.receive(frame("10 14 49 02 01 31 47 31"), 500)
    assert receiver.next_deadline_us() == 1_000_500
    receiver.receive(frame("21 4a 43 35 34 34 34 52"), 700_000)
    assert receiver.handle_timer(1_699_999) == []
    assert receiver.handle_timer(1_700_000) == [ReceiveFailed(Result.TIMEOUT_CR)]
    assert receiver.receive(frame("22 37 32 35 32 33 36 37"), 1_700_000) == []
    assert receiver.next_deadline_us() is None


def test_a_receiver_that_says_wait_for_ever_is_given_up() -> None:
    end = IsoTp(IsoTpConfig(waits=2))
    end.send(bytes(20))
    end.next_frame(0)
    assert [end.receive(frame("31 00 00"), now_us) for now_us in (1, 2)] == [[], []]
    assert end.receive(frame("31 00 00"), 3) == [SendFailed(Result.WFT_OVERRUN)]


@pytest.mark.parametrize("number", [0x22, 0x20, 0x2F])
def test_a_wrong_sequence_number_ends_a_reception(number: int) -> None:
    end = IsoTp()
    end.receive(frame("10 14 49 02 01 31 47 31"), 0)
    wrong = bytes((number,)) + bytes(7)
    assert end.receive(wrong, 0) == [ReceiveFailed(Result.WRONG_SN)]
    assert end.receive(frame("21 4a 43 35 34 34 34 52"), 0) == []


def test_a_new_payload_takes_the_place_of_one_under_way() -> None:
    end = IsoTp()
    end.receive(frame("10 14 49 02 01 31 47 31"), 0)
    assert end.receive(frame("02 3e 00"), 0) == [
        ReceiveFailed(Result.UNEXPECTED),
        Payload(b"\x3e\x00"),
    ]
    end.receive(frame("10 14 49 02 01 31 47 31"), 0)
    assert end.receive(frame("10 08 01 02 03 04 05 06"), 0) == [ReceiveFailed(Result.UNEXPECTED)]
    assert end.receive(frame("21 07 08"), 0) == [Payload(bytes(range(1, 9)))]


def test_too_long_a_payload_is_answered_with_overflow() -> None:
    end = IsoTp(IsoTpConfig(receive_limit=100))
    assert end.receive(frame("10 65 00 00 00 00 00 00"), 0) == [ReceiveFailed(Result.OVERFLOW)]
    assert all_frames(end) == [frame("32 00 00")]


@pytest.mark.parametrize(
    "text",
    [
        "",
        "00 00",  # a single frame without length
        "08 00 00 00 00 00 00 00",  # longer than it can be
        "05 01 02",  # shorter than it says
        "10 07 00 00 00 00 00 00",  # a first frame of what fits a single one
        "10 14 00",  # a first frame that is not full
        "10 00 00 00 0f ff 00 00",  # the long form for a short length
        "40 00 00",  # reserved
        "00 05 01 02 03 04 05 00 00 00 00 00",  # the long single form for a short one
    ],
)
def test_what_is_no_frame_is_said_to_be_none(text: str) -> None:
    end = IsoTp()
    assert end.receive(bytes.fromhex(text), 0) == [ReceiveFailed(Result.ERROR)]
    assert end.next_deadline_us() is None
    assert all_frames(end) == []


def test_configurations_that_cannot_be_are_refused() -> None:
    for wrong in (
        {"frame_bytes": 9},
        {"frame_bytes": 7},
        {"block_size": 256},
        {"padding": 256},
        {"separation_us": 50},
        {"separation_us": 128_000},
    ):
        with pytest.raises(ValueError, match=r"=|STmin"):
            IsoTpConfig(**wrong)
    end = IsoTp()
    with pytest.raises(ValueError, match="empty"):
        end.send(b"")
    end.send(bytes(9))
    with pytest.raises(ValueError, match="under way"):
        end.send(b"x")


@given(data=st.lists(st.binary(max_size=64), max_size=20), now=st.integers(0, 10**7))
def test_no_data_field_raises(data: list[bytes], now: int) -> None:
    end = IsoTp(FD)
    end.send(bytes(200))
    end.next_frame(now)
    for step, field in enumerate(data):
        end.receive(field, now + step)
        all_frames(end, now + step)
        end.handle_timer(now + step)


@given(
    payload=st.binary(min_size=1, max_size=700),
    sizes=st.tuples(st.sampled_from(CAN_LENGTHS[8:]), st.sampled_from(CAN_LENGTHS[8:])),
    block=st.integers(0, 5),
    separation=st.sampled_from([0, 100, 900, 1_000, 5_000]),
    padding=st.sampled_from([None, 0xCC, 0]),
)
def test_every_payload_arrives_whatever_the_two_ends_are_set_to(
    payload: bytes, sizes: tuple[int, int], block: int, separation: int, padding: int | None
) -> None:
    one, other = (
        IsoTp(IsoTpConfig(size, block, separation, padding, flow_timeout_us=10_000_000))
        for size in sizes
    )
    one.send(payload)
    other.send(payload[::-1])
    events = exchange(one, other)
    arrived = [event.data for event in events if isinstance(event, Payload)]
    assert sorted(arrived) == sorted([payload, payload[::-1]])
    assert events.count(Sent()) == 2
    assert len(events) == 4


class Oracle:
    """The can-isotp package with its bus replaced by two lists."""

    def __init__(self, **parameters: object) -> None:
        self.to_it: list[bytes] = []
        self.from_it: list[bytes] = []
        address = isotp.Address(isotp.AddressingMode.Normal_11bits, txid=0x201, rxid=0x101)

        def receive(timeout: float) -> isotp.CanMessage | None:
            del timeout
            data = self.to_it.pop(0) if self.to_it else None
            return None if data is None else isotp.CanMessage(arbitration_id=0x101, data=data)

        self.layer = isotp.TransportLayerLogic(
            receive,
            lambda message: self.from_it.append(bytes(message.data)),
            address,
            params={"blocking_send": False, **parameters},
        )


@pytest.mark.parametrize("size", [8, 64])
@pytest.mark.parametrize("block", [0, 3])
def test_it_understands_can_isotp_and_is_understood(size: int, block: int) -> None:
    rng = Random(size + block)
    oracle = Oracle(tx_data_length=size, can_fd=size > 8, blocksize=block, tx_padding=0xCC, stmin=0)
    ours = IsoTp(IsoTpConfig(frame_bytes=size, block_size=block))
    for length in (1, 6, 7, 8, 9, 61, 62, 63, 100, 255, 256, 1_000, 4_095):
        to_it, from_it = rng.randbytes(length), rng.randbytes(length)
        ours.send(to_it)
        oracle.layer.send(from_it)
        got: list[bytes] = []
        for _ in range(20_000):
            oracle.to_it += all_frames(ours)
            oracle.layer.process()
            sent, oracle.from_it[:] = list(oracle.from_it), []
            for data in sent:
                got += [e.data for e in ours.receive(data, 0) if isinstance(e, Payload)]
            if oracle.layer.available() and got:
                break
        assert bytes(oracle.layer.recv() or b"") == to_it, length
        assert got == [from_it], length
