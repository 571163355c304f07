"""Members of an ensemble are what they are alone, with any workers; a failure names its member."""

import threading
from dataclasses import replace

import numpy as np
import pytest

from plant.ensemble import VELOCITIES, for_each, orbit_ensemble, simulate_ensemble
from plant.errors import DivergedError, InvalidParameterError, NoOrbitError
from plant.integrate import simulate
from plant.layout import Column
from plant.orbit import PeriodicOrbit, periodic_orbit
from plant.parameters import Hydrodynamics, PlantParameters, Servo
from plant.robots import fishbed_robot, wang2014
from plant.tail_input import TailBeat, TailProgramme
from plant.trajectory import Start

BEAT = TailBeat.degrees(20, 15, 0.9)
PROGRAMME = TailProgramme.steady(BEAT)


def robots(count: int) -> list[PlantParameters]:
    drags = np.linspace(0.1, 0.5, count)
    hydrodynamics = [Hydrodynamics(drag=float(drag)) for drag in drags]
    return [replace(wang2014(), hydrodynamics=each) for each in hydrodynamics]


BRITTLE = replace(wang2014(), servo=Servo(motor_lag_s=1e-4))  # diverges at 1 ms


def radius(orbit: PeriodicOrbit) -> float | None:
    return orbit.turn_radius_m


@pytest.mark.parametrize("workers", [1, 2, 5, None])
def test_members_are_to_the_bit_what_they_are_alone(workers: int | None) -> None:
    ps = robots(23)
    got = simulate_ensemble(ps, PROGRAMME, 3.0, 2e-3, save_every=10, workers=workers)
    assert got.values.shape == (23, 151, len(VELOCITIES))
    assert got.failures == {}
    assert got.completed.all()
    got.check()
    for p, values in zip(ps, got.values, strict=True):
        alone = simulate(p, PROGRAMME, 3.0, 2e-3, save_every=10)
        assert np.array_equal(values, alone.rows[:, list(VELOCITIES)])
        assert np.array_equal(got.time_s, alone.time_s)
    assert np.ptp(got.column(Column.U)[:, -1]) > 1e-4


def test_beats_and_starts_may_differ_too() -> None:
    beats = [TailProgramme.steady(TailBeat.degrees(b, 15, 0.9)) for b in (0, 10, 20)]
    starts = [Start(u_m_s=u) for u in (0.0, 0.01, 0.02)]
    got = simulate_ensemble(
        wang2014(), beats, 2.0, starts=starts, save_every=0, columns=[Column.R, Column.X]
    )
    assert got.time_s.tolist() == [2.0]
    for beat, start, values in zip(beats, starts, got.values, strict=True):
        end = simulate(wang2014(), beat, 2.0, start=start).rows[-1]
        assert values.tolist() == [[end[Column.R], end[Column.X]]]


def test_what_all_share_is_one_member() -> None:
    got = simulate_ensemble(wang2014(), PROGRAMME, 0.5, save_every=0)
    assert got.values.shape == (1, 1, 6)
    assert got.values[0, 0, 0] == simulate(wang2014(), PROGRAMME, 0.5).x_m[-1]


@pytest.mark.parametrize("workers", [1, 2])
def test_a_diverging_member_is_named_and_harms_no_other(workers: int) -> None:
    ps = robots(6)
    ps[2] = ps[4] = BRITTLE
    got = simulate_ensemble(ps, PROGRAMME, 2.0, save_every=100, workers=workers)
    assert list(got.failures) == [2, 4]
    assert got.completed.tolist() == [True, True, False, True, False, True]
    assert np.isfinite(got.values).all()
    with pytest.raises(DivergedError, match="too long") as alone:
        simulate(BRITTLE, PROGRAMME, 2.0)
    assert got.failures[2].time_s == alone.value.time_s
    assert got.failures[2].state == alone.value.state
    with pytest.raises(DivergedError, match="too long"):
        got.check()
    assert np.array_equal(got.values[5, -1, 0], simulate(ps[5], PROGRAMME, 2.0).x_m[-1])


