"""The C link on a machine whose int has 16 bits: compiled by clang, run by mspdebug's simulator."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

SOURCES = Path(__file__).resolve().parents[3] / "spi_bus" / "firmware_c"
HERE = Path(__file__).resolve().parent
MISSING = [name for name in ("clang", "ld.lld", "mspdebug") if not shutil.which(name)]

START = """\
.text
.global _start
_start:
 mov #0x5A80, &0x0120   ; the watchdog stops
 mov #0x3900, r1        ; the stack grows down from the end of RAM
 call #run
done:
 jmp done
.section .vectors, "a"
.word _start
"""
LAYOUT = """\
ENTRY(_start)
SECTIONS {
  . = 0x1100; .bss (NOLOAD) : { *(.bss*) *(COMMON) }
  . = 0x4000; .text : { *(.text*) *(.rodata*) *(.data*) }
  . = 0xFFFE; .vectors : { *(.vectors) }
}
"""


@pytest.mark.oracle
@pytest.mark.skipif(bool(MISSING), reason=f"absent: {', '.join(MISSING)}")
def test_a_simulated_msp430_says_what_the_host_says(build, tmp_path):
    sources = (HERE / "machine16.c", SOURCES / "fishbed_link.c", SOURCES / "fishbed_frame.c")
    host = build("machine16", "ordinary", *sources, more=["-DHOST"])
    expected = subprocess.run([host], capture_output=True, text=True, check=True).stdout.split()
    assert expected[0] == "600d"
    assert expected[7] == "d64e"
    assert int(expected[2], 16) == 60, "every command arrived once"
    assert int(expected[4], 16) > 10, "the wire was bad"

    (tmp_path / "start.s").write_text(START)
    (tmp_path / "layout.ld").write_text(LAYOUT)
    clang = ["clang", "--target=msp430"]
    flags = [
        "-mhwmult=none",
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-O1",
        "-ffreestanding",
        "-fno-builtin",
    ]
    objects = []
    for source in (*sources, tmp_path / "start.s"):
        extra = [*flags, f"-I{SOURCES}"] if source.suffix == ".c" else []
        objects.append(tmp_path / f"{source.stem}.o")
        subprocess.run([*clang, *extra, "-c", source, "-o", objects[-1]], check=True)
    image = tmp_path / "image.elf"
    subprocess.run(["ld.lld", "-T", tmp_path / "layout.ld", *objects, "-o", image], check=True)
    symbols = subprocess.run(["nm", image], capture_output=True, text=True, check=True).stdout
    address = {line.split()[2]: int(line.split()[0], 16) for line in symbols.splitlines()}
    commands = [
        f"prog {image}", f"setbreak {address['done']:#x}", "run", f"md {address['result']:#x} 16",
    ]  # fmt: skip
    told = subprocess.run(
        ["mspdebug", "-q", "sim", *commands],
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    ).stdout
    dump = re.findall(r"^ +[0-9a-f]+: ((?:[0-9a-f]{2} ){16})\|", told, re.MULTILINE)[-1]
    octets = dump.split()
    assert [octets[i + 1] + octets[i] for i in range(0, 16, 2)] == expected
