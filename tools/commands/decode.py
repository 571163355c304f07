"""`fishbed decode`: recorded traffic in words.

All files are opened and recognised before the first line is printed, so that a wrong name leaves
stdout empty. Damage inside a file is a line with its offset, and decoding goes on.
"""

from __future__ import annotations

import argparse
import sys

NAME = "decode"
HELP = "recorded traffic in words: recordings, pcap, SPI waveforms, hex dumps"
PROTOCOLS = ("link", "tinyos", "xbee", "802.15.4", "auto")
"""`tools.decode.session.PROTOCOLS`, which a test compares."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the contract."""
    parser.add_argument(
        "files",
        nargs="+",
        metavar="FILE",
        help="a recording, pcap, VCD, hex dump or raw octets, or a run folder",
    )
    parser.add_argument(
        "--protocol", choices=PROTOCOLS, default="auto", help="default: found by trial"
    )
    parser.add_argument("--summary", action="store_true", help="counts only")
    parser.add_argument("--json", action="store_true", help="print one JSON document on stdout")


def run(args: argparse.Namespace) -> int:
    """Do it."""
    from contextlib import ExitStack

    from tools.decode.files import paths
    from tools.decode.output import write_json, write_text
    from tools.decode.session import open_session
    from tools.errors import UserError

    if args.json and args.summary:
        raise UserError("--summary and --json: the JSON document has the summary in it; leave one")
    with ExitStack() as stack:
        sessions = []
        for path in paths(args.files):
            sessions.append(open_session(path, args.protocol))
            stack.callback(sessions[-1].close)
        if args.json:
            write_json(sys.stdout, sessions)
        else:
            for session in sessions:
                write_text(sys.stdout, session, summary_only=args.summary)
    if args.protocol == PROTOCOLS[-1]:
        return 0  # found by what it holds
    empty = [session for session in sessions if not session.tally.good]
    for session in empty:
        print(f"fishbed decode: {session.nothing()}", file=sys.stderr)
    return 1 if empty else 0
