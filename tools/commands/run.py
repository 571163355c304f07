"""`fishbed run`: an emulated robot swims a scenario and leaves a run folder.

The folder's place is checked before the run starts. Ctrl-C ends the run at the next whole
millisecond of simulated time and everything is written as usual, marked as interrupted; a second
Ctrl-C gives up at once, and leaves nothing half-written behind. Where only the report fails the
rest is kept.
"""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING

from tools.errors import UserError

if TYPE_CHECKING:
    from pathlib import Path

    from tools.configuration import Scenario
    from tools.records.data import RunData
    from tools.records.shoal_data import ShoalData
    from tools.records.survey_data import SurveyData

NAME = "run"
HELP = "run an emulated robot through a scenario and write a run folder"
EXIT_INTERRUPTED = 130
SLOWEST, FASTEST = 1e-3, 1e6
"""Multiples of real time for `--speed`."""


def positive(text: str) -> float:
    """An argument that is a number above zero."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no number") from None
    if not value > 0:
        raise argparse.ArgumentTypeError(f"{text} must be above 0")
    if math.isinf(value):
        raise argparse.ArgumentTypeError(f"{text} must be finite")
    return value


def pace(text: str) -> float:
    """A multiple of real time that a clock can keep."""
    value = positive(text)
    if not SLOWEST <= value <= FASTEST:
        raise argparse.ArgumentTypeError(f"{text} must be from {SLOWEST:g} to {FASTEST:g}")
    return value


def folder_name(text: str) -> str:
    """An argument that names a folder."""
    if not text.strip():
        raise argparse.ArgumentTypeError("an empty text names no folder")
    return text


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the contract."""
    parser.add_argument(
        "scenario",
        nargs="?",
        metavar="SCENARIO|FILE.toml",
        help="a bundled scenario (see: fishbed list scenarios) or a file; default: swim-forward",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="override one key, such as procboard.tail_beat.bias_rad=0.2; may be repeated",
    )
    parser.add_argument("--duration", type=positive, metavar="S", help="simulated seconds")
    parser.add_argument("--seed", type=int, metavar="N", help="seed of all random numbers")
    parser.add_argument(
        "--out",
        type=folder_name,
        metavar="DIR",
        help="run folder; an earlier run there is replaced; default: runs/NAME-SEED",
    )
    parser.add_argument("--realtime", action="store_true", help="as fast as the real robot")
    parser.add_argument("--speed", type=pace, metavar="X", help="X times as fast as the real robot")
    parser.add_argument("--json", action="store_true", help="print summary.json on stdout")
    parser.add_argument("--quiet", action="store_true", help="no progress and no summary")


def run(args: argparse.Namespace) -> int:
    """Do it."""
    from tools import scenario

    if args.realtime and args.speed is not None:
        raise UserError("--realtime and --speed contradict each other; give one of them")
    config = scenario.load(
        args.scenario or scenario.DEFAULT, args.set, duration_s=args.duration, seed=args.seed
    )
    data, place = run_into_folder(args, config, 1.0 if args.realtime else args.speed)
    if not (args.json or args.quiet):
        print(short_summary(data, place))
    return EXIT_INTERRUPTED if data.interrupted else 0


def run_into_folder(
    args: argparse.Namespace, config: Scenario, speed: float | None = None
) -> tuple[RunData | ShoalData, Path]:
    """Run a scenario into the folder of `--out`, and print what `--json` asks for.

    Return what is known of the run, and the folder. `speed`: as of `execute`.
    """
    from pathlib import Path

    from tools.records.folder import RunFolder, default_path

    told = config.scenario
    place = Path(args.out) if args.out is not None else default_path(told.name, told.seed)
    with RunFolder(place) as folder:
        from tools.execution import execute
        from tools.field_files import stage
        from tools.records.summary import to_json
        from tools.records.write import write_run

        config = stage(folder, config)
        data = execute(config, folder, speed=speed, show_progress=not (args.quiet or args.json))
        write_run(folder, config, data)
        folder.commit()
    if args.json:
        print(to_json(data), end="")
    return data, place


