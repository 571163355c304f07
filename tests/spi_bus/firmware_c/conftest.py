"""The C library compiled with gcc, and a C link with the methods of the Python one."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import fields
from functools import cache
from pathlib import Path

import pytest

from spi_bus.errors import LinkFull
from spi_bus.frame import ErrorKind
from spi_bus.layout import Field
from spi_bus.link import (
    Link,
    LinkConfig,
    LinkError,
    LinkUp,
    MessageAcknowledged,
    MessageReceived,
    PeerReset,
    Role,
    Statistics,
    StreamReceived,
)
from spi_bus.messages import LINK_MESSAGES
from tools.message_header import Header, c_name, member

SOURCES = Path(__file__).resolve().parents[3] / "spi_bus" / "firmware_c"
HERE = Path(__file__).resolve().parent
LINK = (SOURCES / "fishbed_link.c", SOURCES / "fishbed_frame.c")
FLAGS = {
    "ordinary": ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O1"],
    "gnu": ["-std=gnu99", "-Wall", "-Wextra", "-Werror", "-O1", "-shared", "-fPIC"],
}
FLAGS["shared"] = [*FLAGS["ordinary"], "-shared", "-fPIC"]
FLAGS["strict"] = [
    *FLAGS["ordinary"], "-Os", "-Wconversion", "-Wsign-conversion", "-Wshadow", "-Wundef",
    "-Wstrict-prototypes", "-ffreestanding", "-c",
]  # fmt: skip
FLAGS["sanitized"] = [
    *FLAGS["ordinary"], "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all",
]  # fmt: skip

Build = Callable[..., Path]


@pytest.fixture(scope="session")
def build(tmp_path_factory) -> Build:
    """Compile sources to a file of that name with a row of FLAGS and more; once for each name."""
    if shutil.which("gcc") is None:
        pytest.skip("gcc is absent: the C library is not compiled")
    folder = tmp_path_factory.mktemp("c")

    def build(
        name: str, kind: str, *sources: Path, more: Sequence[str] = (), compiler: str = "gcc"
    ) -> Path:
        target = folder / name
        if not target.exists():
            command = [compiler, *FLAGS[kind], *more, f"-I{SOURCES}", "-o", target, *sources]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stderr
            assert not done.stderr
        return target

    return build


@pytest.fixture(scope="session")
def flags() -> dict[str, list[str]]:
    """The compiler's flags by purpose."""
    return FLAGS


@pytest.fixture(scope="session")
def library(build) -> Callable[..., ctypes.CDLL]:
    """The link and its shim as a shared library, with sizes of choice."""

    def library(payload: int = 247, queue: int = 16) -> ctypes.CDLL:
        sizes = [f"-DFISHBED_MAX_PAYLOAD={payload}", f"-DFISHBED_QUEUE_LIMIT={queue}"]
        sources = (*LINK, HERE / "shim.c")
        loaded = ctypes.CDLL(
            str(build(f"link-{payload}-{queue}.so", "shared", *sources, more=sizes))
        )
        loaded.shim_new.restype = ctypes.c_void_p
        loaded.shim_record.restype = ctypes.POINTER(record(payload))
        loaded.shim_statistics.restype = ctypes.POINTER(ctypes.c_uint16)
        for name in ("shim_state", "fishbed_crc16", "fishbed_seal", "fishbed_data_to_send"):
            getattr(loaded, name).restype = ctypes.c_uint16
        for name in (
            "open",
            "wants_to_send",
            "next_deadline",
            "send",
            "send_newest",
            "set_receive_window",
        ):
            getattr(loaded, f"fishbed_{name}").restype = ctypes.c_uint8
        loaded.queue_limit = queue
        return loaded

    return library


def record(payload: int) -> type[ctypes.Structure]:
    class Record(ctypes.Structure):
        _fields_ = (
            *[(name, ctypes.c_uint8) for name in ("kind", "error", "length", "unacknowledged")],
            *[(name, ctypes.c_uint16) for name in ("token", "peer_epoch", "previous_epoch")],
            ("payload", ctypes.c_uint8 * payload),
        )

    return Record


class Config(ctypes.Structure):
    """The `fishbed_config` of a `LinkConfig`."""

    _fields_ = (
        ("window", ctypes.c_uint8),
        ("ack_delay_us", ctypes.c_uint32),
        ("retransmit_us", ctypes.c_uint32),
        ("retransmit_max_us", ctypes.c_uint32),
    )

    @classmethod
    def of(cls, config: LinkConfig) -> Config:
        return cls(*(getattr(config, name) for name, _ in cls._fields_))


COUNTERS = [
    "frames_sent", "frames_received", "messages_sent", "messages_acknowledged",
    "messages_received", "retransmissions", "duplicates", "gaps", "refused", "stale", "lost",
    "peer_resets", "streamed", "stream_received", "replaced",
]  # fmt: skip


