"""What all tests share: one profile for property tests, and whole robots that have swum.

Property tests draw the same examples every time and never look at the wall clock.

`swim` runs a scenario on the real bench and keeps what every trace channel recorded, so that a test
compares what one end reports with what the other end did. It also journals the calls of the links
between the boards, which leave no trace of their own: what a link accepted, what it delivered, and
what it was told is acknowledged. A run is made once a process, however many tests look at it.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

settings.register_profile("fishbed", deadline=None, derandomize=True)
settings.load_profile("fishbed")

ROOT = Path(__file__).resolve().parents[1]


@dataclass(slots=True)
class Ended:
    """What became of one command line."""

    code: int
    out: str
    err: str


@dataclass(slots=True)
class Journal:
    """What one link object was given and gave, in order; messages as the payloads on the wire."""

    accepted: list[bytes] = field(default_factory=list)
    delivered: list[bytes] = field(default_factory=list)
    acknowledged: list[bytes] = field(default_factory=list)


@dataclass(slots=True)
class Swim:
    """A run that is over: its bench, what it says of itself, its channels and its folder."""

    config: Any
    bench: Any
    data: Any
    channels: dict[str, list[tuple[int, Any]]]
    journals: dict[int, Journal]
    folder: Path | None

    def values(self, channel: str) -> list[Any]:
        """The values of a channel, in order."""
        return [value for _, value in self.channels[channel]]

    def journal(self, link: object) -> Journal:
        """What a link of a board did."""
        return self.journals[id(link)]


@pytest.fixture(scope="session")
def swim(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Swim]:
    """Run a scenario (once a process): name, `--set` texts, duration, seed, `keep` a folder."""
    done: dict[tuple[Any, ...], Swim] = {}

    def run(
        name: str = "swim-forward",
        *sets: str,
        duration_s: float | None = None,
        seed: int | None = None,
        keep: bool = False,
    ) -> Swim:
        key = (name, sets, duration_s, seed, keep)
        if key not in done:
            place = tmp_path_factory.mktemp("swim") / "run" if keep else None
            done[key] = _swim(name, sets, duration_s, seed, place)
        return done[key]

    return run


def _swim(
    name: str, sets: tuple[str, ...], duration_s: float | None, seed: int | None, out: Path | None
) -> Swim:
    from tools import scenario
    from tools.bench import Bench
    from tools.records.folder import RunFolder
    from tools.records.stream import StreamedFiles
    from tools.records.write import write_run

    config = scenario.load(name, sets, duration_s=duration_s, seed=seed)
    bench = Bench.from_scenario(config)
    channels: dict[str, list[tuple[int, Any]]] = {name: [] for name in bench.trace.names()}
    for channel, records in channels.items():
        bench.trace.channel(channel).sink(records.extend)
    journals: dict[int, Journal] = {}
    with pytest.MonkeyPatch.context() as patch:
        _journal_links(patch, journals)
        if out is None:
            bench.run(lambda _seconds: None, lambda: False)
            data = bench.run_data()
        else:
            with RunFolder(out) as folder:
                with StreamedFiles(bench.trace, folder):
                    bench.run(lambda _seconds: None, lambda: False)
                    bench.trace.flush()
                data = bench.run_data()
                write_run(folder, config, data)
                folder.commit()
    return Swim(config, bench, data, channels, journals, out)


def _journal_links(patch: pytest.MonkeyPatch, journals: dict[int, Journal]) -> None:
    from spi_bus.link import Link, MessageAcknowledged, MessageReceived
    from spi_bus.messages import LINK_MESSAGES

    encode = LINK_MESSAGES.encode
    send, receive = Link.send, Link.receive
    tokens: dict[tuple[int, int], bytes] = {}

    def journal(link: Link) -> Journal:
        return journals.setdefault(id(link), Journal())

    def sending(link: Link, message: object) -> int:
        token = send(link, message)
        tokens[id(link), token] = payload = encode(message)
        journal(link).accepted.append(payload)
        return token

    def receiving(link: Link, data: bytes, now_us: int) -> list[Any]:
        events = receive(link, data, now_us)
        for event in events:
            if isinstance(event, MessageReceived):
                journal(link).delivered.append(encode(event.message))
            elif isinstance(event, MessageAcknowledged):
                journal(link).acknowledged.append(tokens.pop((id(link), event.token)))
        return events

    patch.setattr(Link, "send", sending)
    patch.setattr(Link, "receive", receiving)


@pytest.fixture(scope="session")
def fishbed() -> Callable[..., Ended]:
    """Call the command line in a process of its own, from any folder."""

    def call(*arguments: str, cwd: Path = ROOT, **environment: str) -> Ended:
        done = subprocess.run(
            command(*arguments),
            capture_output=True,
            text=True,
            check=False,
            cwd=cwd,
            env=surroundings(**environment),
        )
        return Ended(done.returncode, done.stdout, done.stderr)

    return call


def command(*arguments: str) -> list[str]:
    """The command line that runs this checkout, whatever is installed."""
    return [sys.executable, "-m", "tools", *arguments]


def surroundings(**environment: str) -> dict[str, str]:
    """Environment in which `command` works from any folder."""
    return {**os.environ, "PYTHONPATH": str(ROOT), **environment}


@pytest.fixture(scope="session")
def start_fishbed() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Start the command line and leave it running; what still runs at the end is killed."""
    started: list[subprocess.Popen[str]] = []

    def start(*arguments: str, cwd: Path = ROOT) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            command(*arguments),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=cwd,
            env=surroundings(),
        )
        started.append(process)
        return process

    yield start
    for process in started:
        if process.poll() is None:
            process.kill()
            process.communicate()
