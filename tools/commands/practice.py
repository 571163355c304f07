"""`fishbed practice`: an experiment with an effect hidden in it, and how well it was found."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from tools.commands.run import folder_name
from tools.errors import UserError

if TYPE_CHECKING:
    from tools.practice.reveal import Revealed

NAME = "practice"
HELP = "an experiment with an effect hidden in it; how well it was found"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the contract."""
    which = parser.add_mutually_exclusive_group(required=True)
    which.add_argument("--seed", type=int, metavar="N", help="make the experiment of this seed")
    which.add_argument("--reveal", metavar="DIR", help="say what was hidden, and score")
    parser.add_argument("--out", type=folder_name, metavar="DIR", help="the new experiment folder")
    parser.add_argument(
        "--diagnosis", metavar="FILE", help="with --reveal: another diagnosis.json than its own"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON document on stdout")


def run(args: argparse.Namespace) -> int:
    """Do it."""
    if args.reveal is not None:
        if args.out is not None:
            raise UserError("--out: goes with --seed; --reveal writes nothing")
        return _reveal(args)
    if args.out is None:
        raise UserError("--seed: give the new folder too: fishbed practice --seed N --out DIR")
    if args.diagnosis is not None:
        raise UserError("--diagnosis: goes with --reveal")
    return _make(args)


def _make(args: argparse.Namespace) -> int:
    import json
    from pathlib import Path

    from tools.practice import draw, folder
    from tools.practice.experiment import swim_experiment

    if args.seed < 0:
        raise UserError(f"--seed: must not be negative, got {args.seed}")
    place = Path(args.out)
    folder.check_new(place)
    hidden = draw.secret(args.seed)
    effects = draw.effects(args.seed, hidden)
    swum = swim_experiment(args.seed, effects)
    answer = folder.answer(args.seed, hidden.kind, hidden.strength, effects)
    folder.write(place, f"practice {args.seed}", "wang2014", swum, answer)
    if args.json:
        print(json.dumps({"experiment": str(place), "runs": [*swum]}))
    else:
        print(f"{place}: {len(swum)} runs, and perhaps an effect hidden in them")
        print(f"  fishbed diagnose {place}")
        print(f"  fishbed practice --reveal {place}")
    return 0


def _reveal(args: argparse.Namespace) -> int:
    import json
    from dataclasses import asdict
    from pathlib import Path

    from tools.practice.reveal import reveal

    told = reveal(Path(args.reveal), None if args.diagnosis is None else Path(args.diagnosis))
    if args.json:
        print(json.dumps(asdict(told), indent=2))
    else:
        print("\n".join(_words(told)))
    return 0 if told.score in ("exact", "in_set") else 1


def _words(told: Revealed) -> list[str]:
    from tools.practice.reveal import SCORES

    hidden = " and ".join(told.hidden) or "nothing"
    named = " and ".join(told.named) or "none"
    lines = [
        f"hidden      {hidden}",
        f"verdict     {told.verdict}; causes: {named}",
        f"score       {told.score}: {SCORES[told.score]}",
    ]
    for item in told.estimates:
        value = f"  {item.cause}.{item.parameter}: true {item.truth:.4g} {item.unit}".rstrip()
        if item.estimate is not None and item.standard_error is not None:
            value += f", estimated {item.estimate:.4g} ± {item.standard_error:.2g}"
        if item.errors is not None:
            value += f" ({item.errors:+.1f} standard errors off)"
        lines.append(value)
    if told.gain is not None:
        lines.append(f"held out    the extension removes {told.gain:.0%} of what noise leaves")
    return lines