class CLink:
    """`fishbed_link` with the methods of `Link`; its clock wraps early on."""

    ORIGIN_US = (1 << 32) - 300_000

    def __init__(self, library, role: Role, epoch: int, config: LinkConfig) -> None:
        assert config.queue_limit == library.queue_limit
        self.library = library
        self.role = role
        self.config = config
        handle = library.shim_new(role is Role.SLAVE, epoch, ctypes.byref(Config.of(config)))
        assert handle
        self.handle = ctypes.c_void_p(handle)

    def __del__(self) -> None:
        if hasattr(self, "handle"):
            self.library.shim_free(self.handle)

    def clock(self, now_us: int) -> ctypes.c_uint32:
        return ctypes.c_uint32((now_us + self.ORIGIN_US) & 0xFFFFFFFF)

    def send(self, message: object) -> int:
        payload = LINK_MESSAGES.encode(message, self.role)
        if not self.library.fishbed_send(self.handle, payload, len(payload)):
            raise LinkFull
        return self.library.shim_state(self.handle, 2)

    def send_newest(self, message: object) -> bool:
        payload = LINK_MESSAGES.encode(message, self.role)
        return bool(self.library.fishbed_send_newest(self.handle, payload, len(payload)))

    @property
    def queued(self) -> int:
        return self.library.shim_state(self.handle, 0)

    @property
    def peer_epoch(self) -> int:
        return self.library.shim_state(self.handle, 1)

    @property
    def wants_to_send(self) -> bool:
        return bool(self.library.fishbed_wants_to_send(self.handle))

    @property
    def receive_window(self) -> int:
        return self.library.shim_state(self.handle, 4)

    @receive_window.setter
    def receive_window(self, messages: int) -> None:
        assert self.library.fishbed_set_receive_window(self.handle, messages)

    def next_deadline_us(self, now_us: int) -> int | None:
        """The deadline, to the nearest turn of the 32-bit clock to `now_us`."""
        deadline = ctypes.c_uint32()
        if not self.library.fishbed_next_deadline(self.handle, ctypes.byref(deadline)):
            return None
        ahead = (deadline.value - self.clock(now_us).value + (1 << 31)) % (1 << 32) - (1 << 31)
        return now_us + ahead

    def handle_timer(self, now_us: int) -> None:
        self.library.fishbed_handle_timer(self.handle, self.clock(now_us))

    def data_to_send(
        self, now_us: int, limit: int | None = None, *, acknowledge: bool = False
    ) -> bytes:
        room = 8192 if limit is None else limit
        buffer = ctypes.create_string_buffer(max(room, 1))
        count = self.library.fishbed_data_to_send(
            self.handle, buffer, room, self.clock(now_us), acknowledge
        )
        return buffer.raw[:count]

    def resume(self, now_us: int) -> None:
        self.library.fishbed_resume(self.handle, self.clock(now_us))

    def receive(self, data: bytes, now_us: int) -> list:
        count = self.library.shim_receive(self.handle, data, len(data), self.clock(now_us))
        assert count < 4096
        return [self.event(self.library.shim_record(self.handle, i).contents) for i in range(count)]

    def event(self, got) -> object:
        match got.kind:
            case 0:
                payload = bytes(got.payload[: got.length])
                return MessageReceived(LINK_MESSAGES.decode(payload, self.role.other))
            case 1:
                return MessageAcknowledged(got.token)
            case 2:
                return LinkUp(got.peer_epoch)
            case 3:
                return PeerReset(got.peer_epoch, got.previous_epoch, got.unacknowledged)
            case 4:
                return LinkError(list(ErrorKind)[got.error])
            case 5:
                payload = bytes(got.payload[: got.length])
                return StreamReceived(LINK_MESSAGES.decode(payload, self.role.other))

    @property
    def statistics(self) -> Statistics:
        raw = self.library.shim_statistics(self.handle)
        errors = self.error_counts
        crc = errors[ErrorKind.CRC]
        return Statistics(
            **{name: raw[index] for index, name in enumerate(COUNTERS)},
            crc_errors=crc,
            framing_errors=sum(errors.values()) - crc,
        )

    @property
    def error_counts(self) -> dict[ErrorKind, int]:
        raw = self.library.shim_statistics(self.handle)
        return {kind: raw[len(COUNTERS) + index] for index, kind in enumerate(ErrorKind)}


assert {*COUNTERS, "crc_errors", "framing_errors"} == {item.name for item in fields(Statistics)}


