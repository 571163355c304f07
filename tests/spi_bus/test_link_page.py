"""docs/link.md says what the table and the frame codec do."""

import re
from pathlib import Path

from spi_bus.frame import VERSION, FrameType
from spi_bus.link import LinkConfig
from spi_bus.messages import LINK_MESSAGES
from spi_bus.transports import TRANSPORTS

PAGE = (Path(__file__).parents[2] / "docs" / "link.md").read_text(encoding="utf-8")


def test_every_message_is_on_the_page_with_its_number_sender_and_size():
    rows = re.findall(r"^\| (0x\w\w) \| (\w+) \| (\w+) \| (\d+) \|", PAGE, re.MULTILINE)
    assert [(int(number, 16), name, sender, int(size)) for number, name, sender, size in rows] == [
        (row.kind, row.layout.name, row.sender, row.size) for row in LINK_MESSAGES.rows
    ]


def test_version_types_and_defaults_are_those_of_the_code():
    types = ", ".join(f"{kind.value} {kind.name}" for kind in FrameType)
    assert f"high nibble {VERSION}; low nibble {types} |" in PAGE
    config = LinkConfig()
    assert f"`window` ({config.window})" in PAGE
    assert f"`queue_limit` ({config.queue_limit})" in PAGE
    assert f"`ack_delay_us` ({config.ack_delay_us // 1000} ms)" in PAGE
    assert f"| {config.retransmit_us // 1000} ms, doubling to 1 s" in PAGE
    assert config.retransmit_max_us == 1_000_000


def test_every_transport_loads():
    for row in TRANSPORTS:
        assert row.load().__name__ == row.factory
        assert row.description
