"""An external tracker in the place of the emulated camera: its poses, its clock, and how it does.

Poses come as JSON lines (`tracker_lines`) from a socket (`tracker_source`), stamped by the
tracker's own clock. For `channels.csv` a stamp becomes a time of the run by the line under all
(stamp, arrival) pairs (`board_clock`), once all are known. While the run goes on, the least delay
of the last minute does: it is what the age of a pose that goes to the robot is told from. Neither
can know the least delay itself; where the tracker's clock is this machine's, say so
(`camera_clock`) and it is measured.

Nothing that comes stops a run. What is not a pose is counted by kind, and the first few are told.
"""

from __future__ import annotations

import itertools
import math
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from firmware_model.histogram import DurationHistogram
from firmware_model.time import FS_PER_S
from spi_bus.transports.outage import OutageBegan
from tools.bench.board_clock import BoardClock
from tools.bench.outages import LineOutages, named_by
from tools.bench.tracker_lines import LineReader, Refused, TrackerPose
from tools.bench.tracker_source import Came, Datagram, Heard, Octets, Source, Went, open_source
from tools.records.data import Event, Series
from tools.words import away, ms, pace

if TYPE_CHECKING:
    from collections.abc import Iterable

    from firmware_model.trace import Channel
    from spi_bus.transports.base import Waitable
    from tools.bench.pace import LineScheduler
    from tools.configuration import Scenario

COLUMNS: Final = ("x_m", "y_m", "heading_rad")
"""Channels that a tracker fills."""
TOLD: Final = 5
"""Refused lines that are told at once; all are counted."""
WINDOW_S: Final = 60.0
"""How long a delay counts as the least: at 100 ppm the clocks part by 6 ms in that time."""
JUMP_S: Final = 2.0
"""A stamp that leads its arrival by so much more than ever is of a clock that was set. Less may be
what had waited at the start coming all at once."""
BACK_S: Final = 1.0
"""A stamp that goes back by more is of a clock that was set; by less, of a pose out of order."""
STALE_S: Final = 1.0
"""An older pose is not sent to the robot: it would take it for where it is."""
GAP_INTERVALS: Final = 2.5
"""A gap is this many times the median interval between poses."""


@dataclass(frozen=True, slots=True)
class Seen:
    """A pose and its times, both in seconds of the run."""

    exposed_s: float
    arrived_s: float
    pose: TrackerPose


class LeastDelay:
    """Running offset between two clocks: the least (arrival − stamp) of the last `WINDOW_S`."""

    __slots__ = ("_delays",)

    def __init__(self) -> None:
        self._delays: deque[tuple[float, float]] = deque()  # arrival, delay; delays increase

    def note(self, stamp_s: float, arrived_s: float) -> float:
        """Take a pair; return the offset that turns a stamp into a time of arrival at best."""
        delays, delay = self._delays, arrived_s - stamp_s
        while delays and delays[-1][1] >= delay:
            delays.pop()
        delays.append((arrived_s, delay))
        while delays[0][0] < arrived_s - WINDOW_S:
            delays.popleft()
        return delays[0][1]

    @property
    def offset_s(self) -> float | None:
        """The offset so far."""
        return self._delays[0][1] if self._delays else None


@dataclass(slots=True)
class _Span:
    """Poses of one run of the tracker's clock."""

    clock: BoardClock = field(default_factory=BoardClock)
    least: LeastDelay = field(default_factory=LeastDelay)
    poses: list[tuple[float, float, float, float, float]] = field(default_factory=list)
    """Stamp, arrival in seconds of the run, x, y, heading."""
    stamps: set[float] = field(default_factory=set)
    """The last few, to know a repetition."""
    latest_s: float = -math.inf
    stream: int = 0
    """Of the latest pose."""


