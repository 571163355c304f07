"""`fishbed diagnose`: what the simulation gets wrong, the cause, the extended model, its gain."""

from __future__ import annotations

import argparse

from tools.commands.run import folder_name
from tools.errors import UserError

NAME = "diagnose"
HELP = "compare measured data with the model, and name what is wrong"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the contract."""
    parser.add_argument(
        "experiment",
        metavar="EXPERIMENT",
        help="folder with experiment.toml, a run folder, or a steady-state table (CSV)",
    )
    parser.add_argument(
        "--out",
        type=folder_name,
        metavar="DIR",
        help="default: EXPERIMENT/diagnosis, or beside a run folder or table",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="seed of all draws")
    parser.add_argument("--json", action="store_true", help="print diagnosis.json on stdout")


def run(args: argparse.Namespace) -> int:
    """Do it."""
    from pathlib import Path

    from tools.diagnosis.command import default_out, diagnose_folder

    if args.seed < 0:
        raise UserError(f"--seed: must not be negative, got {args.seed}")
    place = Path(args.experiment)
    out = Path(args.out) if args.out is not None else default_out(place)
    told = diagnose_folder(place, out, args.seed, show_progress=not args.json)
    print(told.json if args.json else told.words, end="" if args.json else "\n")
    return 0