class Twins:
    """A Python and a C link that are told the same and must say the same, byte for byte."""

    def __init__(self, library, role: Role, epoch: int, config: LinkConfig) -> None:
        self.python = Link(role, epoch, config)
        self.c = CLink(library, role, epoch, config)
        self.now_us = 0

    def same(self, ours, theirs):
        assert ours == theirs
        assert self.python.statistics == self.c.statistics
        assert self.python.error_counts == self.c.error_counts
        assert self.python.wants_to_send == self.c.wants_to_send
        assert self.python.queued == self.c.queued
        assert self.python.peer_epoch == self.c.peer_epoch
        assert self.python.next_deadline_us() == self.c.next_deadline_us(self.now_us)
        return ours

    def send(self, message: object) -> int:
        try:
            token = self.python.send(message)
        except LinkFull:
            with pytest.raises(LinkFull):
                self.c.send(message)
            raise
        return self.same(token, self.c.send(message))

    def send_newest(self, message: object) -> bool:
        return self.same(self.python.send_newest(message), self.c.send_newest(message))

    def next_deadline_us(self) -> int | None:
        return self.python.next_deadline_us()

    def handle_timer(self, now_us: int) -> None:
        self.now_us = now_us
        self.same(self.python.handle_timer(now_us), self.c.handle_timer(now_us))

    def data_to_send(self, now_us: int, limit: int | None = None, *, acknowledge=False) -> bytes:
        self.now_us = now_us
        ours = self.python.data_to_send(now_us, limit, acknowledge=acknowledge)
        return self.same(ours, self.c.data_to_send(now_us, limit, acknowledge=acknowledge))

    def resume(self, now_us: int) -> None:
        self.now_us = now_us
        self.same(self.python.resume(now_us), self.c.resume(now_us))

    def receive(self, data: bytes, now_us: int) -> list:
        self.now_us = now_us
        ours = self.python.receive(data, now_us)
        theirs = self.c.receive(data, now_us)
        told = [event for event in ours if not isinstance(event, LinkError)]
        self.same(told, [event for event in theirs if not isinstance(event, LinkError)])
        return ours

    @property
    def wants_to_send(self) -> bool:
        return self.python.wants_to_send

    @property
    def queued(self) -> int:
        return self.python.queued

    @property
    def peer_epoch(self) -> int:
        return self.python.peer_epoch

    @property
    def connected(self) -> bool:
        return self.python.connected

    @property
    def statistics(self) -> Statistics:
        return self.python.statistics

    @property
    def receive_window(self) -> int:
        return self.python.receive_window

    @receive_window.setter
    def receive_window(self, messages: int) -> None:
        self.python.receive_window = messages
        self.c.receive_window = messages
        self.same(None, None)


@pytest.fixture
def new_c_link(library) -> Callable[[Role, int, LinkConfig], CLink]:
    """Makes a `CLink` whose queue is of the configuration's size."""
    return lambda role, epoch, config: CLink(library(queue=config.queue_limit), role, epoch, config)


@pytest.fixture
def new_twins(library) -> Callable[[Role, int, LinkConfig], Twins]:
    """Makes `Twins`."""
    return lambda role, epoch, config: Twins(library(queue=config.queue_limit), role, epoch, config)


def senders(header: Header) -> list[str]:
    """Who sends messages of a table, in the order of the shim's numbers."""
    return list(dict.fromkeys(row.sender for row in header.rows))


def message_shim(header: Header) -> str:
    """C code that fills every message's members by name from an array, and back."""
    encode, decode = [], []
    prefix = header.prefix
    for row in header.rows:
        name, plain = header.name(row), c_name(row.layout.name)
        items = [
            ("valid" if not isinstance(item, Field) else member(item), index)
            for index, (_, item) in enumerate(row.layout.offsets())
        ]
        fill = " ".join(f"m.{item} = (__typeof__(m.{item}))values[{i}];" for item, i in items)
        read = " ".join(f"values[{i}] = (int64_t)m.{item};" for item, i in items)
        number = f"{name.upper()}_{header.number}"
        encode.append(
            f"case {number}: {{ {name} m; {fill} return {prefix}encode_{plain}(&m, out); }}"
        )
        decode.append(
            f"case {number}: {{ {name} m;"
            f" if (!{prefix}decode_{plain}(&m, in, length)) return 0; {read} return 1; }}"
        )
    beside = "" if header.numbered else "(uint8_t)kind, "
    whose = [
        f"case {index}: return {prefix}from_{sender}({beside}in, length);"
        for index, sender in enumerate(senders(header))
    ]
    return "\n".join(
        [
            f'#include "{header.file}"',
            "uint8_t shim_encode(int kind, const int64_t *values, uint8_t *out) { switch (kind) {",
            *encode,
            "} return 0; }",
            "uint8_t shim_decode(int kind, int64_t *values, const uint8_t *in, uint8_t length) {",
            "switch (kind) {",
            *decode,
            "} return 0; }",
            "uint8_t shim_from(int who, int kind, const uint8_t *in, uint8_t length) {",
            "(void)kind; switch (who) {",
            *whose,
            "} return 0; }",
        ]
    )


@pytest.fixture(scope="session")
def messages(build, tmp_path_factory) -> Callable[[Header], ctypes.CDLL]:
    """The encoders and decoders of every message of a header as a shared library."""
    folder = tmp_path_factory.mktemp("messages")

    @cache
    def messages(header: Header) -> ctypes.CDLL:
        source = folder / f"{header.prefix}shim.c"
        source.write_text(message_shim(header), encoding="utf-8")
        loaded = ctypes.CDLL(str(build(f"{header.prefix}messages.so", "gnu", source)))
        for name in ("shim_encode", "shim_decode", "shim_from"):
            getattr(loaded, name).restype = ctypes.c_uint8
        return loaded

    return messages