class Tracker:
    """The tracker of a run; a member of its `LineGroup`.

    Args:
        config: its `[hil]` names the tracker.
        clock: monotonic, in seconds; the scheduler's.
        tell: hears a line about what is wrong, at once.

    Raises:
        ScenarioError: the place that it talks to cannot be opened.

    """

    def __init__(
        self,
        config: Scenario,
        clock: Callable[[], float] = time.monotonic,
        tell: Callable[[str], None] = lambda words: None,
    ) -> None:
        hil = config.hil
        self.url = hil.camera
        self.outages = LineOutages()
        self.scheduler: LineScheduler | None = None
        self.newest: Seen | None = None
        """The pose that was exposed last, of those that have come."""
        self.sent_age = DurationHistogram()
        """Age of the poses that went to the robot, from exposure."""
        self.withheld = 0
        """Times at which a pose was due to the robot and none was fresh."""
        self._clock = clock
        self._tell = tell
        self._wanted_id = hil.camera_id
        self._stamps = hil.camera_clock
        self._least_quality = hil.camera_least_quality
        self._tank = (config.tank.corner_m, config.tank.size_m)
        self._channel: Channel | None = None
        with named_by("camera"):
            self._source: Source = open_source(self.url, clock, self.outages.note)
        self.where = self._source.description
        self._reader = LineReader()
        self._waiting: list[tuple[float, int, TrackerPose]] = []
        self._stream = 0  # counts connections
        self._spans = [_Span()]
        self._refused: Counter[str] = Counter()
        self._first_refused: list[tuple[float, Refused]] = []
        self._counts: Counter[str] = Counter()
        self._others: Counter[str] = Counter()
        self._connected = not self.url.startswith(("listen:", "udp:"))
        self._longest_silence_s = 0.0
        self._last_arrival_s: float | None = None

    def start(self, scheduler: LineScheduler, channel: Channel) -> None:
        """Begin: poses are recorded in `channel` as they arrive."""
        self.scheduler, self._channel = scheduler, channel

    # --- a member of the group -------------------------------------------------------------

    def waitables(self) -> list[Waitable]:
        """Return what to wait on."""
        return self._source.waitables()

    def poll(self) -> bool:
        """Read what has come; return whether there are poses among it."""
        heard = self._source.read()
        if heard:
            arrived_s = self._clock()
            self._waiting += [(arrived_s, *pose) for pose in self._poses(heard)]
        return bool(self._waiting)

    def on_incoming(self) -> None:
        """Take the poses in, at the emulated time of their arrival."""
        waiting, self._waiting = self._waiting, []
        for arrived_s, stream, pose in waiting:
            self._take(arrived_s, stream, pose)

    def _poses(self, heard: Iterable[Heard]) -> list[tuple[int, TrackerPose]]:
        poses = []
        reader = self._reader
        for item in heard:
            found: list[TrackerPose | Refused] = []
            match item:
                case Octets(data):
                    found += reader.receive(data)
                case Datagram(data):
                    self._connected = True
                    found += [*reader.receive(data), *reader.end(whole=True)]
                case Came(_):
                    self._connected = True
                    self._counts["connections"] += 1
                    self._stream += 1
                case Went(_):
                    found += reader.end()
            for one in found:
                if isinstance(one, Refused):
                    self._refuse(one)
                else:
                    poses.append((self._stream, one))
        return poses

    def _refuse(self, refused: Refused) -> None:
        self._refused[refused.fault.value] += 1
        if len(self._first_refused) < TOLD:
            self._first_refused.append((self._run_s(self._clock()), refused))
            self._tell(f"camera: {refused}")
            if len(self._first_refused) == TOLD:
                self._tell("camera: further lines that are no pose are counted only")

    def _take(self, arrived_host_s: float, stream: int, pose: TrackerPose) -> None:
        counts = self._counts
        if not self._is_ours(pose):
            return
        if pose.quality < self._least_quality:
            counts["poor"] += 1
            return
        arrived_s = self._run_s(arrived_host_s)
        span = self._spans[-1]
        offset_s = span.least.offset_s
        went_back = pose.time_s < span.latest_s - BACK_S
        ahead = offset_s is not None and arrived_s - pose.time_s < offset_s - JUMP_S
        # Within a connection poses may be out of order; a new one never begins with an old pose.
        restarted = stream != span.stream and pose.time_s <= span.latest_s
        if went_back or ahead or restarted:
            counts["clock_resets"] += 1
            span = _Span()
            self._spans.append(span)
        span.stream = stream
        if pose.time_s in span.stamps:
            counts["repeated"] += 1
            return
        span.stamps.add(pose.time_s)
        if len(span.stamps) > 1000:
            span.stamps = {stamp for stamp in span.stamps if stamp > pose.time_s - BACK_S}
        counts["poses"] += 1
        if self._last_arrival_s is not None:
            silence_s = arrived_s - self._last_arrival_s
            self._longest_silence_s = max(self._longest_silence_s, silence_s)
        self._last_arrival_s = arrived_s
        in_order = pose.time_s > span.latest_s
        if not in_order:
            counts["out_of_order"] += 1
        (x0, y0), (width, height) = self._tank
        if not (x0 <= pose.x_m <= x0 + width and y0 <= pose.y_m <= y0 + height):
            counts["outside_tank"] += 1
            if counts["outside_tank"] == 1:
                self._tell(
                    f"camera: ({pose.x_m:g}, {pose.y_m:g}) m is outside the tank, which is "
                    f"{width:g} m by {height:g} m from ({x0:g}, {y0:g}): are [tank] corner_m and "
                    "size_m, and the tracker's frame, right?"
                )
        span.latest_s = max(span.latest_s, pose.time_s)
        span.clock.note(pose.time_s, arrived_s)
        least_s = span.least.note(pose.time_s, arrived_s)
        span.poses.append((pose.time_s, arrived_s, pose.x_m, pose.y_m, pose.heading_rad))
        exposed_s = self._known_exposure(pose.time_s, arrived_host_s)
        if exposed_s is None:
            exposed_s = min(arrived_s, pose.time_s + least_s)
        if in_order:
            self.newest = Seen(exposed_s, arrived_s, pose)
        if self._channel is not None and self.scheduler is not None:
            self._channel.record(self.scheduler.now, (pose.x_m, pose.y_m, pose.heading_rad))

    def _is_ours(self, pose: TrackerPose) -> bool:
        """Whether a pose is of this robot; without `camera_id`, of the one that was seen first."""
        name = str(pose.id)
        if not self._wanted_id and name:
            self._wanted_id = name
        if name == self._wanted_id or not name:
            return True
        if name not in self._others:
            self._tell(
                f"camera: poses of {name!r}, too; taken are those of {self._wanted_id!r}: "
                "--camera-id chooses"
            )
        self._others[name] += 1
        return False

    def _run_s(self, host_s: float) -> float:
        return self.scheduler.emulated_s(host_s) if self.scheduler is not None else 0.0

    def _known_exposure(self, stamp_s: float, host_s: float) -> float | None:
        """Return when a pose was exposed, in seconds of the run, where the clock is this one's."""
        if self._stamps == "monotonic":
            return self._run_s(stamp_s)
        if self._stamps == "unix":
            return self._run_s(stamp_s - time.time() + self._clock())
        return None

    # --- for the host ----------------------------------------------------------------------

    def fresh(self, after: Seen | None) -> Seen | None:
        """Return the newest pose, if it is not `after` and not stale at the present time."""
        seen = self.newest
        assert self.scheduler is not None
        now_s = self.scheduler.now / FS_PER_S
        if seen is None or seen is after or now_s - seen.exposed_s > STALE_S:
            self.withheld += 1
            return None
        self.sent_age.record(now_s - seen.exposed_s)
        return seen

    # --- what is known at the end ------------------------------------------------------------

    def channels(self) -> dict[str, Series]:
        """Return what the tracker saw, at the times of exposure by the estimate of its clock."""
        rows: list[tuple[float, ...]] = []
        for span in self._spans:
            rows += [row for row in self._exposed(span) if row[0] >= 0.0]  # of before the run: none
        if not rows:
            return {}
        table = np.array(sorted(rows), dtype=np.float64)
        return {
            name: Series(table[:, 0].copy(), table[:, 2 + column].copy())
            for column, name in enumerate(COLUMNS)
        }

    def _exposed(self, span: _Span) -> list[tuple[float, ...]]:
        """Return a span's poses as (exposure, arrival, x, y, heading), in seconds of the run."""
        fit = span.clock.fit()
        least_s = span.least.offset_s or 0.0
        shift_s = 0.0
        if self._stamps != "own" and span.poses:
            stamp_s = span.poses[-1][0]
            known_s = self._known_exposure(stamp_s, self._clock())
            shift_s = 0.0 if known_s is None else known_s - stamp_s
        rows = []
        for stamp_s, arrived_s, *pose in span.poses:
            if self._stamps != "own":
                exposed_s = stamp_s + shift_s
            elif fit is not None:
                exposed_s = fit.host_s(stamp_s)
            else:
                exposed_s = stamp_s + least_s
            rows.append((exposed_s, arrived_s, *pose))
        return rows

    def events(self) -> list[Event]:
        """Comings and goings of the tracker, and the first lines that were refused."""
        told = []
        for event in self.outages.heard:
            at_s = max(0.0, self._run_s(event.time_s))
            if isinstance(event, OutageBegan):
                told.append(Event(at_s, "camera", f"gone: {event.reason}", "fault", "camera gone"))
            else:
                words = f"back after {event.duration_s:.2f} s"
                told.append(Event(at_s, "camera", words, label="camera back"))
        for at_s, refused in self._first_refused:
            told.append(Event(max(0.0, at_s), "camera", f"no pose: {refused}", "fault"))
        return told

    def diagnosis(self) -> str:
        """Why there was no pose, in a line; empty where there was one."""
        if self._counts["poses"]:
            return ""
        if not self._connected:
            return f"camera: nobody came to {self.where}: start the tracker, or name another place"
        if self._first_refused:
            count, first = self._refused.total(), self._first_refused[0][1]
            return f"camera: none of {count} lines of {self.where} was a pose; {first}"
        if self._others:
            ids = ", ".join(repr(name) for name in self._others)
            return f"camera: no pose of {self._wanted_id!r}, but of {ids}: --camera-id chooses"
        if self._counts["poor"]:
            return f"camera: all {self._counts['poor']} poses were below camera_least_quality"
        return f"camera: {self.where} said nothing: does the tracker see its markers?"

    def summary(self) -> dict[str, Any]:
        """Everything for a `summary.json`, under `hil.camera`."""
        counts = self._counts
        stamps = sorted(itertools.chain.from_iterable(self._intervals(s) for s in self._spans))
        median_s = stamps[len(stamps) // 2] if stamps else None
        longer_s = GAP_INTERVALS * median_s if median_s else None
        latency = DurationHistogram()
        for span in self._spans:
            for exposed_s, arrived_s, *_ in self._exposed(span):
                if exposed_s >= 0.0:
                    latency.record(arrived_s - exposed_s)
        fit = max(self._spans, key=lambda span: len(span.poses)).clock.fit(0.0)
        return {
            "url": self.url,
            "where": self.where,
            "diagnosis": self.diagnosis(),
            "poses": counts["poses"],
            "refused": dict(self._refused),
            "poor": counts["poor"],
            "repeated": counts["repeated"],
            "out_of_order": counts["out_of_order"],
            "outside_tank": counts["outside_tank"],
            "of_others": dict(self._others),
            "rate_hz": 1.0 / median_s if median_s else None,
            "gaps": {
                "count": sum(step > longer_s for step in stamps) if longer_s else 0,
                "longer_than_s": longer_s,
                "longest_s": stamps[-1] if stamps else None,
            },
            "longest_silence_s": self._longest_silence_s,
            "latency": {
                **latency.summary(),
                "is": "beyond the least" if self._stamps == "own" else "from exposure",
            },
            "clock": None if fit is None else asdict(fit),
            "clock_resets": counts["clock_resets"],
            "sent_to_robot": {**self.sent_age.summary(), "withheld": self.withheld},
            "outages": {**self.outages.summary(), "connections": counts["connections"]},
        }

    @staticmethod
    def _intervals(span: _Span) -> list[float]:
        stamps = sorted(row[0] for row in span.poses)
        return [b - a for a, b in itertools.pairwise(stamps)]

    def close(self) -> None:
        """Give its place back."""
        self._source.close()


def words(camera: dict[str, Any]) -> list[str]:
    """Lines on the tracker, for the terminal."""
    refused = sum(camera["refused"].values())
    rate = camera["rate_hz"]
    lines = [f"  {'camera':<14}{camera['where']}: {camera['poses']} poses"]
    if rate:
        lines[0] += f", {rate:.1f} a second"
    if refused:
        kinds = ", ".join(f"{count} {name}" for name, count in sorted(camera["refused"].items()))
        lines.append(f"  {'':<14}{refused} lines refused ({kinds.replace('_', ' ')})")
    odd = {
        "out of order": camera["out_of_order"],
        "repeated": camera["repeated"],
        "of poor quality": camera["poor"],
        "outside the tank": camera["outside_tank"],
        "of others": sum(camera["of_others"].values()),
    }
    if any(odd.values()):
        told = ", ".join(f"{count} {name}" for name, count in odd.items() if count)
        lines.append(f"  {'':<14}{told}")
    late, gaps, clock = camera["latency"], camera["gaps"], camera["clock"]
    if late["count"]:
        lines.append(
            f"  {'its latency':<14}median {ms(late['median_s'])}, p99 {ms(late['p99_s'])}, max "
            f"{ms(late['maximum_s'])} ({late['is']})"
        )
    if clock:
        lines.append(f"  {'its clock':<14}{pace(clock)}, set {camera['clock_resets']} times")
    if gaps["count"]:
        lines.append(
            f"  {'its gaps':<14}{gaps['count']} longer than {ms(gaps['longer_than_s'])}, longest "
            f"{gaps['longest_s']:.2f} s"
        )
    sent, out = camera["sent_to_robot"], camera["outages"]
    if sent["count"] or sent["withheld"]:
        lines.append(
            f"  {'poses sent':<14}{sent['count']}, median {ms(sent['median_s'])} old, max "
            f"{ms(sent['maximum_s'])}; {sent['withheld']} times none was fresh"
        )
    if out["outages"]:
        lines.append(f"  {'it was away':<14}{out['outages']} times, {away(out)}")
    return lines
