"""The network controller on real chips and a real medium: timing, retries, duplicates, queue."""

from itertools import pairwise

import pytest

from firmware_model.power import Rail
from firmware_model.scheduler import Scheduler
from firmware_model.time import FS_PER_MS, FS_PER_US
from firmware_model.trace import Trace
from procboard.applications.services import Hooks
from procboard.errors import ProcConfigError
from procboard.firmware import FirmwareConfig, MoteFirmware
from procboard.network import NetworkConfig, RandomMlcg, SendStatus, Sent
from procboard.telosb import TelosB
from radio_802154 import mac
from radio_802154.fcs import fcs_ok
from radio_802154.medium import Antenna, Medium, MediumConfig
from radio_802154.tinyos import AM_BROADCAST, MAX_PAYLOAD_OCTETS

AM = 0x77


class Listener:
    """An application that keeps what comes."""

    def __init__(self):
        self.got = []
        self.network = None

    def start(self, services):
        self.network = services.network
        services.network.on(AM, self.take)

    def take(self, received):
        self.got.append(received)
        yield 10


class Air:
    def __init__(self, *addresses, loss=0.0, link_loss=None, seed=1, **config):
        self.scheduler = Scheduler()
        self.trace = Trace()
        self.medium = Medium(
            self.scheduler,
            MediumConfig(loss_probability=loss, link_loss=link_loss or {}),
            seed=seed,
            channel=self.trace.channel("radio"),
        )
        self.frames = []
        self.trace.channel("radio").sink(self.frames.extend)
        self.motes, self.apps = [], []
        for address in addresses:
            name = f"mote{address}"
            self.medium.place(name, Antenna())
            app = Listener()
            firmware = MoteFirmware(
                FirmwareConfig(NetworkConfig(address, **config), with_robot=False), app, Hooks()
            )
            rail = Rail(self.scheduler, name, 3.0)
            mote = TelosB(self.scheduler, rail, self.medium, firmware, name, seed)
            mote.rail = rail
            self.motes.append(mote)
            self.apps.append(app)
        self.run(0.1)

    def run(self, seconds):
        self.scheduler.run(self.scheduler.now + round(seconds * 10_000) * 100 * FS_PER_US)

    def on_air(self):
        """(start, source, decoded frame) of all frames so far, FCS checked."""
        self.trace.flush()
        found = []
        for _end, (start, _channel, source, _power, psdu) in self.frames:
            assert fcs_ok(psdu)
            found.append((start, source, mac.decode(psdu[:-2])))
        return found


def test_an_acknowledged_unicast():
    air = Air(1, 2, 3)
    outcomes = []
    assert air.apps[0].network.send(2, AM, b"hello", outcomes.append)
    air.run(0.1)
    assert outcomes == [Sent(SendStatus.ACKNOWLEDGED, 1)]
    assert [(r.source, r.destination, r.payload) for r in air.apps[1].got] == [(1, 2, b"hello")]
    assert air.apps[1].got[0].rssi_dbm < 0
    assert air.apps[2].got == []
    (sent, _, frame), (acked, _, ack) = air.on_air()
    assert frame.frame_control == 0x8861  # as TinyOS has it (TEP 125)
    assert mac.acknowledges(ack, frame)
    # 12 symbols after the frame: SHR and PHR of 6 octets, 18 of MPDU
    assert acked - sent == ((6 + 18) * 32 + 192) * FS_PER_US


def test_a_broadcast_goes_out_once_and_unacknowledged():
    air = Air(1, 2, 3)
    outcomes = []
    air.apps[0].network.send(AM_BROADCAST, AM, b"all", outcomes.append)
    air.run(0.1)
    assert outcomes == [Sent(SendStatus.SENT, 1)]
    assert [len(app.got) for app in air.apps] == [0, 1, 1]
    assert len(air.on_air()) == 1


def test_nobody_there_is_tried_four_times_and_reported():
    air = Air(1)
    outcomes = []
    air.apps[0].network.send(9, AM, b"?", outcomes.append)
    air.run(0.2)
    assert outcomes == [Sent(SendStatus.NOT_ACKNOWLEDGED, 4)]
    frames = air.on_air()
    assert len(frames) == 4
    assert len({frame.sequence for _, _, frame in frames}) == 1
    # From the end of a frame at least macAckWaitDuration passes before the next attempt.
    duration = (6 + 14) * 32
    for (first, _, _), (second, _, _) in pairwise(frames):
        assert (second - first) // FS_PER_US >= duration + 864 + 192