def short_summary(data: RunData | ShoalData, place: Path) -> str:
    """What a run says on the terminal when it is done."""
    from tools.records.shoal_data import ShoalData

    ratio = data.duration_s / data.wall_s if data.wall_s > 0 else math.inf
    state = "interrupted after" if data.interrupted else "swam for"
    first = f"{data.scenario} (seed {data.seed}) {state} {data.duration_s:g} s"
    pace = f"{ratio:.0f}" if ratio >= 10 else f"{ratio:.1f}"
    lines = [f"{first}, computed in {data.wall_s:.1f} s ({pace} × real time)"]
    if isinstance(data, ShoalData):
        lines += _shoal_lines(data)
    else:
        lines += _robot_lines(data)
    if data.lateness:
        late = data.lateness
        lines.append(
            f"  {'lateness':<12}max {late['maximum_s'] * 1e3:.2f} ms, "
            f"99 % below {late['p99_s'] * 1e3:.2f} ms, {late['missed']:.0f} deadlines missed"
        )
    lines.append(f"  {'report':<12}{place / 'report.html'}")
    return "\n".join(lines)


def _shoal_lines(data: ShoalData) -> list[str]:
    """What a shoal did, a line a figure."""
    whole, count = data.whole, len(data.robots)
    sent = sum(robot.metrics.get("radio_sent") or 0 for robot in data.robots)
    least, at_s = whole.get("least_distance_m"), whole.get("least_distance_s")
    energy = whole.get("energy_j") or 0.0
    lines = [f"  {'robots':<12}{count}"]
    if least is not None and at_s is not None:
        lines.append(f"  {'nearest':<12}{100 * least:.1f} cm between two, at {at_s:.1f} s")
    if data.survey is not None:
        lines.append(f"  {'survey':<12}{_survey_words(data.survey)}")
    return [
        *lines,
        f"  {'path':<12}{(whole.get('path_length_m') or 0.0) / count:.2f} m each on average",
        f"  {'energy':<12}{energy / count:.1f} J each on average, {energy:.0f} J in all",
        (
            f"  {'radio':<12}{sent} messages sent by robots, "
            f"{whole.get('telemetry_received')} telemetry at the base station"
        ),
        (
            f"  {'log':<12}{whole.get('samples_stored')} records stored, "
            f"{whole.get('samples_recovered')} recovered, {whole.get('samples_lost')} refused"
        ),
    ]


def _survey_words(survey: SurveyData) -> str:
    """What a survey found, in a line."""
    figures = survey.figures
    agreed, error = figures["agreed_s"], figures["error"]
    state = "not finished" if agreed is None else f"known to all after {agreed:.0f} s"
    words = f"{state}, {figures['cells_sampled']} of {figures['cells']} cells sampled"
    if error["rms"] is not None:
        unit = survey.unit
        words += f", error {error['rms']:.2f} {unit} rms, {error['max']:.2f} {unit} at most"
    return words


def _robot_lines(data: RunData) -> list[str]:
    """What one robot did, a line a figure."""
    from tools.records.metrics import unsettled

    lines = []
    moving = unsettled(data.truth, data.beat_frequency_hz)
    shown = (
        ("arrived", "arrival_s", 1, "s", 1),
        ("reached", "targets_reached", 1, "targets", 0),
        ("nearest", "target_nearest_m", 100, "cm to the target", 1),
        ("speed", "speed_m_s", 100, "cm/s over the last ten beats", 2),
        ("turn radius", "turn_radius_m", 100, "cm", 1),
        ("turn period", "turn_period_s", 1, "s", 1),
        ("path", "path_length_m", 1, "m", 2),
        ("energy", "energy_j", 1, "J", 1),
    )
    for label, key, scale, unit, digits in shown:
        value = data.metrics.get(key)
        if value is not None:
            more = f", {moving}" if moving and key == "turn_radius_m" else ""
            lines.append(f"  {label:<12}{value * scale:.{digits}f} {unit}{more}")
    counts = (
        (
            "SPI",
            ("spi_frames", "frames"),
            ("spi_crc_errors", "damaged"),
            ("spi_lost", "messages lost"),
        ),
        ("radio", ("radio_sent", "messages sent"), ("radio_received", "received")),
        (
            "log",
            ("samples_stored", "records stored"),
            ("samples_recovered", "recovered"),
            ("samples_lost", "refused"),
        ),
    )
    for label, *pairs in counts:
        known = [
            f"{data.metrics[key]} {word}"
            for key, word in pairs
            if data.metrics.get(key) is not None
        ]
        if known:
            lines.append(f"  {label:<12}{', '.join(known)}")
    return lines