def test_sequences_of_different_lengths_are_refused() -> None:
    with pytest.raises(InvalidParameterError, match="3 parameters, 2 starts"):
        simulate_ensemble(robots(3), PROGRAMME, 1.0, starts=[Start(), Start()])
    with pytest.raises(InvalidParameterError, match="step_s"):
        simulate_ensemble(robots(3), PROGRAMME, 1.0, 0.0)
    with pytest.raises(InvalidParameterError, match="workers"):
        simulate_ensemble(robots(3), PROGRAMME, 1.0, workers=0)


@pytest.mark.parametrize("workers", [1, 3])
def test_orbits_of_many_robots(workers: int) -> None:
    ps = robots(8)
    got = orbit_ensemble(ps, BEAT, radius, 5e-3, workers=workers)
    assert list(got.all()) == [periodic_orbit(p, BEAT, 5e-3).turn_radius_m for p in ps]
    ps[3] = fishbed_robot()
    beats = [BEAT] * 8
    beats[3] = TailBeat.degrees(20, 0.1, 0.9)  # within the servo's dead band
    beats[5] = TailBeat.degrees(20, 0, 0.9)
    partly = orbit_ensemble(ps, beats, radius, 5e-3, workers=workers)
    assert [value is None for value in partly.values] == [i in (3, 5) for i in range(8)]
    assert isinstance(partly.failures[5], InvalidParameterError)
    assert isinstance(partly.failures[3], NoOrbitError)
    with pytest.raises(NoOrbitError):
        partly.all()


@pytest.mark.parametrize("workers", [1, 2, 7])
def test_each_is_done_once_and_stands_in_its_place(workers: int) -> None:
    told: list[float] = []
    done: list[int] = []

    def square(i: int) -> int:
        done.append(i)
        return i * i

    got = for_each(square, 100, workers=workers, progress=told.append)
    assert got == [i * i for i in range(100)]
    assert sorted(done) == list(range(100))
    assert told == sorted(told)
    assert told[-1] == 1.0
    assert for_each(square, 0, workers=workers) == []


@pytest.mark.parametrize("workers", [1, 2])
def test_an_exception_stops_the_others(workers: int) -> None:
    begun: list[int] = []

    def fails(i: int) -> None:
        begun.append(i)
        if i == 3:
            raise RuntimeError("third")

    with pytest.raises(RuntimeError, match="third"):
        for_each(fails, 10**6, workers=workers)
    assert len(begun) < 10**6


def test_an_interruption_ends_the_workers() -> None:
    # the user's Ctrl-C reaches the calling thread, here while it tells the progress
    begun: list[int] = []
    gate = threading.Event()

    def slow(i: int) -> None:
        begun.append(i)
        gate.wait(30.0)

    def interrupted(share: float) -> None:
        gate.set()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        for_each(slow, 10**7, workers=2, progress=interrupted)
    assert len(begun) < 10**7
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("ensemble")]


@pytest.mark.parametrize(
    ("duration_s", "save_every", "field"),
    [
        (float("nan"), 1, "duration_s"),
        (float("inf"), 1, "duration_s"),
        (-1.0, 1, "duration_s"),
        (1e9, 1, "duration_s"),
        (1e300, 0, "duration_s"),
        (1.0, -3, "save_every"),
    ],
)
def test_nonsense_of_time_is_refused(duration_s: float, save_every: int, field: str) -> None:
    steady = TailProgramme.steady(TailBeat.degrees(20, 15, 0.9))
    with pytest.raises(InvalidParameterError, match=field):
        simulate_ensemble(wang2014(), steady, duration_s, save_every=save_every)
    with pytest.raises(InvalidParameterError, match=field):
        simulate(wang2014(), steady, duration_s, save_every=save_every or 1)
