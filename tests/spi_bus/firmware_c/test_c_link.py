"""The C link beside the Python link: told the same, they say the same, whatever the channel does.

A reader of C who doubts a line finds here what would fail: strict compilers of three widths of int,
frames and refusals side by side, both state machines in step, and noise under the sanitizers.
"""

from __future__ import annotations

import ctypes
import shutil
import struct
import subprocess
from dataclasses import replace
from pathlib import Path
from random import Random

import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from hypothesis.stateful import run_state_machine_as_test

from spi_bus.crc import crc16
from spi_bus.errors import LinkFull
from spi_bus.frame import Decoder, ErrorKind, Frame, FrameType, seal
from spi_bus.link import Link, LinkConfig, MessageReceived, Role
from spi_bus.messages import Ping, Pong, TailBeat
from tests.spi_bus.test_link_stateful import LossyLink, Side

SOURCES = Path(__file__).resolve().parents[3] / "spi_bus" / "firmware_c"
HERE = Path(__file__).resolve().parent
LINK = (SOURCES / "fishbed_link.c", SOURCES / "fishbed_frame.c")
CONFIG = LinkConfig(
    window=4, queue_limit=8, ack_delay_us=5_000, retransmit_us=20_000, retransmit_max_us=160_000
)


MOST_PAYLOAD = ["-DFISHBED_MAX_PAYLOAD=247", f"-DFISHBED_QUEUE_LIMIT={CONFIG.queue_limit}"]

# It compiles.

BOTH_HEADERS = """\
#include "fishbed_messages.h"
#include "fishbed_link.h"
#include "fishbed_radio_messages.h"
#include "fishbed_routing_messages.h"
#include "fishbed_messages.h"
#include "fishbed_link.h"
#include "fishbed_radio_messages.h"
#include "fishbed_routing_messages.h"
fishbed_validator validators[2] = {fishbed_from_master, fishbed_from_slave};
char largest_fits[FISHBED_LARGEST_MESSAGE <= FISHBED_MAX_PAYLOAD ? 1 : -1];
"""
LEAST = ["-DFISHBED_MAX_PAYLOAD=6", "-DFISHBED_QUEUE_LIMIT=1"]
MOST = ["-DFISHBED_MAX_PAYLOAD=247", "-DFISHBED_QUEUE_LIMIT=255"]


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("width", ["-m32", "-m64"])
def test_strict_c99_without_a_warning_for_32_and_64_bits(build, tmp_path, width, compiler):
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is absent")
    source = tmp_path / "headers.c"
    source.write_text(BOTH_HEADERS)
    build(f"headers{compiler}{width}.o", "strict", source, more=[width], compiler=compiler)
    for index, sizes in enumerate(([], LEAST, MOST)):
        for part in LINK:
            name = f"{part.stem}{compiler}{width}-{index}.o"
            more = ["-Wmissing-prototypes", "-Wcast-qual", "-Wswitch-enum", width, *sizes]
            build(name, "strict", part, more=more, compiler=compiler)


@pytest.mark.skipif(not shutil.which("clang"), reason="clang is absent: no compiler of 16-bit ints")
def test_strict_c99_without_a_warning_where_an_int_has_16_bits(tmp_path, flags):
    """-Wconversion and -Wshift-overflow see there what an int of 32 bits hides."""
    headers = tmp_path / "headers.c"
    headers.write_text(BOTH_HEADERS)
    for source in (headers, *LINK):
        subprocess.run(
            ["clang", "--target=msp430", *flags["strict"], f"-I{SOURCES}", source],
            check=True,
            cwd=tmp_path,
        )


def test_it_needs_no_library(build):
    """No symbol from outside but what gcc itself may call for copies of structs."""
    needed: set[str] = set()
    offered: set[str] = set()
    for part in LINK:
        compiled = build(f"symbols-{part.stem}.o", "strict", part)
        names = subprocess.run(["nm", compiled], capture_output=True, text=True, check=True).stdout
        for line in names.splitlines():
            *_, kind, name = line.split()
            (needed if kind == "U" else offered).add(name)
    needed -= offered
    assert needed <= {"memset", "memcpy", "_GLOBAL_OFFSET_TABLE_", "__stack_chk_fail"}


@pytest.mark.parametrize(
    ("epoch", "config"),
    [
        (0, (4, 1, 2, 3)),
        (1, (0, 1, 2, 3)),
        (1, (16, 1, 2, 3)),
        (1, (4, 2, 2, 3)),
        (1, (4, 1, 4, 3)),
        (1, (4, 1, 2, (1 << 30) + 1)),
    ],
)
def test_values_out_of_range_are_refused_at_the_beginning(library, epoch, config):
    raw = struct.pack("<BxxxIII", *config)
    assert not library().shim_new(0, epoch, raw)
    assert library().shim_new(0, 1, struct.pack("<BxxxIII", 4, 1, 2, 3))


# Frames.


@given(st.binary(max_size=300))
def test_the_crc_is_the_crc(library, data):
    assert library().fishbed_crc16(data, len(data)) == crc16(data)


