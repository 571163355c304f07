"""From the trace to arrays: what instruments reported, what went over wires and through the air.

Sinks see each block of the trace once and keep what a run folder needs: a sample a control tick, a
pose a camera frame, the bytes of each frame with its time. Frames are taken apart at the end; of
one robot among many they are only counted. What the air carried is everybody's (`AirRecorder`).
"""

from __future__ import annotations

import re
from array import array
from collections import deque
from collections.abc import Mapping
from math import nan
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from firmware_model.dspic30f.system import ResetCause
from firmware_model.time import FS_PER_S
from navboard.sensor_controller import SAMPLE_CHANNELS
from radio_802154 import mac, messages, tinyos
from radio_802154.errors import RadioError
from radio_802154.timing import ppdu_us
from spi_bus.errors import SpiBusError
from spi_bus.frame import Decoder, Frame, FrameType
from spi_bus.messages import LINK_MESSAGES
from tools.bench.wrong import prefix
from tools.records.data import Event, FloatArray, RadioFrame, Series, SpiFrame

if TYPE_CHECKING:
    from firmware_model.trace import Record, Trace

ACK_WITHIN_FS = 10**12
"""An acknowledgement begins 192 µs after its frame: one within 1 ms of its end is its own."""
REMEMBERED = 16
"""Frames of a direction among which a repetition is looked for: twice the largest window."""
SPI_NAMES: dict[int, str] = {FrameType.HELLO: "hello", FrameType.ACK: "ack"}
RADIO_NAMES = {
    "TailBeatCommand": "command",
    "TargetCommand": "command",
    "CommandReply": "reply",
    "Pose": "pose",
    "PoseBatch": "pose",
    "Telemetry": "telemetry",
}
SOURCES = {"proc": "robot", "base": "base"}
POSE_CHANNELS = ("x_m", "y_m", "heading_rad")


