"""CC2420s exchanging frames: timing of every pin, acknowledgement, filtering, FIFOs, CCA."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from firmware_model.time import FS_PER_US
from radio_802154 import cc2420_registers as r
from radio_802154 import mac, tinyos
from radio_802154.cc2420_registers import State
from radio_802154.fcs import append_fcs, fcs_ok
from radio_802154.mac import Address, AddressingMode
from radio_802154.tinyos import AmPacket

MESSAGE = tinyos.encode(AmPacket(destination=2, source=1, am_type=6, payload=b"hello", sequence=9))
AIRTIME_US = (6 + len(MESSAGE) + 2) * 32


def edges_us(world: Any, signal: Any) -> list[tuple[float, int]]:
    """Times and levels of a pin from now on, in µs from now."""
    seen: list[tuple[float, int]] = []
    origin = world.scheduler.now
    signal.watch(lambda level: seen.append(((world.scheduler.now - origin) / FS_PER_US, level)))
    return seen


def test_a_frame_arrives_with_rssi_and_crc(world: Any) -> None:
    a, b = world.chip("a"), world.chip("b", 1.0)
    a.load(MESSAGE)
    a.strobe(r.STXON)
    world.run_us(192 + AIRTIME_US)
    assert b.take(1)[0] == len(MESSAGE) + 2
    got = b.take(len(MESSAGE) + 2)
    assert got[:-2] == MESSAGE
    assert got[-2] - 45 == -40  # 40.2 dB at 1 m, P = RSSI_VAL − 45 dBm
    assert got[-1] == r.CRC_OK | 110
    assert b.chip.fifo.value == 0


def test_pins_of_transmitter_and_receiver(world: Any) -> None:
    """12 symbols to the preamble, 5 octets to the end of the SFD, 32 µs an octet (section 14)."""
    a, b = world.chip("a"), world.chip("b", 1.0)
    a.load(MESSAGE)
    sfd_a = edges_us(world, a.chip.sfd)
    sfd_b = edges_us(world, b.chip.sfd)
    fifo_b = edges_us(world, b.chip.fifo)
    fifop_b = edges_us(world, b.chip.fifop)
    a.strobe(r.STXON)
    assert a.chip.state is State.TX_CALIBRATE
    world.run_us(192)
    assert a.chip.state is State.TX_PREAMBLE
    world.run_us(AIRTIME_US + 400)
    up, down = 192 + 160, 192 + AIRTIME_US
    assert sfd_a == sfd_b == [(up, 1), (down, 0)]
    assert fifo_b == [(up + 32, 1)]
    assert fifop_b == [(down, 1)]


@pytest.mark.parametrize(("txctrl", "delay_us"), [(0xA0FF, 192), (0x80FF, 128)])
def test_turnaround_is_12_or_8_symbols(world: Any, txctrl: int, delay_us: int) -> None:
    a = world.chip("a")
    a.write(r.TXCTRL, txctrl)
    a.load(MESSAGE)
    sfd = edges_us(world, a.chip.sfd)
    a.strobe(r.STXON)
    world.run_us(2000)
    assert sfd[0] == (delay_us + 160, 1)


def test_acknowledgement_192_us_after_the_frame_exactly(world: Any) -> None:
    a, b = world.chip("a", address=1), world.chip("b", 1.0, address=2)
    a.load(MESSAGE)
    a.strobe(r.STXON)
    world.run_us(192 + AIRTIME_US + 192 + 352)
    (data_end, (_, channel, source, power, octets)), (_, ack) = world.air()
    assert (channel, source, power) == (11, "a", 0.0)
    assert octets == append_fcs(MESSAGE)
    assert ack[0] - data_end == 192 * FS_PER_US
    assert ack[2] == "b"
    assert ack[4] == append_fcs(mac.encode(mac.ack_frame(9)))
    assert a.take_frame()[:3] == ack[4][:3]  # acknowledgements pass address recognition
    assert b.take_frame()[:-2] == MESSAGE


def test_what_is_not_acknowledged(world: Any) -> None:
    """Without request, for others, damaged, or with AUTOACK off."""
    a = world.chip("a", address=1)
    world.chip("b", 1.0, address=2)
    world.chip("c", 1.0, address=3, autoack=False)

    def replies(packet: AmPacket) -> list[str]:
        before = len(world.air())
        a.load(tinyos.encode(packet))
        a.strobe(r.STXON)
        world.run_us(5000)
        return [record[1][2] for record in world.air()[before + 1 :]]

    assert replies(AmPacket(2, 1, 6, b"")) == ["b"]
    assert replies(AmPacket(2, 1, 6, b"", ack_request=False)) == []
    assert replies(AmPacket(3, 1, 6, b"")) == []
    assert replies(AmPacket(4, 1, 6, b"")) == []
    assert replies(AmPacket(2, 1, 6, b"", pan_id=0x23)) == []
    assert replies(AmPacket(0xFFFF, 1, 6, b"")) == []


def test_no_acknowledgement_of_a_frame_with_a_wrong_fcs(world: Any) -> None:
    a, b = world.chip("a", address=1), world.chip("b", 1.0, address=2)
    a.write(r.MDMCTRL0, 0x0AE2 & ~r.MDMCTRL0_AUTOCRC)  # the host writes the FCS
    a.transfer(r.TXFIFO, len(MESSAGE) + 2, *MESSAGE, 0, 0)
    a.strobe(r.STXON)
    world.run_us(5000)
    assert len(world.air()) == 1
    assert not b.take_frame()[-1] & r.CRC_OK


def test_pending_bit_of_acknowledgements(world: Any) -> None:
    """SACKPEND sets it for automatic acknowledgements until SACK (section 19)."""
    a, b = world.chip("a", address=1), world.chip("b", 1.0, address=2)
    controls = []
    for strobe in (r.SACKPEND, r.SNOP, r.SACK):
        b.strobe(strobe)
        a.load(MESSAGE)
        a.strobe(r.STXON)
        world.run_us(5000)
        controls.append(world.air()[-1][1][4][0])
    assert controls == [0x12, 0x12, 0x02]


def test_manual_acknowledgement_strobed_during_the_frame(world: Any) -> None:
    a, b = world.chip("a", address=1), world.chip("b", 1.0, address=2, autoack=False)
    a.load(MESSAGE)
    a.strobe(r.STXON)
    world.run_us(192 + AIRTIME_US - 100)
    assert b.chip.state is State.RX_FRAME
    b.strobe(r.SACK)
    world.run_us(5000)
    (end, _), (_, ack) = world.air()
    assert ack[0] - end == 192 * FS_PER_US
    assert ack[2] == "b"


EXTENDED = 0x0012_4B00_0000_00_02


def extended(pan_id: int, value: int) -> Address:
    return Address(pan_id, value, AddressingMode.EXTENDED)


def data(destination: Address | None, source: Address | None) -> mac.Frame:
    return mac.data_frame(1, destination, source, b"x")


@pytest.mark.parametrize(
    ("frame", "ours", "coordinator"),
    [  # clause 7.5.6.2; ours: kept by an ordinary device, coordinator: by the PAN coordinator
        (data(Address(0x22, 2), Address(0x22, 1)), True, True),
        (data(Address(0x22, 3), Address(0x22, 1)), False, False),
        (data(Address(0x23, 2), Address(0x23, 1)), False, False),
        (data(Address(0x22, 0xFFFF), Address(0x22, 1)), True, True),
        (data(Address(0xFFFF, 0xFFFF), Address(0x99, 1)), True, True),
        (data(Address(0xFFFF, 2), Address(0x99, 1)), True, True),
        (data(Address(0xFFFF, 3), Address(0x99, 1)), False, False),
        (data(extended(0x22, EXTENDED), Address(0x22, 1)), True, True),
        (data(extended(0x22, EXTENDED + 1), Address(0x22, 1)), False, False),
        (data(extended(0x22, EXTENDED), extended(0x99, 77)), True, True),
        (data(Address(0x22, 2), None), True, True),
        (data(None, Address(0x22, 1)), False, True),
        (data(None, Address(0x23, 1)), False, False),
        (mac.ack_frame(1), True, True),
        (mac.Frame(mac.FrameType.BEACON, 1, None, Address(0x22, 1), bytes(4)), True, True),
        (mac.Frame(mac.FrameType.BEACON, 1, None, Address(0x23, 1), bytes(4)), False, False),
        (mac.Frame(mac.FrameType.COMMAND, 1, Address(0x22, 2), None, b"\x07"), True, True),
        (mac.Frame(mac.FrameType.COMMAND, 1, None, Address(0x22, 5), b"\x04"), False, True),
    ],
)
def test_address_recognition(world: Any, frame: mac.Frame, ours: bool, coordinator: bool) -> None:
    a = world.chip("a")
    b, c = world.chip("b", 1.0, address=2), world.chip("c", 1.0, address=2)
    c.write(r.MDMCTRL0, 0x0AE2 | r.MDMCTRL0_PAN_COORDINATOR)
    for host in (b, c):
        host.write_ram(r.RAM_IEEEADR, EXTENDED.to_bytes(8, "little"))
    a.load(mac.encode(frame))
    a.strobe(r.STXON)
    world.run_us(6000)
    assert (b.chip.fifop.value, c.chip.fifop.value) == (ours, coordinator)
    assert (b.chip.fifo.value, c.chip.fifo.value) == (ours, coordinator)


def test_reserved_frame_types_and_foreign_beacons_by_their_bits(world: Any) -> None:
    a, b = world.chip("a"), world.chip("b", 1.0, address=2)

    def kept(content: bytes) -> bool:
        a.load(content)
        a.strobe(r.STXON)
        world.run_us(6000)
        level = bool(b.chip.fifop.value)
        b.strobe(r.SFLUSHRX)
        return level

    reserved = b"\x05\x00\x01abc"
    beacon = mac.encode(mac.Frame(mac.FrameType.BEACON, 1, None, Address(0x23, 1), bytes(4)))
    assert not kept(reserved)
    assert not kept(beacon)
    b.write(r.MDMCTRL0, 0x0AE2 | r.MDMCTRL0_RESERVED_FRAME_MODE)
    b.write(r.IOCFG0, 127 | r.IOCFG0_BCN_ACCEPT)
    assert kept(reserved)
    assert kept(beacon)


def test_a_rejected_frame_lowers_sfd_at_once_and_leaves_earlier_frames(world: Any) -> None:
    a, b = world.chip("a"), world.chip("b", 1.0, address=2)
    a.load(tinyos.encode(AmPacket(2, 1, 6, b"keep", ack_request=False)))
    a.strobe(r.STXON)
    world.run_us(3000)
    a.load(tinyos.encode(AmPacket(3, 1, 6, bytes(60), ack_request=False)))
    sfd = edges_us(world, b.chip.sfd)
    a.strobe(r.STXON)
    world.run_us(5000)
    up = 192 + 160
    assert sfd == [(up, 1), (up + 32 * (1 + 9), 0)]  # nine octets of header after the length
    assert b.take_frame()[:-2].endswith(b"keep")
    assert b.chip.fifo.value == 0


def test_octets_can_be_read_while_the_frame_arrives(world: Any) -> None:
    a, b = world.chip("a"), world.chip("b", 1.0)
    a.load(MESSAGE)
    a.strobe(r.STXON)
    world.run_us(192 + 160 + 32 * 4)  # length and three octets
    assert b.take(4) == bytes((len(MESSAGE) + 2,)) + MESSAGE[:3]
    assert b.chip.fifo.value == 0
    b.take(1)  # no more there: nothing is lost
    world.run_us(32)
    assert b.chip.fifo.value == 1
    world.run_us(32)
    assert b.take(2) == MESSAGE[3:5]
    world.run_us(5000)
    rest = b.take(len(MESSAGE) - 5 + 2)
    assert rest[:-2] == MESSAGE[5:]
    assert rest[-1] & r.CRC_OK
    assert b.chip.fifo.value == 0


def test_fifop_rises_when_the_threshold_is_exceeded(world: Any) -> None:
    """Number of unread octets exceeds FIFOP_THR (section 14.2)."""
    a, b = world.chip("a"), world.chip("b", 1.0)
    b.write(r.IOCFG0, 9)
    a.load(MESSAGE)
    fifop = edges_us(world, b.chip.fifop)
    a.strobe(r.STXON)
    world.run_us(192 + 160 + 32 * 10)
    assert fifop == [(192 + 160 + 32 * 10, 1)]
    b.take(1)
    assert b.chip.fifop.value == 0
    world.run_us(32)
    assert b.chip.fifop.value == 1


def test_fifop_waits_for_address_recognition(world: Any) -> None:
    a, b = world.chip("a"), world.chip("b", 1.0, address=2)
    b.write(r.IOCFG0, 3)
    a.load(MESSAGE)
    fifop = edges_us(world, b.chip.fifop)
    a.strobe(r.STXON)
    world.run_us(4000)
    assert fifop[0] == (192 + 160 + 32 * 10, 1)


def test_fifop_with_two_frames_waiting(world: Any) -> None:
    a, b = world.chip("a"), world.chip("b", 1.0)
    for _ in range(2):
        a.load(MESSAGE)
        a.strobe(r.STXON)
        world.run_us(4000)
    assert b.chip.fifop.value == 1
    b.take(1)
    assert b.chip.fifop.value == 0
    b.take(len(MESSAGE) + 2)
    assert b.chip.fifop.value == 1  # the second frame is complete
    assert b.take_frame()[:-2] == MESSAGE
    assert (b.chip.fifo.value, b.chip.fifop.value) == (0, 0)


def test_rxfifo_overflow_and_recovery(world: Any) -> None:
    """FIFO low while FIFOP high; stored octets stay readable; SFLUSHRX restarts (section 14.3)."""
    a, b = world.chip("a"), world.chip("b", 1.0)
    content = MESSAGE + bytes(50)
    for _ in range(2):
        a.load(content)
        a.strobe(r.STXON)
        world.run_us(6000)
    assert b.chip.state is State.RX_OVERFLOW
    assert (b.chip.fifo.value, b.chip.fifop.value) == (0, 1)
    assert b.take_frame()[:-2] == content
    a.strobe(r.STXON)  # the TXFIFO holds the last frame: sent again, and not heard
    world.run_us(6000)
    assert b.chip.state is State.RX_OVERFLOW
    b.strobe(r.SFLUSHRX)
    b.strobe(r.SFLUSHRX)
    assert (b.chip.fifo.value, b.chip.fifop.value) == (0, 0)
    a.strobe(r.STXON)
    world.run_us(6000)
    assert b.take_frame()[:-2] == content


def test_reading_in_time_prevents_the_overflow(world: Any) -> None:
    a, b = world.chip("a"), world.chip("b", 1.0)
    content = MESSAGE + bytes(50)
    a.load(content)
    a.strobe(r.STXON)
    world.run_us(6000)
    a.strobe(r.STXON)
    world.run_us(1000)
    first = b.take_frame()
    world.run_us(5000)
    assert first[:-2] == b.take_frame()[:-2] == content
    assert b.chip.state is State.RX_SFD_SEARCH


def test_longest_frame_fills_the_rxfifo_without_overflow(world: Any) -> None:
    a, b = world.chip("a"), world.chip("b", 1.0)
    content = bytes(range(125))
    a.load(content)
    a.strobe(r.STXON)
    world.run_us(6000)
    assert b.chip.state is State.RX_SFD_SEARCH
    assert b.take_frame()[:-2] == content


def test_txfifo_underflow(world: Any) -> None:
    a, b = world.chip("a"), world.chip("b", 1.0)
    a.transfer(r.TXFIFO, 20, *MESSAGE[:4])
    a.strobe(r.STXON)
    world.run_us(192 + 160 + 32 * 5 - 1)
    assert not a.status() & r.STATUS_TX_UNDERFLOW
    world.run_us(1)
    assert a.status() & r.STATUS_TX_UNDERFLOW
    assert a.chip.state is State.TX_UNDERFLOW
    assert a.chip.sfd.value == 0
    world.run_us(5000)
    assert world.air() == []
    assert not b.take_frame()[-1] & r.CRC_OK  # 18 octets of which four were sent
    a.strobe(r.SFLUSHTX)
    assert not a.status() & r.STATUS_TX_UNDERFLOW
    a.load(MESSAGE)
    a.strobe(r.STXON)
    world.run_us(5000)
    assert b.take_frame()[:-2] == MESSAGE


def test_octets_written_just_in_time(world: Any) -> None:
    a, b = world.chip("a"), world.chip("b", 1.0)
    a.transfer(r.TXFIFO, len(MESSAGE) + 2)
    a.strobe(r.STXON)
    world.run_us(192 + 160)
    for octet in MESSAGE:
        a.transfer(r.TXFIFO, octet)
        world.run_us(32)
    world.run_us(500)
    assert b.take_frame()[:-2] == MESSAGE


def test_ram_written_during_the_frame_changes_only_what_is_still_to_come(world: Any) -> None:
    """What TinyOS does to stamp a time into a frame after its SFD."""
    a, b = world.chip("a"), world.chip("b", 1.0)
    a.load(bytes(20))
    a.strobe(r.STXON)
    world.run_us(192 + 160 + 32 * 5)  # length and four octets are out, the fifth is going out
    a.write_ram(r.RAM_TXFIFO + 1, b"\xff" * 20)
    world.run_us(3000)
    got = b.take_frame()
    assert got[:-2] == bytes(5) + b"\xff" * 15
    assert got[-1] & r.CRC_OK
    assert fcs_ok(world.air()[0][1][4])


def test_a_second_write_after_sending_starts_a_new_frame(world: Any) -> None:
    a, b = world.chip("a"), world.chip("b", 1.0)
    for content in (MESSAGE, MESSAGE[::-1]):
        a.load(content)
        a.strobe(r.STXON)
        world.run_us(4000)
        assert b.take_frame()[:-2] == content


def test_receiver_is_deaf_while_it_sends_calibrates_or_listens_elsewhere(world: Any) -> None:
    a, b = world.chip("a"), world.chip("b", 1.0)
    c, d = world.chip("c", 1.0, listening=False), world.chip("d", 1.0, listening=False)
    d.write(r.FSCTRL, 0x4165 + 5)
    d.strobe(r.SRXON)
    b.load(bytes(100))
    a.load(MESSAGE)
    a.strobe(r.STXON)
    world.run_us(192 + 70)
    c.strobe(r.SRXON)  # 90 µs before the end of the SFD, and calibration takes 192
    b.strobe(r.STXON)
    world.run_us(8000)
    assert [host.chip.fifop.value for host in (b, c, d)] == [0, 1, 0]
    assert c.take_frame()[:-2] == bytes(100)  # of b, whose preamble came later
    assert c.chip.fifo.value == 0


def test_cca_by_energy_and_by_carrier(world: Any) -> None:
    a, b = world.chip("a"), world.chip("b", 1.0)
    far = world.chip("far", 400.0)  # −114 dBm: below the noise
    a.load(bytes(60))
    assert b.chip.cca.value == 1
    a.strobe(r.STXON)
    world.run_us(192)
    assert b.chip.cca.value == 1
    world.run_us(128)  # eight symbols of preamble
    assert b.chip.cca.value == 0
    assert far.chip.cca.value == 1
    assert b.read(r.RSSI) & 0xFF == (-40 + 45) & 0xFF
    world.run_us(1000)
    # carrier sense alone (mode 2) and energy alone (mode 1) with a threshold above the signal
    b.write(r.MDMCTRL0, 0x02A2)
    assert b.chip.cca.value == 0
    b.write(r.RSSI, 0x1000)
    b.write(r.MDMCTRL0, 0x0262)
    assert b.chip.cca.value == 1


@pytest.mark.parametrize(("elapsed_us", "dbm"), [(64, -43), (128, -40), (1000, -40)])
def test_rssi_is_a_mean_over_eight_symbols(world: Any, elapsed_us: int, dbm: int) -> None:
    a, b = world.chip("a"), world.chip("b", 1.0)
    a.load(bytes(60))
    a.strobe(r.STXON)
    world.run_us(192 + elapsed_us)
    assert (b.read(r.RSSI) & 0xFF) - 45 == dbm


def test_cca_hysteresis(make_world: Callable[..., Any]) -> None:
    """Busy at the threshold, clear only below threshold − hysteresis (MDMCTRL0.CCA_HYST)."""
    world = make_world()
    a, b = world.chip("a"), world.chip("b", 1.0)
    signal = -40 + 45
    b.write(r.RSSI, (signal + 2) << 8)
    b.write(r.MDMCTRL0, 0x0062 | 4 << 8)  # energy only, hysteresis 4 dB
    a.load(bytes(60))
    a.strobe(r.STXON)
    world.run_us(1000)

    def clear_with(threshold: int) -> int:
        b.write(r.RSSI, (threshold & 0xFF) << 8)
        return int(b.chip.cca.value)

    assert clear_with(signal + 2) == 1  # was clear, and is not above the threshold
    assert clear_with(signal) == 0
    assert clear_with(signal + 4) == 0  # within the hysteresis: stays
    assert clear_with(signal + 5) == 1
    assert clear_with(signal + 4) == 1


def test_stxoncca_obeys_the_channel(world: Any) -> None:
    a, b = world.chip("a"), world.chip("b", 1.0)
    a.load(bytes(60))
    b.load(MESSAGE)
    a.strobe(r.STXON)
    world.run_us(192 + 300)
    b.strobe(r.STXONCCA)
    assert not b.status() & r.STATUS_TX_ACTIVE
    world.run_us(4000)
    b.strobe(r.STXONCCA)
    assert b.status() & r.STATUS_TX_ACTIVE
    world.run_us(4000)
    assert [record[1][2] for record in world.air()] == ["a", "b"]


def test_stxoncca_needs_a_receiver_that_is_on_for_eight_symbols(world: Any) -> None:
    a = world.chip("a", listening=False)
    a.load(MESSAGE)
    a.strobe(r.STXONCCA)
    assert not a.status() & r.STATUS_TX_ACTIVE
    a.strobe(r.SRXON)
    world.run_us(192 + 127)
    a.strobe(r.STXONCCA)
    assert not a.status() & r.STATUS_TX_ACTIVE
    world.run_us(1)
    a.strobe(r.STXONCCA)
    assert a.status() & r.STATUS_TX_ACTIVE


def test_cut_off_in_the_middle_of_a_frame(world: Any) -> None:
    """SRFOFF while sending: listeners get noise for the rest, and no FCS fits."""
    a, b = world.chip("a"), world.chip("b", 1.0)
    a.load(bytes(range(40)))
    a.strobe(r.STXON)
    world.run_us(192 + 160 + 32 * 11)
    a.strobe(r.SRFOFF)
    world.run_us(4000)
    got = b.take_frame()
    assert got[:10] == bytes(range(10))
    assert not got[-1] & r.CRC_OK
    assert world.air() == []


def test_power_loss_in_the_middle_of_a_frame(world: Any) -> None:
    a, b = world.chip("a"), world.chip("b", 1.0, address=2)
    a.load(MESSAGE)
    a.strobe(r.STXON)
    world.run_us(192 + 300)
    b.chip.vreg_en(0)
    assert b.chip.sfd.value == 0
    world.run_us(5000)
    assert (b.chip.fifo.value, b.chip.fifop.value) == (0, 0)
    assert len(world.air()) == 1