def test_backoffs_are_whole_periods_of_320_us(monkeypatch):
    """The time from the CSMA's beginning to the transmission follows the numbers drawn."""
    drawn = []
    original = RandomMlcg.below

    def below(self, limit):
        drawn.append((limit, original(self, limit)))
        return drawn[-1][1]

    monkeypatch.setattr(RandomMlcg, "below", below)
    air = Air(1, 2)
    drawn.clear()
    delays = []
    for _ in range(40):
        air.run(0.05)
        before = len(air.on_air())
        asked = air.scheduler.now
        air.apps[0].network.send(2, AM, b"x" * 10)
        air.run(0.05)
        delays.append((air.on_air()[before][0] - asked) // FS_PER_US)
    assert [limit for limit, _ in drawn] == [8] * 40  # 2^macMinBE
    assert {n for _, n in drawn} == set(range(8))
    # preparing the frame and 12 symbols to its preamble are the same every time
    base = min(d - n * 320 for d, (_, n) in zip(delays, drawn, strict=True))
    for delay, (_, n) in zip(delays, drawn, strict=True):
        assert 0 <= delay - n * 320 - base <= 62  # two ticks of the alarm clock


def test_a_busy_channel_is_given_up_after_five_tries(monkeypatch):
    drawn = []
    original = RandomMlcg.below

    def below(self, limit):
        drawn.append(limit)
        return original(self, limit)

    monkeypatch.setattr(RandomMlcg, "below", below)
    air = Air(1, 2)
    drawn.clear()
    monkeypatch.setattr(Medium, "energy_dbm", lambda *_: -30.0)  # somebody's microwave oven
    outcomes = []
    air.apps[0].network.send(2, AM, b"x", outcomes.append)
    air.run(0.2)
    assert outcomes == [Sent(SendStatus.CHANNEL_BUSY, 0)]
    assert drawn == [8, 16, 32, 32, 32]  # BE 3, 4, 5, 5, 5 (7.5.1.4)
    assert air.on_air() == []


def test_thirty_percent_loss_loses_nothing_acknowledged_and_repeats_nothing():
    air = Air(1, 2, loss=0.3)
    outcomes = {}
    for n in range(300):
        payload = n.to_bytes(2, "big")
        while not air.apps[0].network.send(
            2, AM, payload, lambda sent, n=n: outcomes.__setitem__(n, sent)
        ):
            air.run(0.02)
        if n % 7 == 0:  # traffic the other way too
            air.apps[1].network.send(1, AM, payload)
        air.run(0.005)
    air.run(1.0)
    got = [int.from_bytes(r.payload, "big") for r in air.apps[1].got]
    acknowledged = {n for n, sent in outcomes.items() if sent.status is SendStatus.ACKNOWLEDGED}
    assert len(outcomes) == 300
    assert acknowledged <= set(got)
    assert len(got) == len(set(got))
    assert got == sorted(got)
    # Chance of an attempt: 0.7²; of four in a row failing: 6.8 %.
    assert 255 <= len(acknowledged) <= 299
    statistics = air.apps[1].network.statistics
    assert statistics.duplicates > 30  # acknowledgements that were lost
    assert air.apps[0].network.statistics.retries > 150
    transmissions = air.apps[0].network.statistics.transmissions
    assert sum(sent.attempts for sent in outcomes.values()) == transmissions


def test_lost_acknowledgements_cause_duplicates_that_are_suppressed():
    air = Air(1, 2, link_loss={("mote2", "mote1"): 1.0})
    outcomes = []
    air.apps[0].network.send(2, AM, b"once", outcomes.append)
    air.run(0.2)
    assert outcomes == [Sent(SendStatus.NOT_ACKNOWLEDGED, 4)]
    assert len(air.apps[1].got) == 1
    assert air.apps[1].network.statistics.duplicates == 3


def test_numbers_are_forgotten_after_a_second():
    air = Air(1, 2)
    for n in range(3 * 256):
        air.apps[0].network.send(2, AM, n.to_bytes(2, "big"))
        air.run(0.05)
    assert len(air.apps[1].got) == 3 * 256


def test_a_sender_that_restarts_is_heard():
    air = Air(1, 2)
    air.apps[0].network.send(2, AM, b"one")
    air.run(0.1)
    air.motes[0].mcu.press_reset()
    air.run(0.1)
    air.apps[0].network.send(2, AM, b"two")
    air.run(0.1)
    assert [r.payload for r in air.apps[1].got] == [b"one", b"two"]


def test_a_full_queue_refuses():
    air = Air(1, 2, queue_limit=3)
    network = air.apps[0].network
    assert [network.send(2, AM, bytes((n,))) for n in range(5)] == [True] * 3 + [False] * 2
    assert network.statistics.refused == 2
    assert network.room == 0
    air.run(0.2)
    assert network.room == 3
    assert [r.payload for r in air.apps[1].got] == [b"\0", b"\1", b"\2"]


def test_a_reserved_place_is_nobody_elses():
    air = Air(1, 2, queue_limit=3)
    network = air.apps[0].network
    assert all(network.send(2, AM, bytes((n,))) for n in range(3))
    assert network.send(2, AM, b"\3", reserved=True)
    assert not network.send(2, AM, b"\4", reserved=True)
    assert not network.send(2, AM, b"\5")
    assert network.room == 0
    air.run(0.2)
    assert [r.payload for r in air.apps[1].got] == [b"\0", b"\1", b"\2", b"\3"]
    assert network.send(2, AM, b"\6", reserved=True)
    assert network.room == 3


def test_the_longest_payload_passes_and_a_longer_one_is_refused():
    air = Air(1, 2)
    air.apps[0].network.send(2, AM, bytes(MAX_PAYLOAD_OCTETS))
    with pytest.raises(ValueError, match="octets"):
        air.apps[0].network.send(2, AM, bytes(MAX_PAYLOAD_OCTETS + 1))
    air.run(0.1)
    assert air.apps[1].got[0].payload == bytes(MAX_PAYLOAD_OCTETS)


def test_unknown_types_are_counted_and_dropped():
    air = Air(1, 2)
    air.apps[0].network.send(2, AM + 1, b"?")
    air.run(0.1)
    assert air.apps[1].got == []
    assert air.apps[1].network.statistics.bad_frames == 1


def test_many_senders_at_once_share_the_channel_and_tell_the_truth():
    air = Air(*range(1, 7))
    outcomes = {}
    for source, app in enumerate(air.apps[1:], start=2):
        for n in range(5):
            payload = bytes((source, n)) * 10
            app.network.send(1, AM, payload, lambda sent, p=payload: outcomes.__setitem__(p, sent))
    air.run(1.0)
    got = [r.payload for r in air.apps[0].got]
    acknowledged = {p for p, sent in outcomes.items() if sent.status is SendStatus.ACKNOWLEDGED}
    assert len(outcomes) == 25
    assert acknowledged <= set(got)
    assert len(got) == len(set(got))
    assert len(acknowledged) >= 15  # of five that always have something to say
    assert {p[0] for p in acknowledged} == set(range(2, 7))  # and nobody is shut out


def test_a_radio_that_was_flooded_hears_again():
    """More frames than the RXFIFO holds while the CPU is held: overflow, flush, and on."""
    air = Air(1, 2, 3)

    def busy():
        yield 4_000_000 // 10  # a task that hogs the CPU for 0.1 s

    air.motes[1].mcu.cpu.spawn("busy", busy())
    for n in range(6):
        air.apps[0].network.send(AM_BROADCAST, AM, bytes((n,)) * 60)
    air.run(0.3)
    assert air.motes[1].mcu.firmware.driver.overflows >= 1
    assert len(air.apps[1].got) < 6
    air.apps[1].got.clear()
    outcomes = []
    air.apps[0].network.send(2, AM, b"again", outcomes.append)
    air.run(0.2)
    assert outcomes == [Sent(SendStatus.ACKNOWLEDGED, 1)]
    assert [r.payload for r in air.apps[1].got] == [b"again"]


def test_the_radio_draws_what_its_states_say():
    air = Air(1, 2)
    consumer = next(c for c in air.motes[0].rail.consumers if c.name == "CC2420")
    assert consumer.state == "rx"
    assert consumer.amps == pytest.approx(18.8e-3)
    air.apps[0].network.send(2, AM, bytes(50))
    air.run(0.1)
    table = consumer.table()
    # turnaround and the frame of 63 octets, 2.4 ms
    assert table["tx"][0] == pytest.approx(192e-6 + (6 + 63) * 32e-6, rel=0.01)


@pytest.mark.parametrize(
    "wrong",
    [
        {"address": 0xFFFF},
        {"address": 1, "channel": 10},
        {"address": 1, "min_be": 6, "max_be": 5},
        {"address": 1, "pa_level": 32},
        {"address": 1, "queue_limit": 0},
    ],
)
def test_impossible_configurations_are_refused(wrong):
    with pytest.raises(ProcConfigError):
        NetworkConfig(**wrong)


def test_the_generator_is_tinyos_minimal_standard():
    """Park and Miller's check: from seed 1 the 10000th state is 1043618065."""
    generator = RandomMlcg(1)
    for _ in range(10_000):
        generator.below(2)
    assert generator._state == 1_043_618_065


def test_time_between_frames_is_kept():
    """An interframe space of 12 or 40 symbols follows what is acknowledged (7.5.1.3)."""
    air = Air(1, 2, min_be=0, max_be=0)
    for n in range(4):
        air.apps[0].network.send(2, AM, bytes((n,)) * 40)
    air.run(0.2)
    frames = air.on_air()
    acks = [t for t, source, f in frames if f.frame_type is mac.FrameType.ACK]
    data = [t for t, source, f in frames if f.frame_type is mac.FrameType.DATA]
    assert len(acks) == len(data) == 4
    for ack, following in zip(acks, data[1:], strict=False):
        assert following - (ack + 11 * 32 * FS_PER_US) >= 640 * FS_PER_US
        assert following - ack < 5 * FS_PER_MS
