"""The assembler of a shoal: a scenario becomes several robots, a host, the air and the water.

As `tools.bench.Bench` does for one: the robots are of the same parts, on one clock, and one medium
knows where their antennas truly are. Robots do not touch each other in the water (their wakes and
bodies do not meet); what they share is the tank, the air, and the camera above.

Every robot's trace channels begin with its name. What is kept is less dense than of one robot, for
there may be a hundred of them.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from firmware_model.scheduler import Priority, RealTimeScheduler, Scheduler
from firmware_model.time import FS_PER_S, from_seconds
from firmware_model.trace import Trace
from plant.errors import DivergedError
from radio_802154.medium import Medium, MediumConfig
from tools.bench import account
from tools.bench.bench import PIECE, WARM_UP_FS
from tools.bench.faults import Faults
from tools.bench.host import Host
from tools.bench.outcome import outcome
from tools.bench.overhead import InView
from tools.bench.recorder import Recorder
from tools.bench.robot import Robot
from tools.bench.stepping import lateness, run_to_the_end
from tools.records.changes import changes
from tools.records.data import Event
from tools.records.read import tank_view
from tools.records.shoal_data import Hearing, ShoalData, SwumRobot
from tools.records.survey_data import BASE, SurveyData
from tools.shoal.base_survey import BaseSurvey
from tools.shoal.hearing import Tally
from tools.shoal.members import Member, members
from tools.shoal.survey_outcome import survey_data
from tools.shoal.whole import whole
from tools.survey_section import surveys
from tools.version import version

if TYPE_CHECKING:
    from tools.configuration import Scenario


class ShoalBench:
    """Several robots with their base station, ready to run."""

    def __init__(self, config: Scenario, scheduler: Scheduler) -> None:
        self.config = config
        self.scheduler = scheduler
        self.trace = trace = Trace()
        self.medium = Medium(
            scheduler,
            MediumConfig(loss_probability=config.radio.loss_probability),
            seed=config.scenario.seed,
            channel=trace.channel("radio"),
        )
        self.members = members(config)
        self.robots = tuple(self._robot(member) for member in self.members)
        in_view = [
            InView(member.address, robot.vehicle, member.name)
            for member, robot in zip(self.members, self.robots, strict=True)
        ]
        self.host = Host(config, scheduler, trace, self.medium, in_view)
        self.survey: BaseSurvey | None = None
        """What the base's host knows of a survey."""
        if surveys(config):
            assert self.host.base is not None
            self.survey = BaseSurvey(config, scheduler, self.host.base)
        self.faults = tuple(
            Faults(member.config, scheduler, robot)
            for member, robot in zip(self.members, self.robots, strict=True)
        )
        names = {f"{member.name}.proc": member.name for member in self.members}
        self.tally = Tally(self.medium, {**names, "base": "base"})
        self.recorders = tuple(
            Recorder(trace, member.config.navboard.clock_drift_ppm, member.name, frames=False)
            for member in self.members
        )
        self.interrupted = False
        if isinstance(scheduler, RealTimeScheduler):
            scheduler.spare = lambda: trace.flush_some(PIECE)

    def _robot(self, member: Member) -> Robot:
        """Put one together, and see to it that it is switched on."""
        scheduler, at_fs = self.scheduler, from_seconds(member.switch_on_s)
        robot = Robot(
            member.config, scheduler, self.trace, self.medium, name=member.name, on=at_fs == 0
        )
        if at_fs:
            scheduler.at(at_fs, robot.power.restore, Priority.OBSERVER)
        return robot

    @classmethod
    def from_scenario(
        cls,
        config: Scenario,
        *,
        speed: float | None = None,
        announce: Callable[[str], None] = lambda where: None,
    ) -> ShoalBench:
        """Put a scenario together; `speed` is the multiple of real time to keep to, None: none.

        Against the clock a throw-away shoal swims first. Nobody is expected from outside, so
        nothing is announced.
        """
        del announce
        if speed is None:
            return cls(config, Scheduler())
        with contextlib.suppress(DivergedError):  # the run itself will meet it, and say so
            cls(config, Scheduler()).scheduler.run(WARM_UP_FS)
        return cls(config, RealTimeScheduler(speed))

    def close(self) -> None:
        """Give back what is held outside: nothing."""

    def run(self, progress: Callable[[float], None], interrupted: Callable[[], bool]) -> None:
        """Run the scenario's duration, telling `progress` the seconds done and asking to go on.

        A survey ends with its mission where the scenario says so. Raises `ScenarioError` where the
        scenario's parameters let the motion diverge.
        """
        survey = self.survey if self.config.survey.ends_run else None

        def over() -> bool:
            return survey is not None and survey.over

        stopped = run_to_the_end(
            self.config,
            self.scheduler,
            self.robots,
            progress,
            lambda: interrupted() or over(),
        )
        self.interrupted = stopped and not over()

    def run_data(self) -> ShoalData:
        """Return all that the run knows about itself."""
        self.trace.flush()
        config, host = self.config, self.host
        events = [*host.events, *(self.survey.events if self.survey is not None else ())]
        swum = []
        for member, robot, recorder, faults in zip(
            self.members, self.robots, self.recorders, self.faults, strict=True
        ):
            found = outcome(
                member.config,
                robot,
                recorder,
                self.scheduler.now,
                host.telemetry[member.address],
            )
            events += [_of(member.name, event) for event in (*found.events, *faults.events)]
            swum.append(
                SwumRobot(
                    member.name,
                    member.address,
                    found.metrics,
                    found.truth,
                    found.channels,
                    found.beat_hz,
                    robot.power.table(),
                    account.link_ends(robot),
                    account.mounts(robot.proc.mounts),
                    robot.power.outages,
                )
            )
        base, hearing = host.base, self.tally.hearing()
        assert base is not None  # nobody else stands in its place
        traffic = base.sent_messages, base.received_messages
        return ShoalData(
            scenario=config.scenario.name,
            description=config.scenario.description,
            seed=config.scenario.seed,
            duration_s=self.scheduler.now / FS_PER_S,
            wall_s=0.0,
            version=version(),
            trace_sha256=self.trace.sha256(),
            tank=tank_view(config),
            robots=tuple(swum),
            whole=whole(swum, hearing, traffic),
            hearing=hearing,
            changes=changes(config),
            interrupted=self.interrupted,
            events=tuple(sorted(events, key=lambda event: event.time_s)),
            commands=host.commands(),
            lateness=lateness(self.scheduler),
            survey=self._survey_data(swum, hearing),
        )

    def _survey_data(self, swum: Sequence[SwumRobot], hearing: Hearing) -> SurveyData | None:
        if self.survey is None:
            return None
        base, parents = self.config.base_station.address, []
        for member, robot in zip(self.members, self.robots, strict=True):
            services = robot.proc.services
            routing = services.routing if services is not None else None
            if routing is not None and routing.collection.tree.parent is not None:
                parent = routing.collection.tree.parent
                parents.append((member.address, BASE if parent == base else parent))
        return survey_data(self.survey, swum, hearing, tuple(parents))


def _of(name: str, event: Event) -> Event:
    """Say whose an event is; labels are for charts of one robot."""
    return Event(event.time_s, f"{name}, {event.where}", event.what, event.severity)