class Recorder:
    """Keeps what sinks hand it; `series`, `spi_frames` and the rest make arrays of it.

    Args:
        trace: the run's, with all channels that there will be.
        nav_drift_ppm: of the clock that stamps the samples.
        name: of the robot, where there are several.
        frames: whether the frames on the wires are kept, not only counted.

    """

    def __init__(
        self, trace: Trace, nav_drift_ppm: float, name: str = "", *, frames: bool = True
    ) -> None:
        before = prefix(name)
        self._rate = 1.0 + 1e-6 * nav_drift_ppm
        self._samples = _Rows(len(SAMPLE_CHANNELS))
        self._poses = _Rows(len(POSE_CHANNELS))
        self._targets: list[tuple[int, Any]] = []
        self._events: list[tuple[int, Any]] = []
        self._link_events: list[tuple[int, Any]] = []
        self._control: list[tuple[int, Any]] = []
        self.tracking: list[tuple[int, Any]] = []
        """What target tracking said, see `procboard.board.ProcBoard`."""
        self._pieces: list[tuple[int, bool, bytes]] = []
        self._parts = {True: _Splitter(), False: _Splitter()}
        self._keeps_frames = frames
        self._recent = _recent()
        self.frames_seen = 0
        """Frames on the wires so far, where they are not kept."""
        self.frames_damaged = 0
        self.radio_sent = 0
        self.radio_received = 0
        for channel, kept in (
            ("nav.sample", self._samples),
            ("nav.servo", self._targets),
            ("nav.event", self._events),
            ("proc.link", self._link_events),
            ("proc.control", self._control),
            ("camera", self._poses),
        ):
            trace.channel(f"{before}{channel}").sink(kept.extend)
        if f"{before}proc.tracking" in trace.names():  # else asking would make the channel
            trace.channel(f"{before}proc.tracking").sink(self.tracking.extend)
        trace.channel(f"{before}spi.bytes").sink(self._spi_block)
        for mote in (f"{before}proc",) if name else ("proc", "base"):
            trace.channel(f"{mote}.radio.sent").sink(self._count_sent)
            trace.channel(f"{mote}.radio.received").sink(self._count_received)

    def _count_sent(self, block: list[Record]) -> None:
        self.radio_sent += len(block)

    def _count_received(self, block: list[Record]) -> None:
        self.radio_received += len(block)

    def _spi_block(self, block: list[Record]) -> None:
        for start_fs, value in block:
            period_fs, mosi, miso = cast("tuple[int, bytes, bytes]", value)
            for from_master, octets in ((True, mosi), (False, miso)):
                for begin_fs, piece in self._parts[from_master].split(
                    start_fs, 8 * period_fs, octets
                ):
                    if self._keeps_frames:
                        self._pieces.append((begin_fs, from_master, piece))
                    else:
                        self.frames_seen += 1
                        _, outcome = _spi_kind(piece, self._recent[from_master])
                        self.frames_damaged += outcome == "crc-error"

    # --- what instruments reported ---------------------------------------------------------

    def series(self) -> dict[str, Series]:
        """Return every channel that had a sample, by its name in channels.csv."""
        found: dict[str, Series] = {}
        times = self._board_times()
        for name, values in zip(SAMPLE_CHANNELS, self._samples.columns(), strict=True):
            known = ~np.isnan(values)
            if known.any():
                found[name] = Series(times[known], values[known])
        seen = np.array([time_fs / FS_PER_S for time_fs in self._poses.times_fs])
        for name, values in zip(POSE_CHANNELS, self._poses.columns(), strict=True):
            if seen.size:
                found[name] = Series(seen.copy(), values)
        for column, name in enumerate(("control_error_rad", "control_bias_rad")):
            if self._control:
                found[name] = _series(
                    [(time_fs / FS_PER_S, values[column]) for time_fs, values in self._control]
                )
        return found

    def _board_times(self) -> FloatArray:
        """Time stamps of the samples: the board's clock, set right at each of its boots."""
        boots = [time_fs for time_fs, text in self._events if str(text).startswith("reset")]
        stamps = []
        boot_fs = 0
        for time_fs in self._samples.times_fs:
            while boots and boots[0] <= time_fs:
                boot_fs = boots.pop(0)
            stamps.append((boot_fs + (time_fs - boot_fs) * self._rate) / FS_PER_S)
        return np.array(stamps)

    def tail_command(self, times_s: FloatArray) -> FloatArray:
        """Return what the servo was told at each time: NaN where nothing, or before anything."""
        told_s = np.array([time_fs / FS_PER_S for time_fs, _ in self._targets])
        angles = np.array(
            [np.nan] + [np.nan if angle is None else angle for _, angle in self._targets]
        )
        held: FloatArray = angles[np.searchsorted(told_s, times_s, side="right")]
        return held

    # --- what went between the boards ------------------------------------------------------

    def spi_frames(self) -> tuple[SpiFrame, ...]:
        """Return every frame on the wires, as a probe at the receiver's pins takes it apart."""
        frames = []
        recent = _recent()
        for time_fs, from_master, piece in sorted(self._pieces, key=lambda entry: entry[0]):
            kind, outcome = _spi_kind(piece, recent[from_master])
            frames.append(SpiFrame(time_fs / FS_PER_S, from_master, kind, outcome, len(piece) + 1))
        return tuple(frames)

    def events(self) -> list[Event]:
        """Return what the boards said of themselves."""
        found = []
        for time_fs, text in self._events:
            words = _nav_words(str(text))
            if words:
                where = "navigation board"
                found.append(Event(time_fs / FS_PER_S, where, words, _severity(words)))
        for time_fs, (name, *numbers) in self._link_events:
            if name == "LinkUp":
                words = f"up, with boot {numbers[0]} of the navigation board"
            elif name == "PeerReset":
                words = f"the navigation board was reset: boot {numbers[0]} after {numbers[1]}"
            else:
                continue  # damaged frames are counted and drawn, one by one
            found.append(Event(time_fs / FS_PER_S, "SPI link", words))
        return found


class AirRecorder:
    """Keeps what the medium carried, whoever sent it.

    Args:
        trace: the run's.
        names: of senders, by those of their antennas.

    """

    def __init__(self, trace: Trace, names: Mapping[str, str] | None = None) -> None:
        self._names = names if names is not None else SOURCES
        self._air: list[tuple[int, Any]] = []
        trace.channel("radio").sink(self._air.extend)

    def radio_frames(self) -> tuple[RadioFrame, ...]:
        """Return every frame in the air; lost is one that asked for an ACK and got none."""
        decoded = []
        for end_fs, (start_fs, _channel, source, _dbm, psdu) in self._air:
            try:
                frame = mac.decode(psdu[:-2])
            except RadioError:
                continue  # a frame that no decoder knows is in the capture file all the same
            decoded.append((start_fs, end_fs, self._names.get(source, source), frame, len(psdu)))
        decoded.sort(key=lambda entry: entry[0])
        frames = []
        latest: dict[str, bytes] = {}
        for index, (start_fs, end_fs, source, frame, octets) in enumerate(decoded):
            kind, outcome = "ack", "received"
            if frame.frame_type is not mac.FrameType.ACK:
                kind = _radio_kind(frame)
                identity = bytes([frame.sequence]) + frame.payload
                if frame.ack_request and not _acknowledged(decoded, index, end_fs):
                    outcome = "lost"
                elif latest.get(source) == identity:
                    outcome = "retransmission"
                latest[source] = identity
            frames.append(
                RadioFrame(
                    start_fs / FS_PER_S, ppdu_us(octets) / 1e6, source, kind, outcome, octets
                )
            )
        return tuple(frames)


