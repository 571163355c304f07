"""The assembler: a scenario becomes a robot, a host, the air and the water, on one clock.

Everything that runs an emulated robot comes through `Bench.from_scenario`: the command line, tests,
the benchmark. The bench knows no file and no wall clock; it is stepped in slices so that somebody
may watch or interrupt, and slicing changes nothing in what happens.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from firmware_model.scheduler import RealTimeScheduler, Scheduler
from firmware_model.time import FS_PER_MS, FS_PER_S
from firmware_model.trace import Trace
from plant.errors import DivergedError
from radio_802154.medium import Medium, MediumConfig
from tools.bench import account, model, tracking
from tools.bench.difference import difference, objection
from tools.bench.faults import Faults
from tools.bench.host import Host
from tools.bench.live import Live
from tools.bench.outcome import outcome
from tools.bench.overhead import InView
from tools.bench.plant_port import PlantPort
from tools.bench.recorder import AirRecorder, Recorder
from tools.bench.robot import Robot
from tools.bench.stepping import lateness, run_to_the_end
from tools.errors import ScenarioError
from tools.hil_section import Hil
from tools.records.changes import changes
from tools.records.data import Comparison, FloatArray, RunData, TailShape
from tools.records.metrics import last_motion
from tools.records.read import tank_view
from tools.version import version

if TYPE_CHECKING:
    from tools.configuration import Scenario

PIECE = 4
"""Records of the trace that are handed on at once in real time: a millisecond's work (spi.vcd takes
7 µs a byte, and a record of the wires holds 48 bytes)."""
WARM_UP_FS = 1000 * FS_PER_MS
"""Long enough for the boards to boot and the tail to beat: all code of a run has run once."""


class Bench:
    """One robot with its base station, ready to run."""

    def __init__(
        self,
        config: Scenario,
        scheduler: Scheduler,
        live: Live | None = None,
        *,
        keep: bool = True,
        port: PlantPort | None = None,
    ) -> None:
        """Put it together; without `keep` nothing is kept for `run_data`, see `from_scenario`.

        With a `port`, or one of `live`, the navigation board's chips are at its other end.
        """
        self.config = config
        self.scheduler = scheduler
        self.trace = trace = Trace()
        self.medium = Medium(
            scheduler,
            MediumConfig(loss_probability=config.radio.loss_probability),
            seed=config.scenario.seed,
            channel=trace.channel("radio"),
        )
        self.live = live
        self.real = real = live.real if live else None
        port = live.plant if live is not None else port
        self.robot = Robot(
            config,
            scheduler,
            trace,
            self.medium,
            real.line if real else None,
            port.start(scheduler) if port else None,
            keep=keep,
        )
        if port is not None:
            port.fit(self.robot.nav)
        robot = InView(config.procboard.address, self.robot.vehicle)
        self.host = Host(config, scheduler, trace, self.medium, (robot,), live)
        self.faults = Faults(config, scheduler, self.robot)
        kept = trace if keep else Trace()
        self.recorder = Recorder(kept, config.navboard.clock_drift_ppm)
        self.air = AirRecorder(kept)
        self.interrupted = False
        if isinstance(scheduler, RealTimeScheduler):
            scheduler.spare = lambda: trace.flush_some(PIECE)
        if real is not None:
            real.watch(self.robot, trace)
        if live is not None and live.mote is not None:
            live.mote.attach(live.scheduler, self.medium)
            self.host.heard = live.mote.telemetry.note

    @classmethod
    def from_scenario(
        cls,
        config: Scenario,
        *,
        speed: float | None = None,
        announce: Callable[[str], None] = lambda where: None,
        keep: bool = True,
    ) -> Bench:
        """Put a scenario together; `speed` is the multiple of real time to keep to, None: none.

        Against the clock, a throw-away robot swims first: compiled code and late imports must be
        loaded before the first deadline. With somebody from outside the pace is 1, whatever was
        asked for, and `announce` is told who is expected where as soon as the lines are open;
        close such a bench. One that does not `keep` runs for days in bounded memory and has no
        `run_data`, only its `live.summary`.

        Raises `ScenarioError` where that line cannot be opened, or another pace is wanted.
        """
        if config.hil.plant_for:
            raise ScenarioError("hil.plant_for: there is no robot around it: fishbed hil or run")
        if config.shoal.robots:
            raise ScenarioError(
                f"shoal.robots = {config.shoal.robots}: several robots: fishbed run"
            )
        if config.hil.live:
            if speed not in (None, 1.0):
                raise ScenarioError(f"hil: the world outside cannot run {speed:g} times as fast")
            live = Live(config, keep=keep)
            try:
                for place in live.places():
                    announce(place)
                cls.warm_up(config)
                bench = cls(config, live.scheduler, live, keep=keep)
                for place in live.ready_places():
                    announce(place)
            except BaseException:
                live.close()
                raise
            return bench
        if speed is None:
            return cls(config, Scheduler())
        cls.warm_up(config)
        return cls(config, RealTimeScheduler(speed))

    @classmethod
    def warm_up(cls, config: Scenario) -> None:
        """Let a throw-away robot swim, so that all code of a run has run once."""
        emulated = msgspec.structs.replace(config, hil=Hil())
        with contextlib.suppress(DivergedError):  # the run itself will meet it, and say so
            cls(emulated, Scheduler()).scheduler.run(WARM_UP_FS)

    def close(self) -> None:
        """Give the lines to the world outside back."""
        if self.live is not None:
            self.live.close()

    def run(self, progress: Callable[[float], None], interrupted: Callable[[], bool]) -> None:
        """Run the scenario's duration, telling `progress` the seconds done and asking to go on.

        Raises `ScenarioError` where the scenario's parameters let the motion diverge.
        """
        live = self.live
        self.interrupted = run_to_the_end(
            self.config,
            self.scheduler,
            (self.robot,),
            progress,
            lambda: interrupted() or (live is not None and live.stops),
        )

    def run_data(self, *, compare: bool = True) -> RunData:
        """Return all that the run knows about itself.

        Without `compare` the plant alone does not swim beside it, which no metric needs.
        """
        self.trace.flush()
        config, recorder = self.config, self.recorder
        swum = outcome(
            config,
            self.robot,
            recorder,
            self.scheduler.now,
            self.host.telemetry.total(),
            self.live.channels() if self.live is not None else None,
        )
        truth, metrics = swum.truth, swum.metrics
        comparison: tuple[Comparison, ...] = ()
        note = "it was interrupted" if self.interrupted else objection(config)
        if not compare:
            note = "nobody asked"
        servo = self.robot.vehicle.servo
        if not note and self.robot.power.volts < servo.least_voltage_v:
            note = "its battery ran down"
        if not note:
            comparison = difference(config, self.robot.parameters, self.robot.power.volts, metrics)
        events = [
            *swum.events,
            *self.host.events,
            *(self.live.events() if self.live is not None else ()),
            *self.faults.events,
        ]
        return RunData(
            scenario=config.scenario.name,
            description=config.scenario.description,
            seed=config.scenario.seed,
            duration_s=self.scheduler.now / FS_PER_S,
            wall_s=0.0,
            version=version(),
            trace_sha256=self.trace.sha256(),
            tank=tank_view(config),
            metrics=metrics,
            truth=truth,
            changes=changes(config),
            tail_shape=self._tail_shape(truth, swum.beat_hz),
            truth_every=model.truth_steps(config)[1],
            channels=swum.channels,
            beat_frequency_hz=swum.beat_hz,
            interrupted=self.interrupted,
            spi_frames=swum.spi_frames,
            radio_frames=self.air.radio_frames(),
            energy=self.robot.power.table() if config.hil.emulates_robot else (),
            comparison=comparison,
            comparison_note=note,
            events=tuple(sorted(events, key=lambda event: event.time_s)),
            outages=self.robot.power.outages,
            commands=self.host.commands(),
            links=account.link_ends(self.robot),
            mounts=account.mounts(self.robot.proc.mounts),
            targets=swum.visits,
            switches=tracking.switches(recorder.tracking),
            lateness=lateness(self.scheduler),
            hil=self.live.summary() if self.live is not None else {},
        )

    def _tail_shape(self, truth: dict[str, FloatArray], beat_hz: float) -> TailShape | None:
        """A flexible tail over the last beat, or over all of a run that is shorter."""
        time, rate = truth["time_s"], truth["tail_rate_rad_s"]
        bends = self.robot.parameters.tail.flexible
        if not bends or not rate.any() or beat_hz <= 0.0:
            return None
        end = last_motion(rate) + 1
        begin = int(np.searchsorted(time, time[end - 1] - 1.0 / beat_hz - 1e-9))
        points = self.robot.vehicle.tail_points(self.scheduler.now, time.size - begin)
        return TailShape(time[begin:end], points[: end - begin])
