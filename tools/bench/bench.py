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
from firmware_model.time import FS_PER_MS, FS_PER_S, from_seconds
from firmware_model.trace import Trace
from plant.errors import DivergedError
from radio_802154.medium import Medium, MediumConfig
from spi_bus.errors import TransportLost
from tools.bench import account, model, tracking, wrong
from tools.bench.difference import difference, objection
from tools.bench.faults import Faults
from tools.bench.host import Host
from tools.bench.live import Live
from tools.bench.overhead import InView
from tools.bench.plant_port import PlantPort
from tools.bench.recorder import Recorder
from tools.bench.robot import Robot
from tools.errors import ScenarioError
from tools.hil_section import Hil
from tools.records.changes import changes
from tools.records.data import Comparison, FloatArray, Metric, RunData, Series, TailShape
from tools.records.metrics import last_motion, path_metrics
from tools.records.read import tank_view
from tools.version import version

if TYPE_CHECKING:
    from tools.configuration import Scenario

SLICE_FS = 50 * FS_PER_MS
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
        self.recorder = Recorder(trace if keep else Trace(), config.navboard.clock_drift_ppm)
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
        scheduler = self.scheduler
        end_fs = from_seconds(self.config.scenario.duration_s)
        try:
            while scheduler.now < end_fs:
                if interrupted() or (self.live is not None and self.live.stops):
                    self.interrupted = True
                    break
                scheduler.run(min(end_fs, scheduler.now + SLICE_FS))
                progress(scheduler.now / FS_PER_S)
            self.robot.vehicle.advance(scheduler.now)  # nobody may have looked at its very end
        except DivergedError as error:  # parameters in their ranges, and no motion with them
            raise ScenarioError(f"{self.config.scenario.name}: {error}") from error
        except TransportLost as error:  # of a line that nobody can open again: a recording
            raise ScenarioError(f"hil: {error}") from error
        self.robot.wires.settle()  # before whoever writes the trace to files closes them

    def run_data(self, *, compare: bool = True) -> RunData:
        """Return all that the run knows about itself.

        Without `compare` the plant alone does not swim beside it, which no metric needs.
        """
        self.trace.flush()
        config, recorder = self.config, self.recorder
        truth = self._truth()
        channels = recorder.series()
        if (rate := wrong.clock_rate(config)) != 1.0:
            channels = {
                name: Series(series.time_s * rate, series.value)
                for name, series in channels.items()
            }
        if self.live is not None:
            channels.update(self.live.channels())
        frequency = channels.get("tail_frequency_hz")
        beat_hz = float(frequency.value[-1]) if frequency is not None else 0.0
        spi_frames = recorder.spi_frames()
        metrics: dict[str, Metric] = dict(path_metrics(truth, beat_hz))
        metrics.update(self._counts())
        metrics["spi_frames"] = len(spi_frames)
        metrics["spi_crc_errors"] = sum(frame.outcome == "crc-error" for frame in spi_frames)
        comparison: tuple[Comparison, ...] = ()
        note = "it was interrupted" if self.interrupted else objection(config)
        if not compare:
            note = "nobody asked"
        servo = self.robot.vehicle.servo
        if not note and self.robot.power.volts < servo.least_voltage_v:
            note = "its battery ran down"
        if not note:
            comparison = difference(config, self.robot.parameters, self.robot.power.volts, metrics)
        metrics.update(account.target_metrics(config, truth))
        visits = tracking.visits(recorder.tracking, truth)
        if config.procboard.application == "target-tracking":
            metrics.update(tracking.metrics(visits))
        events = [
            *recorder.events(),
            *self.host.events,
            *(self.live.events() if self.live is not None else ()),
            *self.faults.events,
            *self.robot.power.events,
            *account.mount_events(self.robot.proc.mounts),
            *account.arrival_events(config, metrics),
            *tracking.events(recorder.tracking, visits),
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
            tail_shape=self._tail_shape(truth, beat_hz),
            truth_every=model.truth_steps(config)[1],
            channels=channels,
            beat_frequency_hz=beat_hz,
            interrupted=self.interrupted,
            spi_frames=spi_frames,
            radio_frames=recorder.radio_frames(),
            energy=self.robot.power.table() if config.hil.emulates_robot else (),
            comparison=comparison,
            comparison_note=note,
            events=tuple(sorted(events, key=lambda event: event.time_s)),
            outages=self.robot.power.outages,
            commands=self.host.commands(),
            links=account.link_ends(self.robot),
            mounts=account.mounts(self.robot.proc.mounts),
            targets=visits,
            switches=tracking.switches(recorder.tracking),
            lateness=self._lateness(),
            hil=self.live.summary() if self.live is not None else {},
        )

    def _truth(self) -> dict[str, FloatArray]:
        # The fish is wherever the real board is: nothing true is known of it.
        known = self.config.hil.emulates_water
        recorder = self.recorder
        return self.robot.swimmer.truth(self.scheduler.now, recorder.tail_command, known=known)

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

    def _counts(self) -> dict[str, Metric]:
        robot, proc = self.robot, self.robot.proc
        statistics = proc.statistics()
        return {
            "energy_j": robot.power.joules if self.config.hil.emulates_robot else None,
            "spi_lost": self._link_lost(),
            "radio_sent": self.recorder.radio_sent,
            "radio_received": self.recorder.radio_received,
            "samples_stored": proc.samples_stored,
            "samples_lost": statistics["samples_lost"],
            "samples_recovered": len(proc.stored_records()),
            "telemetry_received": self.host.telemetry.total(),
        }

    def _link_lost(self) -> int:
        """Messages that one end acknowledged and did not deliver, over all boots."""
        return sum(link.statistics.lost for link in (*self.robot.nav.links, *self.robot.proc.links))

    def _lateness(self) -> dict[str, float]:
        scheduler = self.scheduler
        if not isinstance(scheduler, RealTimeScheduler) or not scheduler.lateness_s:
            return {}
        late = scheduler.lateness_s
        return {
            "maximum_s": late.maximum_s,
            "p99_s": late.quantile_s(0.99),
            "missed": float(scheduler.missed),
        }
