"""docs/plant-in-the-loop.md: its C compiles, and its figures are those of the code."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from spi_bus.plant_messages import PLANT_MESSAGES, STREAMED
from spi_bus.transports.capacity import FRAME_OVERHEAD, LineSpeed
from tools.bench.plant_rate import most_rate_hz, stale_after_s

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "plant-in-the-loop.md").read_text(encoding="utf-8")


def test_the_c_of_the_page_compiles(tmp_path: Path) -> None:
    if shutil.which("gcc") is None:
        pytest.skip("gcc is absent: the page's C is not compiled")
    (code,) = re.findall(r"```c\n(.*?)```", PAGE, re.DOTALL)
    source = tmp_path / "board.c"
    source.write_text(
        f"{code}\nvoid use(void);\nvoid use(void)\n{{\n    pulse_ended(1, 2, 15000);\n"
        "    fishbed_init(&plant, FISHBED_SLAVE, 1, 0, on_plant, 0,\n"
        "                 fishbed_plant_from_master);\n}\n",
        encoding="utf-8",
    )
    done = subprocess.run(
        ["gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-DFISHBED_MAX_PAYLOAD=64",
         f"-I{ROOT / 'spi_bus' / 'firmware_c'}", "-c", source, "-o", tmp_path / "board.o"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


def test_every_message_is_on_the_page_with_how_it_goes() -> None:
    for row in PLANT_MESSAGES.rows:
        name = row.layout.name
        how = "stream" if row.layout.message in STREAMED else "message"
        (line,) = [
            line
            for line in PAGE.splitlines()
            if re.match(rf"\| .*`{name}`.*\| (host|board|both)", line)
        ]
        assert f"| {how} |" in line


def test_figures_are_those_of_the_code() -> None:
    sample = next(row for row in PLANT_MESSAGES.rows if row.layout.name == "SensorSample")
    assert f"A sample is {sample.size + FRAME_OVERHEAD} bytes on the wire" in PAGE
    slow = LineSpeed(115_200)
    plain, with_gps = most_rate_hz(slow, gps=False), most_rate_hz(slow, gps=True)
    assert f"carry {int(plain)} samples a second, {int(with_gps)} with a GPS" in PAGE
    assert f"| 69 bytes on the line | {1e3 * slow.seconds(sample.size):.1f} ms |" in PAGE
    pulse = next(row for row in PLANT_MESSAGES.rows if row.layout.name == "ServoPulse")
    assert f"| 30 bytes on the line | {1e3 * slow.seconds(pulse.size):.1f} ms |" in PAGE
    assert stale_after_s(100.0) == pytest.approx(0.1)
    assert stale_after_s(1000.0) == pytest.approx(0.05)
