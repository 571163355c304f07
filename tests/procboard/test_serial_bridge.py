"""The emulated BaseStation at its UART, talked to by a host that shares no code with it.

The host below is written from TEP 113's text and RFC 1662, with the type numbers of motes; its CRC
is Python's own. Literal frames are those of real tools.
"""

import binascii
import struct

import pytest

from firmware_model.power import Rail
from firmware_model.scheduler import Scheduler
from firmware_model.time import FS_PER_S, FS_PER_US
from firmware_model.trace import Trace
from procboard.applications.serial_bridge import RADIO_QUEUE, SerialBridgeApp
from procboard.applications.services import Hooks, Services
from procboard.drivers.uart import divider
from procboard.errors import ProcConfigError
from procboard.firmware import FirmwareConfig, MoteFirmware
from procboard.network import NetworkConfig
from procboard.serial_base import SerialBaseStation
from procboard.telosb import TelosB
from radio_802154 import mac
from radio_802154.fcs import fcs_ok
from radio_802154.medium import Antenna, Medium

FRAME = bytes.fromhex("7e 44 26 00 ffff 0000 04 22 06 7d5e 7d5d 01 02 18 7b 7e")
"""Acknowledgement wanted, number 26, dispatch 0, AM 06 from 0 to all, group 22, 7e 7d 01 02."""
ACK_26 = bytes.fromhex("7e 43 26 3b 1c 7e")
CHARACTER_US = 10 / 115_200 * 1e6


class TosHost:
    """A TinyOS host in a few lines (TEP 113, section 3.4 ff.; RFC 1662, section 4)."""

    def __init__(self):
        self.partial = b""

    @staticmethod
    def frame(content):
        crc = binascii.crc_hqx(content, 0)
        octets = content + struct.pack("<H", crc)
        stuffed = octets.replace(b"}", b"}]").replace(b"~", b"}^")
        return b"~" + stuffed + b"~"

    def packet(self, number, destination, am_type, payload, source=0, group=0x22):
        header = struct.pack(">HHBBB", destination, source, len(payload), group, am_type)
        return self.frame(bytes((0x44, number, 0)) + header + payload)

    def packets(self, octets):
        """Contents of all intact frames."""
        *pieces, self.partial = (self.partial + octets).split(b"~")
        found = []
        for piece in filter(None, pieces):
            content = piece.replace(b"}^", b"~").replace(b"}]", b"}")
            assert binascii.crc_hqx(content[:-2], 0) == struct.unpack("<H", content[-2:])[0]
            found.append(content[:-2])
        return found


class Listener:
    """Another mote's application, which keeps what it hears."""

    def __init__(self):
        self.got = []

    def start(self, services):
        self.network = services.network
        services.network.on_any(self.take)

    def take(self, received):
        self.got.append(received)
        yield 10


class World:
    def __init__(self, *others, baud=115_200, **network):
        self.scheduler = Scheduler()
        trace = Trace()
        self.frames = []
        self.medium = Medium(self.scheduler, seed=1, channel=trace.channel("radio"))
        trace.channel("radio").sink(self.frames.extend)
        self.trace = trace
        self.said = bytearray()
        self.stamps = []
        self.medium.place("base", Antenna())
        self.rail = Rail(self.scheduler, "base", 3.0)
        self.base = SerialBaseStation(
            self.scheduler,
            trace,
            self.rail,
            self.medium,
            NetworkConfig(5, **network),
            self.take,
            baud=baud,
        )
        self.others = []
        for address in others:
            name = f"mote{address}"
            self.medium.place(name, Antenna())
            app = Listener()
            config = FirmwareConfig(NetworkConfig(address), with_robot=False)
            firmware = MoteFirmware(config, app, Hooks())
            TelosB(self.scheduler, Rail(self.scheduler, name, 3.0), self.medium, firmware, name, 1)
            self.others.append(app)
        self.run(0.1)

    def take(self, octet):
        self.said.append(octet)
        self.stamps.append(self.scheduler.now)

    def run(self, seconds):
        self.scheduler.run(self.scheduler.now + round(seconds * 1e6) * FS_PER_US)

    def heard(self):
        said = bytes(self.said)
        self.said.clear()
        return said

    def air(self):
        self.trace.flush()
        found = []
        for _end, (_start, _channel, source, _power, psdu) in self.frames:
            assert fcs_ok(psdu)
            found.append((source, psdu[:-2]))
        return found


