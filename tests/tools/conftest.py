"""A made-up run for tests of records and report: plausible, seeded, and made by no bench."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from tools.records.data import (
    Comparison,
    EnergyState,
    Event,
    RadioFrame,
    RunData,
    Series,
    SpiFrame,
    TankView,
)
from tools.records.metrics import path_metrics

FREQUENCY_HZ = 0.9


def made_up_run(
    duration_s: float = 40.0, turn_rad_s: float = 0.0, seed: int = 1, rough: bool = False
) -> RunData:
    """A robot that starts from rest, waggles, and turns at a constant mean rate."""
    random = np.random.default_rng(seed)
    time = np.arange(0.0, duration_s + 1e-9, 0.02)
    phase = 2 * math.pi * FREQUENCY_HZ * time
    command = 0.26 * np.sin(phase) + (0.35 if turn_rad_s else 0.0)
    angle = 0.25 * np.sin(phase - 0.35) + (0.35 if turn_rad_s else 0.0)
    surge = 0.05 * (1 - np.exp(-time / 5)) + 0.003 * np.sin(2 * phase)
    sway = 0.008 * np.sin(phase + 1)
    yaw = turn_rad_s * (1 - np.exp(-time / 3)) + 0.6 * np.cos(phase)
    heading = np.concatenate(([0.0], np.cumsum((yaw[1:] + yaw[:-1]) / 2 * 0.02)))
    vx = surge * np.cos(heading) - sway * np.sin(heading)
    vy = surge * np.sin(heading) + sway * np.cos(heading)
    x, y = (np.concatenate(([0.0], np.cumsum((v[1:] + v[:-1]) / 2 * 0.02))) for v in (vx, vy))
    truth = {
        "time_s": time,
        "x_m": x,
        "y_m": y,
        "heading_rad": heading,
        "surge_m_s": surge,
        "sway_m_s": sway,
        "yaw_rate_rad_s": yaw,
        "tail_command_rad": command,
        "tail_angle_rad": angle,
        "tail_rate_rad_s": np.gradient(angle, time),
        "accel_x_m_s2": np.gradient(surge, time) - yaw * sway,
        "accel_y_m_s2": np.gradient(sway, time) + yaw * surge,
        "battery_v": 8.2 - 0.0004 * time,
        "servo_current_a": 0.02 + 0.05 * np.abs(np.cos(phase - 0.35)),
        "temperature_c": 20 + 0.2 * x,
        "pollutant_ug_l": np.full(time.size, 4.0),
    }

    def seen(name: str, rate_hz: float, noise: float, offset: float = 0.0) -> Series:
        at = np.arange(0.013, duration_s, 1 / rate_hz)
        return Series(
            at, np.interp(at, time, truth[name]) + offset + random.normal(0, noise, at.size)
        )

    compass = seen("heading_rad", 15, 0.02, 0.03)
    wrapped = (compass.value + math.pi) % (2 * math.pi) - math.pi
    channels = {
        "x_m": seen("x_m", 30, 0.002),
        "y_m": seen("y_m", 30, 0.002),
        "heading_rad": seen("heading_rad", 30, 0.01),
        "gyro_z_rad_s": seen("yaw_rate_rad_s", 10, 0.01, 0.02),
        "compass_rad": Series(compass.time_s, wrapped),
        "accel_x_m_s2": seen("accel_x_m_s2", 10, 0.01),
        "accel_y_m_s2": seen("accel_y_m_s2", 10, 0.01, 0.05),
        "battery_v": seen("battery_v", 10, 0.004),
        "servo_current_a": seen("servo_current_a", 10, 0.004),
        "temperature_c": seen("temperature_c", 10, 0.1, 0.4),
        "water_quality_ug_l": seen("pollutant_ug_l", 10, 0.2),
        "tail_bias_rad": Series(np.array([0.1]), np.array([0.0])),
    }
    spi, radio = [], []
    for number, at in enumerate(np.arange(0.1, duration_s, 0.1).tolist()):
        outcome = "ok"
        if rough and random.random() < 0.08:
            outcome = ("crc-error", "retransmission")[number % 2]
        spi.append(SpiFrame(at, False, "SensorReport", outcome, 48))
        spi.append(SpiFrame(at + 0.002, True, "ack", "ok", 8))
    for at in np.arange(0.5, duration_s, 0.5).tolist():
        lost = rough and random.random() < 0.3
        radio.append(RadioFrame(at, 2e-3, "robot", "telemetry", "lost" if lost else "received", 56))
        if not lost:
            radio.append(RadioFrame(at + 0.0023, 4e-4, "base", "ack", "received", 5))
    metrics: dict[str, float | int | None] = dict(path_metrics(truth, FREQUENCY_HZ))
    metrics |= {
        "energy_j": 31.7,
        "spi_frames": len(spi),
        "spi_crc_errors": sum(frame.outcome == "crc-error" for frame in spi),
        "spi_lost": 0,
        "radio_sent": len(radio),
        "radio_received": sum(frame.outcome == "received" for frame in radio),
        "samples_stored": 80,
        "samples_lost": 0,
    }
    return RunData(
        scenario="circle" if turn_rad_s else "swim-forward",
        description="from rest, tail-beat 15°, 0.9 Hz",
        seed=seed,
        duration_s=duration_s,
        wall_s=0.62,
        version="0.1.0",
        trace_sha256="9f2c4e" * 10 + "abcd",
        tank=TankView((-0.5, -0.6), (3.0, 1.2), base_station_m=(-0.5, -0.6)),
        metrics=metrics,
        truth=truth,
        channels=channels,
        beat_frequency_hz=FREQUENCY_HZ,
        spi_frames=tuple(spi),
        radio_frames=tuple(radio),
        energy=(
            EnergyState("servo", "moving", 31.0, 22.4),
            EnergyState("servo", "idle", 9.0, 0.3),
            EnergyState("CC2420", "receive", 36.0, 2.1),
            EnergyState("CC2420", "transmit", 0.2, 0.01),
            EnergyState("dsPIC30F6014A", "run", 6.0, 3.2),
            EnergyState("dsPIC30F6014A", "idle", 34.0, 2.4),
            EnergyState("MSP430F1611", "active", 1.0, 0.006),
            EnergyState("MSP430F1611", "LPM3", 39.0, 0.0004),
            EnergyState("M25P80", "program", 0.3, 0.01),
        ),
        comparison=(
            Comparison("plant alone, ideal servo", 0.0500, None, "the reference"),
            Comparison("with the HS-5646WP", 0.0494, None, "the tail lags and is a little smaller"),
            Comparison("with PWM and tick", 0.0493, None, "50 Hz steps of the command"),
            Comparison("whole robot", 0.0492, None, "links and clocks"),
        ),
        events=(
            Event(0.0, "navigation board", "power-on reset"),
            Event(0.1, "navigation board", "tail-beat 0.0°, 15.0°, 0.9 Hz applied"),
            *((Event(18.0, "supply", "cut for 0.5 s", "fault"),) if rough else ()),
        ),
    )


@pytest.fixture
def complaint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[[Sequence[str]], str]:
    """Call the command line with a mistake in an empty folder; return its one line."""

    def call(args: Sequence[str]) -> str:
        from tools.cli import main

        monkeypatch.chdir(tmp_path)
        assert main(args) == 2
        out, err = capsys.readouterr()
        lines = [line for line in err.splitlines() if " is expected at " not in line]
        assert out == ""
        assert len(lines) == 1
        assert not list(tmp_path.rglob("*.toml"))  # and nothing is left behind
        return lines[0]

    return call


@pytest.fixture
def make_run() -> Callable[..., RunData]:
    return made_up_run
