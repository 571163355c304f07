"""A survey by several robots, as one board sees it: what to share, where to swim.

There is no leader. Boards share what they sampled (`procboard.survey.items`), and everything that
is decided follows from what is known (`procboard.survey.knowledge`): which cells are wanted next,
who swims to which, who takes part, when the field is known. Boards that know the same decide the
same. Boards that do not, for a while, may sample a cell twice, which costs a way and harms nothing.

**A robot** first listens (``gather_ms``), so as to learn who is there and, after a reset, what it
has forgotten. It says where it begins, swims through its share of what is wanted, and rests when
that is done. It takes the mean of the readings while it passes a cell, or stops there.

| What happens | What follows |
|---|---|
| nothing was heard of a robot for ``silence_ms`` | who notices says so; its cells go to others |
| a robot hears that it is gone | it joins again, and shares are made anew |
| a cell is not reached within ``reach_ms`` | it goes to another robot; after two it is given up |
| a robot did not reach two cells running | it says that it is gone, and joins again later |
| this board was reset | own samples come from flash, others' from the network; then it joins |
| the base is out of range | nothing: it is a board like the others |
| no pose is known | the robot does not join |

State machine as those of `procboard.routing`: no clock, no radio. Items to share are taken by
`take_item`; once an item is on flash and has its number, it is handed to `receive` as others' are,
and not before then does it count. Times are ms of the board's crystal since its boot.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from procboard.errors import SurveyError
from procboard.survey.energy import EMULATED, EnergyModel
from procboard.survey.expansion import Expansion
from procboard.survey.items import ITEMS, RESOLUTION, Done, Gone, Item, Present, Sample, Skip
from procboard.survey.knowledge import Grid, Knowledge
from procboard.survey.outcome import Outcome, outcome, readings, stand_in
from procboard.survey.plan import Shares, planned
from procboard.survey.rank import Cell
from procboard.survey.sweeps import Place

FARTHEST_M: Final = 0.127
"""Of a sample from its cell's centre, as an item has it."""
LARGEST: Final = 2.0**31 * RESOLUTION - 1.0
"""Of a reading, in the field's unit, as an item has it."""
READINGS_KEPT: Final = 32
"""Three seconds at ten a second."""


@dataclass(frozen=True, slots=True)
class MissionConfig:
    """Constants of a mission, the same on all boards. Times are our choice, but where said."""

    grid: Grid
    reading_sigma: float = 0.0
    """Standard deviation of one reading's error, in the field's unit."""
    place_sigma: float = 0.0
    """What the error of a place makes of it: that of the robot times the field's slope."""
    before_ms: int = 1000
    """Readings of so long before an arrival count: it shows at the end of a tail beat."""
    dwell_ms: int = 0
    """Readings of so long after it count, and the robot rests meanwhile; 0: it passes."""
    gather_ms: int = 30_000
    """Twice what sharing needs for a hundred items at 30 % loss (docs/network.md)."""
    heartbeat_ms: int = 60_000
    """A robot that has shared nothing for so long says that it lives."""
    silence_ms: int = 200_000
    """Three heartbeats, and what the slowest news takes."""
    reach_ms: int = 180_000
    """For a cell, from where the robot is: the longest way to a target that was seen within 0.6 m
    is 49 s, with three poses in ten lost 235 s (docs/tracking.md)."""
    rest_ms: int = 600_000
    """A robot that could not go on tries again."""
    model: EnergyModel = EMULATED

    def __post_init__(self) -> None:
        """Refuse what cannot be carried out."""
        if not (0.0 <= self.reading_sigma < math.inf and 0.0 <= self.place_sigma < math.inf):
            raise SurveyError("mission: deviations are numbers from 0 on")
        if min(self.before_ms, self.dwell_ms, self.gather_ms) < 0:
            raise SurveyError("mission: before_ms, dwell_ms and gather_ms are not negative")
        if self.before_ms + self.dwell_ms == 0:
            raise SurveyError("mission: no readings count; before_ms or dwell_ms is above 0")
        if min(self.heartbeat_ms, self.reach_ms, self.rest_ms) <= 0:
            raise SurveyError("mission: heartbeat_ms, reach_ms and rest_ms are above 0")
        if self.silence_ms < 2 * self.heartbeat_ms:
            raise SurveyError("mission: silence_ms is two heartbeats or more: one may be late")

    def deviation(self, count: int) -> float:
        """Standard deviation of a sample of so many readings, in the field's unit."""
        return max(math.hypot(self.reading_sigma / math.sqrt(count), self.place_sigma), RESOLUTION)


