"""docs/transports.md names every scheme and the defaults that the code has."""

import re
from pathlib import Path

from spi_bus.frame import MAX_FRAME_BYTES, MAX_PAYLOAD_BYTES
from spi_bus.transports import TRANSPORTS, BackOff
from spi_bus.transports.base import BUFFER_BYTES
from spi_bus.transports.can_bus import OPTIONS, PAYLOAD_BYTES
from spi_bus.transports.isotp import IsoTp, IsoTpConfig
from spi_bus.transports.recording import HEADER, read_log

PAGE = (Path(__file__).parents[3] / "docs" / "transports.md").read_text(encoding="utf-8")


def test_every_scheme_and_option_is_on_the_page() -> None:
    for row in TRANSPORTS:
        for scheme in row.schemes:
            if scheme != "alt":
                assert f"`{scheme}:" in PAGE, scheme
    for option in OPTIONS:
        assert f"`{option}`" in PAGE, option


def test_defaults_are_those_of_the_code() -> None:
    back_off, config = BackOff(), IsoTpConfig()
    assert f"after {back_off.first_s * 1000:.0f} ms" in PAGE
    assert f"{back_off.longest_s:.0f} s" in PAGE
    assert f"buffer of {BUFFER_BYTES // 1024} KiB" in PAGE
    assert f"| `payload` | {PAYLOAD_BYTES} |" in PAGE
    assert f"| `timeout_ms` | {config.flow_timeout_us // 1000} |" in PAGE
    assert f"| `padding` | 0x{config.padding:02X} |" in PAGE


def frames_for(size: int) -> int:
    """Data field bytes of one largest link frame, flow control included."""
    one, other = IsoTp(IsoTpConfig(frame_bytes=size)), IsoTp(IsoTpConfig(frame_bytes=size))
    one.send(bytes(MAX_FRAME_BYTES + 2))
    count = 0
    while one.sending:
        for source, sink in ((one, other), (other, one)):
            data, _ = source.next_frame(0)
            count += len(data)
            sink.receive(data, 0) if data else None
    return count


def test_the_efficiency_that_the_page_states() -> None:
    classic, fd = frames_for(8), frames_for(64)
    page = PAGE.replace("\n", " ").replace(" %", "%")
    assert f"that is {classic} for {MAX_PAYLOAD_BYTES}, {MAX_PAYLOAD_BYTES / classic:.0%};" in page
    assert f"FD's 64 it is {fd}, {MAX_PAYLOAD_BYTES / fd:.0%}." in page


def test_the_recording_on_the_page_is_one(tmp_path: Path) -> None:
    found = re.search(rf"^{HEADER}$.*?(?=^```)", PAGE, re.MULTILINE | re.DOTALL)
    assert found is not None
    path = tmp_path / "page.log"
    path.write_text(found[0])
    assert [line.kind for line in read_log(path)] == [">", "<", "!", "!"]