class _Rows:
    """Records of equally many numbers, packed: 50 a second of each robot; None is NaN."""

    def __init__(self, width: int) -> None:
        self._width = width
        self._numbers = array("d")
        self.times_fs: list[int] = []

    def extend(self, block: list[Any]) -> None:
        """Take a block of the trace."""
        self.times_fs += [time_fs for time_fs, _ in block]
        self._numbers.extend(
            nan if value is None else value for _, values in block for value in values
        )

    def columns(self) -> FloatArray:
        """Return an array (width, records)."""
        table = np.array(self._numbers, dtype=np.float64).reshape(-1, self._width)
        return np.ascontiguousarray(table.T)


class _Splitter:
    """Cuts a stream of bytes at zeros, over block borders, keeping each piece's first time."""

    def __init__(self) -> None:
        self._piece = b""
        self._begin_fs = 0

    def split(self, start_fs: int, byte_fs: int, octets: bytes) -> list[tuple[int, bytes]]:
        """Return (time of the first byte, bytes without the zero) of every piece that ended."""
        pieces = []
        position = 0
        while position < len(octets):
            if not self._piece:
                rest = octets[position:].lstrip(b"\0")
                position = len(octets) - len(rest)
                if not rest:
                    break
                self._begin_fs = start_fs + position * byte_fs
            end = octets.find(0, position)
            if end < 0:
                self._piece += octets[position:]
                break
            pieces.append((self._begin_fs, self._piece + octets[position:end]))
            self._piece = b""
            position = end + 1
        return pieces


def _recent() -> dict[bool, deque[bytes]]:
    """Frames of late, from the master and to it, for telling repetitions."""
    return {True: deque(maxlen=REMEMBERED), False: deque(maxlen=REMEMBERED)}


def _series(kept: list[tuple[float, float]]) -> Series:
    array = np.array(kept, dtype=np.float64)
    return Series(array[:, 0].copy(), array[:, 1].copy())


def _spi_kind(piece: bytes, recent: deque[bytes]) -> tuple[str, str]:
    """Name of a frame and what became of it."""
    bodies = Decoder().receive(piece + b"\0")
    if not bodies:
        return "damaged", "crc-error"
    try:
        frame = Frame.parse(bodies[0])
        if frame.frame_type != FrameType.DATA:  # a plain number: newer types may come
            return SPI_NAMES.get(frame.frame_type, "other"), "ok"
        name = type(LINK_MESSAGES.decode(frame.payload)).__name__
    except SpiBusError:
        return "damaged", "crc-error"
    identity = bytes([frame.session & 0xFF, frame.sequence]) + frame.payload
    again = identity in recent
    recent.append(identity)
    return name, "retransmission" if again else "ok"


def _radio_kind(frame: mac.Frame) -> str:
    try:
        packet = tinyos.from_frame(frame)
        message = messages.decode(packet.am_type, packet.payload)
    except RadioError:
        return "other"
    name = type(message).__name__
    return RADIO_NAMES.get(name, name)


def _acknowledged(decoded: list[Any], index: int, end_fs: int) -> bool:
    """Whether an acknowledgement of a frame's number follows right after it."""
    sequence = decoded[index][3].sequence
    for start_fs, _, _, frame, _ in decoded[index + 1 :]:
        if start_fs > end_fs + ACK_WITHIN_FS:
            return False
        if frame.frame_type is mac.FrameType.ACK and frame.sequence == sequence:
            return True
    return False


RESET_WORDS = (
    (ResetCause.POWER_ON, "power on"),
    (ResetCause.BROWN_OUT, "supply too low"),
    (ResetCause.WATCHDOG, "watchdog"),
    (ResetCause.SOFTWARE, "reset by its own supervisor"),
    (ResetCause.EXTERNAL, "reset pin"),
    (ResetCause.ILLEGAL, "illegal instruction"),
    (ResetCause.TRAP, "trap"),
)
"""Bits of RCON in the order in which they explain a start: a power-on sets BOR as well."""


def _nav_words(text: str) -> str:
    """What the navigation board said, for people; empty where something else says it too."""
    if text == "supply lost" or text.startswith("reset "):
        return ""  # the supply's own event, and the boot that follows, which names the cause
    if boot := re.fullmatch(r"boot (\d+), RCON (0x[0-9a-f]+)", text):
        cause = ResetCause(int(boot[2], 16))
        why = next((words for flag, words in RESET_WORDS if flag in cause), "unknown cause")
        return f"boot {boot[1]}: {why}"
    if told := re.fullmatch(r"fail-safe off by command (\d+)", text):
        return f"tail obeys: first command since the fail-safe, number {told[1]}"
    if told := re.fullmatch(r"fail-safe on after command (\d+)", text):
        return f"fail-safe: no command followed number {told[1]} in time, the tail is centred"
    return text


def _severity(words: str) -> str:
    if any(cause in words for cause in ("watchdog", "supervisor", "trap", "illegal")):
        return "fault"
    return "warning" if words.startswith("fail-safe") or "does not answer" in words else "info"