class Phase(IntEnum):
    """How far a mission is, for all that a board knows."""

    GATHERING = 0
    SURVEYING = 1
    COMPLETE = 2


class Mission:
    """One board's part.

    Args:
        address: the board's.
        config: what all boards have alike.
        survey: makes the survey in its first state, the same on all boards.
        robot: False for a base, which knows and decides likewise, and does not swim.

    """

    def __init__(
        self,
        address: int,
        config: MissionConfig,
        survey: Callable[[], Expansion],
        *,
        robot: bool = True,
    ) -> None:
        self.address = address
        self.config = config
        self.knowledge = Knowledge(config.grid)
        self.clock_offset_ms = 0
        """Of the boards' common time, for the time of samples."""
        self.bad_readings = 0
        self._fresh = survey
        self._survey = survey()
        self._robot = robot
        self._to_share: deque[Item] = deque()
        self._awaited: list[Item] = []
        """Of ours, that have not come back from flash."""
        self._place: Place | None = None
        self._readings: deque[tuple[int, float]] = deque(maxlen=READINGS_KEPT)
        self._heard_ms: dict[int, int] = {}
        self._shared_ms = 0
        self._gathered_ms: int | None = None
        self._joins = robot
        self._failures = 0
        self._resting_ms: int | None = None
        self._goal: Cell | None = None
        self._goal_ms = 0
        self._sampling: tuple[int, int, Place] | None = None
        self._plan_of: object = None
        self._plan: Shares = {}

    def start(self, now_ms: int) -> None:
        """Begin to listen; own items from flash have been handed to `receive` before."""
        self._gathered_ms = now_ms + self.config.gather_ms
        self._shared_ms = now_ms
        self._heard_ms = dict.fromkeys(self._heard_ms, now_ms)
        self._decide(now_ms)

    # --- what comes in ------------------------------------------------------------------

    def receive(self, origin: int, number: int, octets: bytes, now_ms: int) -> None:
        """Take an item of any board, this one included, that this board holds now."""
        item = self.knowledge.receive(origin, number, octets)
        self._heard_ms[origin] = now_ms
        if origin == self.address:
            self._shared_ms = now_ms
            self._awaited = [mine for mine in self._awaited if ITEMS.encode(mine) != octets]
        if isinstance(item, Sample):
            reading = self.knowledge.reading(item.cell)
            assert reading is not None
            self._survey.correct(item.cell, reading.value)
        self._decide(now_ms)

    def hear(self, address: int, now_ms: int) -> None:
        """A frame of a robot was heard at that time, so it lived then."""
        if address in self._heard_ms:
            self._heard_ms[address] = max(now_ms, self._heard_ms[address])

    def tell_pose(self, x_m: float, y_m: float, now_ms: int) -> None:
        """Note where this robot is."""
        first, self._place = self._place is None, (x_m, y_m)
        if first:
            self._decide(now_ms)

    def tell_reading(self, value: float, now_ms: int) -> None:
        """Note a reading of the field; one that is no number, or too large, counts as bad."""
        if abs(value) <= LARGEST:
            self._readings.append((now_ms, value))
        else:
            self.bad_readings += 1

    def arrive(self, x_m: float, y_m: float, now_ms: int) -> None:
        """The robot has come by its target; the readings of the time were taken about there."""
        if self._goal is None or self._sampling is not None:
            return
        x, y = self.config.grid.centre(self._goal)
        if max(abs(x_m - x), abs(y_m - y)) > FARTHEST_M:
            return
        self._sampling = now_ms - self.config.before_ms, now_ms + self.config.dwell_ms, (x_m, y_m)
        self.handle_timer(now_ms)

    # --- what goes out ------------------------------------------------------------------

    def take_item(self) -> bytes | None:
        """Return the next item to be stored, numbered and shared."""
        return ITEMS.encode(self._to_share.popleft()) if self._to_share else None

    @property
    def phase(self) -> Phase:
        """How far the mission is."""
        if self._survey.done:
            return Phase.COMPLETE
        return Phase.GATHERING if self._gathered_ms is not None else Phase.SURVEYING

    @property
    def goal(self) -> Cell | None:
        """The cell that this robot is to sample next; None: rest."""
        return self._goal

    @property
    def target(self) -> Place | None:
        """Where to swim; None: rest, for want of a cell or while sampling one."""
        return None if self._goal is None or self._sampling else self.config.grid.centre(self._goal)

    @property
    def answered(self) -> int:
        """Requests that the survey has worked on so far; what each costs is in `survey.cost`."""
        return self._survey.answered

    @property
    def lines(self) -> int:
        """Rows or columns that the survey has made its basis."""
        return self._survey.lines

    @property
    def plan(self) -> Shares:
        """Cells of the present request in order, by robot, sampled ones included."""
        return self._plan

    @property
    def agreed(self) -> bool:
        """Whether all that live have said that the field is known, from the samples known here."""
        digest = self.knowledge.digest()
        told = [self.knowledge.done(robot) for robot in self._living()]
        return self._survey.done and all(done and done.digest == digest for done in told)

    def outcome(self) -> Outcome:
        """Return the field as far as it is known."""
        return outcome(self.knowledge, self._survey, self._fresh)

    def next_deadline(self) -> int | None:
        """Return when `handle_timer` is wanted."""
        config = self.config
        due = []
        if self._sampling is not None:
            due.append(self._sampling[1])
        if self._goal is not None:
            due.append(self._goal_ms + config.reach_ms)
        if self._gathered_ms is not None:
            due.append(self._gathered_ms)
        if self._resting_ms is not None:
            due.append(self._resting_ms)
        if self.knowledge.lives(self.address):  # who is not among them says nothing of others
            due += [self._heard_ms[robot] + config.silence_ms for robot in self._others()]
            due.append(self._shared_ms + config.heartbeat_ms)
        return min(due, default=None)

    def handle_timer(self, now_ms: int) -> None:
        """Do what is due."""
        config = self.config
        if self._sampling is not None and now_ms >= self._sampling[1]:
            self._sample(now_ms)
        if self._goal is not None and now_ms >= self._goal_ms + config.reach_ms:
            self._give_away(self._goal, now_ms)
        if self._gathered_ms is not None and now_ms >= self._gathered_ms:
            self._gathered_ms = None
        if self._resting_ms is not None and now_ms >= self._resting_ms:
            self._resting_ms, self._joins = None, True
        if self.knowledge.lives(self.address):
            for robot in self._others():
                if now_ms >= self._heard_ms[robot] + config.silence_ms:
                    self._heard_ms[robot] = now_ms  # said once, until it has come back from flash
                    self._share(Gone(robot, self.knowledge.latest[robot]))
        if self.knowledge.lives(self.address) and now_ms >= self._shared_ms + config.heartbeat_ms:
            self._shared_ms = now_ms
            if self._place is not None:
                self._share(Present(*self._place, joined=False))
        self._decide(now_ms)

    # --- sampling -----------------------------------------------------------------------

    def _sample(self, now_ms: int) -> None:
        assert self._sampling is not None
        assert self._goal is not None
        (first_ms, last_ms, (x, y)), self._sampling = self._sampling, None
        values = [value for at, value in self._readings if first_ms <= at <= last_ms]
        if not values:  # the sensor is silent: come by again, until the time for this cell is over
            return
        self._failures = 0
        row, column = self._goal
        centre_x, centre_y = self.config.grid.centre(self._goal)
        self._share(
            Sample(
                row,
                column,
                math.fsum(values) / len(values),
                self.config.deviation(len(values)),
                len(values),
                x - centre_x,
                y - centre_y,
                now_ms + self.clock_offset_ms & 0xFFFFFFFF,
            )
        )

    def _give_away(self, cell: Cell, now_ms: int) -> None:
        """Say that a cell was not reached; after two running, that this robot cannot go on."""
        self._goal_ms = now_ms
        self._sampling = None
        self._failures += 1
        self._share(Skip(*cell, final=False))
        if self._failures >= 2:
            self._failures = 0
            self._resting_ms = now_ms + self.config.rest_ms
            self._share(Gone(self.address, 0))

    # --- deciding -----------------------------------------------------------------------

    def _decide(self, now_ms: int) -> None:
        """Draw the consequences of what is known now."""
        self._fill_in()
        if self._robot:
            self._take_part()
            self._say_final()
            self._say_done()
        goal = self._next_goal()
        if goal != self._goal:
            self._goal, self._goal_ms, self._sampling = goal, now_ms, None

    def _fill_in(self) -> None:
        missing = self.knowledge.given_up()
        if missing:
            known = readings(self.knowledge)
            for cell in missing:
                self._survey.correct(cell, stand_in(cell, known).value)

    def _take_part(self) -> None:
        """Join, at the begin and where others take this robot for gone."""
        if self._gathered_ms is not None or self._resting_ms is not None or self._place is None:
            return
        if self._awaits(Present) or self._awaits(Gone):
            return
        if self._joins or not self.knowledge.lives(self.address):
            self._joins = False
            self._share(Present(*self._place, joined=True))

    def _say_final(self) -> None:
        """Give up cells that nobody is left to try."""
        living = set(self._living())
        if self.address not in living or self._awaits(Skip):
            return
        for cell in self._survey.wanted():
            if self.knowledge.skips.get(cell, set()) >= living:
                self._share(Skip(*cell, final=True))
                return

    def _say_done(self) -> None:
        if not (self._survey.done and self.knowledge.lives(self.address)) or self._awaits(Done):
            return
        done = Done(len(self.knowledge.samples), self.knowledge.digest())
        if self.knowledge.done(self.address) != done:
            self._share(done)

    def _next_goal(self) -> Cell | None:
        """Return the first cell of this robot's share that is still wanted."""
        survey, knowledge = self._survey, self.knowledge
        if self._gathered_ms is not None or survey.done:
            self._plan, self._plan_of = {}, None
            return None
        used = survey.used
        cells = tuple(sorted(set(survey.request) - used))
        poses = knowledge.poses(used)
        skips = {cell: set(knowledge.skips[cell]) for cell in cells if cell in knowledge.skips}
        if (cells, poses, skips) != self._plan_of:
            self._plan_of = cells, poses, skips
            self._plan = planned(cells, poses, skips, self.config.grid, self.config.model)
        if self._resting_ms is not None:
            return None
        underway = {item.cell for item in self._awaited if isinstance(item, Sample | Skip)}
        wanted = set(survey.wanted()) - underway
        return next((cell for cell in self._plan.get(self.address, ()) if cell in wanted), None)

    # --- helpers ------------------------------------------------------------------------

    def _share(self, item: Item) -> None:
        self._to_share.append(item)
        self._awaited.append(item)

    def _awaits(self, kind: type[Item]) -> bool:
        return any(isinstance(item, kind) for item in self._awaited)

    def _living(self) -> list[int]:
        return [robot for robot in sorted(self.knowledge.latest) if self.knowledge.lives(robot)]

    def _others(self) -> list[int]:
        return [robot for robot in self._living() if robot != self.address]