def test_the_literal_packet_goes_on_the_air_and_is_acknowledged():
    world = World(1)
    world.base.usb.send(FRAME)
    world.run(0.05)
    assert world.heard() == ACK_26
    ((source, frame),) = world.air()
    assert source == "base"
    # FCF of a broadcast, DSN, PAN, to all, from this mote's own address, 3F, AM 6
    assert frame[:2] + frame[3:] == bytes.fromhex("4188 2200 ffff 0500 3f 06 7e7d0102")
    (got,) = world.others[0].got
    assert (got.source, got.am_type, got.payload) == (5, 6, bytes.fromhex("7e7d0102"))


def test_a_unicast_asks_for_an_acknowledgement_on_the_air():
    world = World(1)
    world.base.usb.send(TosHost().packet(9, 1, 0x10, b"swim"))
    world.run(0.05)
    (_, frame), (_, ack) = world.air()
    assert frame[:2] + frame[3:] == bytes.fromhex("6188 2200 0100 0500 3f 10") + b"swim"
    assert mac.acknowledges(mac.decode(ack), mac.decode(frame))
    assert TosHost().packets(world.heard()) == [bytes((0x43, 9))]
    counts = world.base.app.counts
    assert (counts.from_host, counts.on_air, counts.unanswered) == (1, 1, 0)


def test_what_the_radio_hears_goes_up_with_its_addresses():
    world = World(1)
    world.others[0].network.send(5, 0x21, b"~telemetry}")
    world.run(0.05)
    assert TosHost().packets(world.heard()) == [
        bytes.fromhex("45 00 0005 0001 0b 22 21") + b"~telemetry}"
    ]


def test_characters_are_a_115200th_of_a_second_a_bit():
    """From UxBR, UxMCTL and a DCO that is up to a modulator step slow, not from a constant."""
    assert divider(115_200) == (0x24, 0x4A)  # TinyOS: UBR_4MHZ_115200, UMCTL_4MHZ_115200
    assert divider(115_200, 2**20) == (0x09, 0x10)  # UBR_1MHZ_115200, UMCTL_1MHZ_115200
    world = World(1)
    world.others[0].network.send(5, 0x21, bytes(28))
    world.run(0.05)
    gaps = [b - a for a, b in zip(world.stamps, world.stamps[1:], strict=False)]
    assert len(gaps) == 40
    mean_us = sum(gaps) / len(gaps) / FS_PER_US
    assert mean_us == pytest.approx(CHARACTER_US, rel=0.01)
    baud_us = float(world.base.mote.mcu.usart1.bit_period_fs) * 10 / FS_PER_US
    assert max(gaps) / FS_PER_US < baud_us * 1.05  # without pauses: the interrupt keeps up


def test_the_other_direction_takes_as_long():
    world = World()
    begin = world.scheduler.now
    world.base.usb.send(FRAME)
    first = None
    while first is None:
        world.run(10e-6)
        if world.said:
            first = (world.stamps[0] - begin) / FS_PER_US
    # 18 characters in, half a stop bit less; the answer's first one out, to its middle of stop bit
    least = (len(FRAME) + 1 - 0.1) * CHARACTER_US
    assert least < first < least + 1_500  # and the firmware's time, which is not for nothing


def test_wrong_baud_is_no_packet_and_no_answer():
    world = World(baud=57_600)
    world.base.usb.send(FRAME)
    world.run(0.05)
    assert world.heard() == b""
    assert world.air() == []
    assert world.base.usb.garbled == len(FRAME)


def test_the_same_packet_again_is_answered_and_not_sent_again():
    world = World()
    for _ in range(2):
        world.base.usb.send(FRAME)
        world.run(0.05)
        assert world.heard() == ACK_26
    assert len(world.air()) == 1
    world.run(1.1)
    world.base.usb.send(FRAME)  # a tool that was started anew
    world.run(0.05)
    assert len(world.air()) == 2


