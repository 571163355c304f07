"""What makes the difference between the whole robot and the plant alone with an ideal servo.

The plant alone swims the same tail beat for the same time, first with an ideal tail and then with
one property of the servo after the other (`plant.comparison`). The scenario's beat is the robot's
too, since one that the motion controller would clip is refused. What is left between the last rung
and the robot is the boards': commands that arrive after the boot, quantised pulses, a sagging pack.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tools.records.data import Comparison

if TYPE_CHECKING:
    from collections.abc import Mapping

    from plant.parameters import PlantParameters
    from tools.configuration import Scenario
    from tools.records.data import Metric

WHY = {
    "ideal": "the tail is where it is told to be",
    "lag": "the servo's position loop and motor follow late and a little short",
    "hold": "a pulse every 20 ms: targets come in steps, one frame late",
    "speed limit": "the servo turns no faster than its supply allows",
    "dead band": "the servo ignores changes below 4 µs of pulse width",
}
FRAME_HZ = 50.0
"""The plant alone samples its beat once in a frame of the servo (`plant.comparison.FRAME_FS`)."""
LEAST_BEATS = 20
"""Shorter runs are all transient: nothing to compare."""
BEATS = 10.0


def objection(config: Scenario) -> str:
    """Why there is nothing to compare; empty where one tail beat lasts from rest to the end."""
    beat, initial = config.procboard.tail_beat, config.initial
    moving = (initial.surge_m_s, initial.sway_m_s, initial.yaw_rate_rad_s)
    reasons = (
        (bool(config.hil.url), "a real board took part"),
        (bool(config.hil.xbee), "an operator steered"),
        (bool(config.hil.mote or config.hil.base_port), "others were on the air"),
        (config.procboard.application != "open-loop", "the robot chose its tail beat itself"),
        (bool(config.base_station.tail_beats), "its tail beat was changed by radio"),
        (bool(config.faults.supply_cuts or config.faults.flash_cuts), "its supply was cut"),
        (config.plant.servo.ideal, "its servo is ideal already"),
        (
            config.navboard.control_hz != FRAME_HZ,
            f"its tail-beat generator did not tick with the servo's frame, {FRAME_HZ:g} Hz",
        ),
        (any(moving), "it did not start from rest"),
        (beat.amplitude_rad == 0.0, "its tail did not beat"),
        (
            beat.frequency_hz * config.scenario.duration_s < LEAST_BEATS,
            f"it lasted fewer than {LEAST_BEATS} beats",
        ),
    )
    return next((words for holds, words in reasons if holds), "")


def difference(
    config: Scenario, parameters: PlantParameters, volts: float, robot: Mapping[str, Metric]
) -> tuple[Comparison, ...]:
    """Return the rungs from the ideal plant to the whole robot, which comes last."""
    from plant.comparison import compare_servo
    from plant.tail_input import TailBeat

    beat = config.procboard.tail_beat
    rungs = compare_servo(
        parameters,
        TailBeat(beat.bias_rad, beat.amplitude_rad, beat.frequency_hz),
        config.scenario.duration_s,
        BEATS,
        volts,
    )
    turns = robot["turn_radius_m"] is not None
    rows = [
        Comparison(
            f"+ {rung.name}" if index else "plant alone, ideal servo",
            rung.motion.speed_m_s,
            rung.motion.turn_radius_m if turns else None,
            WHY[rung.name],
        )
        for index, rung in enumerate(rungs)
    ]
    rows.append(
        Comparison(
            "whole robot",
            robot["speed_m_s"],
            robot["turn_radius_m"],
            "both boards: commands after the boot, quantised pulses, a pack that sags",
        )
    )
    return tuple(rows)