bodies = st.one_of(
    st.binary(min_size=5, max_size=60),
    st.lists(st.sampled_from([0, 0, 1, 255]), min_size=5, max_size=252).map(bytes),
    st.sampled_from([bytes(252), b"\xff" * 252, b"\x11" * 252, bytes(5)]),
)


@given(bodies)
def test_sealed_frames_are_byte_identical_and_open_again(library, body):
    buffer = ctypes.create_string_buffer(b"\xee" + body + b"\xee" * 5, 260)
    size = library().fishbed_seal(buffer, len(body))
    assert buffer.raw[:size] == seal(body)
    assert size == len(body) + 4
    error = ctypes.c_int(-1)
    if len(body) and body[0] >> 4 == 1:
        assert library().fishbed_open(buffer, size - 1, ctypes.byref(error)) == len(body)
        assert buffer.raw[1 : 1 + len(body)] == body


KINDS = list(ErrorKind)


@given(st.binary(min_size=1, max_size=300).map(lambda data: data.replace(b"\0", b"\1")), bodies)
def test_any_block_is_opened_or_refused_for_the_same_reason(library, noise, body):
    stuffed = bytearray(seal(bytes((0x12,)) + body[1:])[:-1])
    stuffed[noise[0] % len(stuffed)] = noise[-1]
    for block in (noise, bytes(stuffed)):
        decoder = Decoder()
        found = decoder.receive(block + b"\0")
        buffer = ctypes.create_string_buffer(block, 310)
        error = ctypes.c_int(-1)
        size = library().fishbed_open(buffer, len(block), ctypes.byref(error))
        if found:
            assert [buffer.raw[1 : 1 + size]] == found
        else:
            assert size == 0
            assert decoder.errors[KINDS[error.value]] == 1


# The state machine.


def test_both_sides_in_both_languages_over_a_hostile_channel(new_twins):
    """The state machine of the Python link's own test, every side a pair of twins."""

    class TwinSide(Side):
        new_link = staticmethod(new_twins)

    class LossyTwins(LossyLink):
        new_side = TwinSide

    run_state_machine_as_test(
        LossyTwins,
        settings=settings(
            max_examples=60,
            stateful_step_count=80,
            deadline=None,
            derandomize=True,
            phases=(Phase.generate, Phase.shrink),
        ),
    )


def test_a_peer_that_falls_silent_is_probed_alike(new_twins):
    """Retransmissions with back-off, a HELLO after the fourth, and all over when it is back."""
    master, slave = new_twins(Role.MASTER, 1, CONFIG), new_twins(Role.SLAVE, 2, CONFIG)
    for _ in range(3):
        slave.receive(master.data_to_send(0), 0)
        master.receive(slave.data_to_send(0), 0)
    assert master.connected
    assert slave.connected
    master.send(Ping(1))
    now, kinds = 0, []
    while now < 1_500_000:
        frames = [Frame.parse(body) for body in Decoder().receive(master.data_to_send(now))]
        kinds.append([frame.frame_type for frame in frames])
        now = master.next_deadline_us()
        master.handle_timer(now - 1)  # early: nothing, also where the C clock wraps in between
        assert not master.wants_to_send
        master.handle_timer(now)
    data, greeting = [FrameType.DATA], [FrameType.HELLO, FrameType.DATA]
    assert kinds[:8] == [data, data, data, data, greeting, greeting, greeting, greeting]
    slave.receive(master.data_to_send(now), now)
    slave.handle_timer(now + CONFIG.ack_delay_us)
    master.receive(slave.data_to_send(now + CONFIG.ack_delay_us), now + CONFIG.ack_delay_us)
    assert not master.queued


def test_a_gap_that_is_told_twice_is_answered_once(new_twins):
    """The second report of one gap must not send everything a third time."""
    master, slave = new_twins(Role.MASTER, 1, CONFIG), new_twins(Role.SLAVE, 2, CONFIG)
    for _ in range(3):
        slave.receive(master.data_to_send(0), 0)
        master.receive(slave.data_to_send(0), 0)
    for token in range(3):
        master.send(Ping(token))
    _, behind, _ = Decoder().receive(master.data_to_send(1_000))
    slave.receive(seal(behind), 1_000)
    told = slave.data_to_send(1_000)
    master.receive(told, 2_000)
    assert len(Decoder().receive(master.data_to_send(2_000))) == 3
    master.receive(told, 3_000)
    assert master.data_to_send(3_000) == b""


def test_c_speaks_with_c(new_c_link):
    """And without the other language's help: messages arrive once, in order, with losses."""
    rng = Random(1)
    master = new_c_link(Role.MASTER, 1, CONFIG)
    slave = new_c_link(Role.SLAVE, 2, CONFIG)
    received = []
    sent = now = 0
    while len(received) < 400:
        now += 500
        assert now < 60_000_000
        while sent < 400:
            try:
                master.send(Ping(sent))
            except LinkFull:
                break
            sent += 1
        for one, other in ((master, slave), (slave, master)):
            one.handle_timer(now)
            data = bytearray(one.data_to_send(now, rng.randrange(1, 80)))
            if data and rng.random() < 0.1:
                data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
            if rng.random() < 0.05:
                continue
            received += [
                event.message.token
                for event in other.receive(bytes(data), now)
                if isinstance(event, MessageReceived)
            ]
    assert received == list(range(400))


