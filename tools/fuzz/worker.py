"""One target in a process of its own: libFuzzer ends the process when it is done.

Started by `tools.fuzz`; its arguments are the target and then libFuzzer's own.
"""

from __future__ import annotations

import sys

INSTRUMENTED = [
    "spi_bus",
    "radio_802154",
    "tools.decode",
    "navboard.drivers",
    "tools.bench.tracker_lines", "tools.teleop",
]


def main() -> None:
    """Fuzz; does not return."""
    import atheris

    with atheris.instrument_imports(include=INSTRUMENTED):
        from tools.fuzz.targets import TARGETS

        target = next(target for target in TARGETS if target.name == sys.argv[1])
        target.run(target.seeds[0])  # what it imports only now is instrumented, too

    def one(data: bytes) -> None:
        target.run(bytes(data))

    atheris.Setup([sys.argv[0], *sys.argv[2:]], one)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