def test_no_room_no_acknowledgement_and_all_that_is_acknowledged_is_sent():
    """Packets come faster than a radio without answers gets rid of them."""
    world = World()
    host = TosHost()
    acknowledged = []
    for number in range(40):
        world.base.usb.send(host.packet(number, 9, 6, bytes((number,)) * 20))
        world.run(0.004)
        acknowledged += [content[1] for content in host.packets(world.heard())]
    counts = world.base.app.counts
    assert counts.refused > 0
    assert len(acknowledged) + counts.refused == 40
    world.run(3.0)
    acknowledged += [content[1] for content in host.packets(world.heard())]
    sent = []
    for _, frame in world.air():
        if frame[-1] not in sent:
            sent.append(frame[-1])
    assert sent == acknowledged  # nobody is there: each four times, and in order
    assert counts.from_host == len(acknowledged) == counts.unanswered
    assert RADIO_QUEUE < len(acknowledged) < 40


def test_a_line_that_is_slower_than_the_air_drops_whole_messages():
    world = World(1, 2, 3)
    for number in range(30):
        for other in world.others:
            other.network.send(5, 6, bytes((number,)) * 80)
        world.run(0.012)
    world.run(1.0)
    counts = world.base.app.counts
    heard = TosHost().packets(world.heard())
    assert counts.dropped > 0
    assert len(heard) == counts.to_host
    assert counts.from_radio == counts.to_host + counts.dropped


def test_what_is_no_active_message_is_answered_and_not_carried():
    world = World()
    host = TosHost()
    world.base.usb.send(host.frame(bytes((0x44, 1, 1)) + b"printf"))
    world.base.usb.send(host.packet(2, 1, 6, bytes(29)))  # longer than TOSH_DATA_LENGTH
    world.run(0.05)
    assert [content[1] for content in host.packets(world.heard())] == [1, 2]
    world.base.usb.send(host.frame(bytes((0x45, 0)) + b"\xff\xff\0\0\0\x22\6"))
    world.run(0.05)
    assert world.heard() == b""
    assert world.base.app.counts.not_carried == 3
    assert world.air() == []


def test_noise_before_a_packet_costs_only_itself():
    world = World()
    world.base.usb.send(b"\x01\x02\x7d\x7e\x44\x7e" + FRAME)
    world.run(0.05)
    assert world.heard() == ACK_26
    assert world.base.app.counts.damaged == 2


def test_address_recognition_or_everybody_s_messages():
    """README of BaseStation: with recognition, and acknowledging; or all, and answering none."""
    for promiscuous, tries in ((False, 1), (True, 4)):
        world = World(1, promiscuous=promiscuous)
        world.others[0].network.send(5, 6, b"me")
        world.run(0.1)
        world.others[0].network.send(8, 6, b"you")
        world.run(0.2)
        payloads = [content[9:] for content in TosHost().packets(world.heard())]
        assert payloads == ([b"me", b"you"] if promiscuous else [b"me"])
        frames = [frame for source, frame in world.air() if source == "mote1"]
        assert len([frame for frame in frames if frame.endswith(b"me")]) == tries


def test_a_reset_begins_anew():
    world = World(1)
    world.base.usb.send(FRAME[:9])
    world.run(0.002)
    world.rail.set_volts(0.0)
    world.run(0.1)
    world.rail.set_volts(3.0)
    world.run(0.1)
    world.base.usb.send(FRAME)
    world.run(0.05)
    assert world.heard() == ACK_26
    assert len(world.others[0].got) == 1


def test_cycles_are_charged_and_the_clock_of_the_uart_runs():
    """At rest the MCU may sleep no deeper than LPM1, and a packet keeps it awake for a while."""
    world = World()
    mcu = world.base.mote.mcu
    assert mcu.cpu.sleep_state == "lpm1"
    before = mcu.cpu.busy_cycles
    world.base.usb.send(FRAME)
    world.run(0.01)
    # an interrupt, 60 cycles, and 70 for framing and CRC an octet, both ways
    assert mcu.cpu.busy_cycles - before > 100 * len(FRAME)
    mcu_time = FS_PER_S / float(mcu.clocks.mclk.frequency_hz)
    assert (mcu.cpu.busy_cycles - before) * mcu_time < 0.01 * FS_PER_S


def test_the_port_is_the_robots_link():
    with pytest.raises(ProcConfigError, match="USART1"):
        FirmwareConfig(NetworkConfig(1), usb_queue=12)
    application = SerialBridgeApp()
    with pytest.raises(ProcConfigError, match="usb_queue"):
        application.start(Services(None, None, None, 0))
