"""`fishbed replay`: the same scenario and seed again, and whether the trace is the same.

A run that was interrupted is repeated up to the moment at which it was stopped.
"""

from __future__ import annotations

import argparse

from tools.errors import RunFolderError, UserError

NAME = "replay"
HELP = "run a run folder's scenario again and compare the trace hash"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the contract."""
    parser.add_argument("run_dir", metavar="RUN_DIR", help="a folder that `fishbed run` wrote")
    parser.add_argument("--json", action="store_true", help="print one JSON document on stdout")
    parser.add_argument("--quiet", action="store_true", help="no progress; only the verdict")


def run(args: argparse.Namespace) -> int:
    """Do it; 0 where the hash is the same, 1 where it is not."""
    import json
    from pathlib import Path

    from tools import scenario
    from tools.records.folder import is_run_folder
    from tools.records.read import read_summary
    from tools.version import version

    folder = Path(args.run_dir)
    if not is_run_folder(folder):
        raise RunFolderError(f"{folder}: no run folder: scenario.toml or summary.json is missing")
    recorded = read_summary(folder)
    expected, by = str(recorded["trace_sha256"]), str(recorded["version"])
    config = scenario.load(folder / "scenario.toml", duration_s=recorded["duration_s"])

    if config.hil.live:
        who = "a real board" if config.hil.url else "somebody from outside"
        raise UserError(f"{folder}: {who} took part in this run; it cannot be had again")
    from tools.execution import execute

    data = execute(config, show_progress=not (args.quiet or args.json))
    if data.interrupted:
        raise KeyboardInterrupt
    same = data.trace_sha256 == expected
    if args.json:
        document = {
            "run": str(folder),
            "same": same,
            "recorded": {"trace_sha256": expected, "version": by},
            "replayed": {"trace_sha256": data.trace_sha256, "version": version()},
        }
        print(json.dumps(document, indent=2))
    elif same:
        print(f"same trace: {expected}")
    else:
        print(f"another trace: {data.trace_sha256}\n     recorded: {expected}")
        if by != version():
            print(f"the run was made by fishbed {by}, this is {version()}")
    return 0 if same else 1
