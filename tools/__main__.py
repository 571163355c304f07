"""`fishbed`, and `python -m tools` for a checkout that is not installed.

Nothing is imported at the top, so that Ctrl-C while Python still reads the program ends it as
quietly as later.
"""

import sys


def main() -> int:
    """Run one command; returns its exit code."""
    try:
        from tools.cli import main as command

        return command()
    except KeyboardInterrupt:
        print("fishbed: interrupted", file=sys.stderr)
        return 130  # 128 + SIGINT, as `tools.cli` has it


if __name__ == "__main__":
    sys.exit(main())
