"""The operator's status line: what was told, how the radio does, and how the fish is."""

from __future__ import annotations

import math

from rich.text import Text

from radio_802154.messages import TelemetryFlag
from tools.teleop.pilot import Course, Pilot
from tools.teleop.setpoint import LEFT

GOOD, POOR = 0.9, 0.5
"""Shares of acknowledged packets from which the link is shown green, and below which red."""
SILENT_S = 3.0
"""Telemetry that is older is said to be."""


def status(pilot: Pilot, now_s: float) -> Text:
    """Return the present state as one line."""
    line = Text(no_wrap=True, overflow="ellipsis")
    colour = {Course.DRIVING: "bold green", Course.STOPPING: "bold yellow"}.get(
        pilot.course, "yellow"
    )
    words = pilot.course.value
    if pilot.course is Course.WAITING:
        words = pilot.module.phase.value
    line.append(f"{words} ", colour)
    told = pilot.told
    line.append(f"{told.frequency_hz:.1f} Hz  {_bias(told.bias_rad)}  ±{_deg(told.amplitude_rad)}")
    line.append("  ".join(("", *_radio(pilot))), "cyan")
    quality = pilot.quality
    if quality is not None:
        shade = "green" if quality >= GOOD else "red" if quality < POOR else "yellow"
        line.append(f"  acked {100 * quality:.0f} %", shade)
    fish = _fish(pilot, now_s)
    if fish:
        line.append(f"  fish: {fish}")
    return line


def _radio(pilot: Pilot) -> list[str]:
    module = pilot.module
    parts = []
    if module.rssi_dbm is not None:
        parts.append(f"{module.rssi_dbm} dBm".replace("-", "−"))
    good = module.results["success"]
    bad = sum(module.results.values()) - good
    if good or bad:
        parts.append(f"ok {good} failed {bad}")
    if module.status_s.count:
        parts.append(f"{1e3 * module.status_s.quantile_s(0.5):.0f} ms to the air")
    if module.reply_s.count:
        parts.append(f"{1e3 * module.reply_s.quantile_s(0.5):.0f} ms to the tail")
    return parts


def _fish(pilot: Pilot, now_s: float) -> str:
    telemetry, heard_s = pilot.telemetry, pilot.telemetry_s
    if telemetry is None or heard_s is None:
        return ""
    parts = []
    if telemetry.heading_rad is not None:
        parts.append(f"{math.degrees(telemetry.heading_rad):.0f}°")
    if telemetry.battery_v is not None:
        parts.append(f"{telemetry.battery_v:.2f} V")
    if telemetry.temperature_c is not None:
        parts.append(f"{telemetry.temperature_c:.1f} °C")
    for flag, words in (
        (TelemetryFlag.FAIL_SAFE, "at rest"),
        (TelemetryFlag.LINK_DOWN, "navigation board silent"),
    ):
        if telemetry.flags & flag:
            parts.append(words)
    if now_s - heard_s > SILENT_S:
        parts.append(f"silent for {now_s - heard_s:.0f} s")
    return " ".join(parts).replace("-", "−")


def _bias(bias_rad: float) -> str:
    if not bias_rad:
        return "straight"
    side = "left" if bias_rad * LEFT > 0 else "right"
    return f"{side} {_deg(abs(bias_rad))}"


def _deg(angle_rad: float) -> str:
    return f"{math.degrees(angle_rad):.1f}°"


def result_lines(pilot: Pilot) -> list[str]:
    """Return the summary for the terminal."""
    told = pilot.summary()
    air, replies = told["on_the_air"], told["replies"]
    lines = [f"{told['commands']} commands to {told['address']:#06x}"]
    if air:
        words = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in air.items())
        late = told["status_after"]
        lines.append(
            f"  {'by radio':<12}{words}; after {1e3 * late['median_s']:.0f} ms, p99 "
            f"{1e3 * late['p99_s']:.0f} ms"
        )
    if replies:
        words = ", ".join(f"{count} {name}" for name, count in replies.items())
        late = told["reply_after"]
        lines.append(
            f"  {'by the fish':<12}{words}; after {1e3 * late['median_s']:.0f} ms, p99 "
            f"{1e3 * late['p99_s']:.0f} ms"
        )
    if told["restarts"]:
        lines.append(f"  {'module':<12}was reset {told['restarts']} times")
    if told["commands"]:
        lines.append(f"  {'at the end':<12}{_end_words(pilot)}")
    return lines


def _end_words(pilot: Pilot) -> str:
    if pilot.stop_confirmed:
        return "the fish has confirmed that it stopped"
    if pilot.plan.valid_for_s > 0:
        return (
            "the fish has not confirmed that it stopped: its last command runs out "
            f"{pilot.plan.valid_for_s:g} s after it came"
        )
    return "the fish has not confirmed that it stopped, and its last command does not run out"