def test_frames_longer_than_its_memory_are_one_error_each(library, new_c_link):
    """A small build takes its own messages and counts the rest as oversize."""
    small = library(payload=40, queue=8)
    assert small.queue_limit == CONFIG.queue_limit
    link = type(new_c_link(Role.SLAVE, 2, CONFIG))(small, Role.SLAVE, 2, CONFIG)
    long = seal(bytes.fromhex("1121000004") + b"\x55" * 41)
    fits = seal(bytes.fromhex("1221000004") + b"\x55" * 40)
    link.receive(long + fits + long[:60], 0)
    link.receive(long[60:] + fits, 0)
    assert link.error_counts[ErrorKind.OVERSIZE] == 2
    assert link.statistics.stale == 2  # intact, of a session that does not exist


# Noise, under the sanitizers.


def hostile_conversation(seed: int, steps: int):
    """What a slave hears, and what the Python link says to it: (now, window, heard, said)."""
    rng = Random(seed)
    master = Link(Role.MASTER, 1, CONFIG)
    slave = Link(Role.SLAVE, 2, CONFIG)
    epoch = 1
    now = 0
    old = [b"\0"]
    said = b""
    eavesdropper = Decoder()
    last = Frame(FrameType.ACK, 0, 0, 0, 0, 4)
    for _ in range(steps):
        now += rng.choice([0, 200, 3_000, 9_000, 30_000])
        if rng.random() < 0.004 and epoch < 15:
            epoch += 1
            master = Link(Role.MASTER, epoch, CONFIG)
        master.handle_timer(now)
        if rng.random() < 0.9:
            master.receive(said, now)
        if rng.random() < 0.5 and master.queued < CONFIG.queue_limit:
            master.send(Ping(rng.randrange(65_536)))
        if rng.random() < 0.1 and master.queued < CONFIG.queue_limit:
            master.send(TailBeat(1, 0.1, 0.2, 0.9, 5.0))
        heard = bytearray(master.data_to_send(now))
        for body in eavesdropper.receive(bytes(heard)):
            last = Frame.parse(body)
        match rng.randrange(13):
            case 0:
                heard += rng.randbytes(rng.randrange(1, 400))
            case 1 if heard:
                heard[rng.randrange(len(heard))] ^= 1 << rng.randrange(8)
            case 2 if heard:
                del heard[: rng.randrange(len(heard))]
            case 3:
                heard += rng.choice(old)
            case 4:  # intact, and nonsense
                kind = rng.choice([FrameType.HELLO, FrameType.DATA, FrameType.ACK, 0, 9])
                session = rng.choice([(epoch & 15) << 4 | 2, rng.randrange(256)])
                numbers = [rng.randrange(256) for _ in range(2)]
                flags = rng.randrange(16) << 4
                size = rng.choice([0, 3, 6, 11, 247])
                frame = Frame(
                    kind, session, *numbers, flags, rng.randrange(16), rng.randbytes(size)
                )
                heard += frame.encode()
            case 5:  # intact, of this session, and nearly true: gaps, duplicates, windows
                heard += replace(
                    last,
                    frame_type=rng.choice([FrameType.DATA, FrameType.ACK]),
                    sequence=(last.sequence + rng.choice([-2, -1, -1, 1, 2, 5])) & 0xFF,
                    acknowledge=(last.acknowledge + rng.choice([0, 0, 0, 0, -1, -2])) & 0xFF,
                    flags=rng.choice([0, 0x20, 0x20, 0x30]),
                    window=rng.choice([0, 1, 4, 15]),
                ).encode() * rng.choice([1, 2])
            case 6:
                heard = heard.replace(b"\0", b"\x07")
        old.append(bytes(heard))
        window = rng.choice([4, 4, 4, 4, 0, 1])
        slave.receive_window = window
        events = slave.receive(bytes(heard), now)
        for event in events:
            if isinstance(event, MessageReceived) and isinstance(event.message, Ping):
                if slave.queued == CONFIG.queue_limit:
                    break
                slave.send(Pong(event.message.token))
        slave.handle_timer(now)
        said = slave.data_to_send(now)
        yield now, window, bytes(heard), said
    assert slave.statistics.messages_received > steps // 20, "the noise drowned everything"


def test_noise_and_nonsense_under_the_sanitizers(build):
    """Random, damaged, replayed and nonsensical bytes: no report, and every answer the same."""
    sources = (HERE / "fuzz.c", *LINK)
    program = build("fuzz", "sanitized", *sources, more=MOST_PAYLOAD)
    records = list(hostile_conversation(0, 20_000))
    heard = b"".join(
        struct.pack("<IBH", now, window, len(data)) + data for now, window, data, _ in records
    )
    done = subprocess.run([program], input=heard, capture_output=True, check=False)
    assert done.stderr == b""
    assert done.returncode == 0
    said = b"".join(struct.pack("<H", len(data)) + data for *_, data in records)
    assert done.stdout == said
