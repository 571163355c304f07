"""The C of docs/firmware-c.md compiles as it stands, with what is left to its reader declared."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

PAGE = Path(__file__).resolve().parents[3] / "docs" / "firmware-c.md"
LEFT_TO_THE_READER = """
#include "fishbed_messages.h"
typedef struct { uint8_t bytes[64]; uint16_t head, tail; } ring;
extern ring received, transmit;
extern unsigned reports_lost;
uint16_t next_epoch(void);
uint32_t clock_us(void);
uint16_t ring_read(ring *from, uint8_t *bytes, uint16_t most);
uint16_t ring_room(const ring *to);
void ring_write(ring *to, const uint8_t *bytes, uint16_t count);
int ring_is_empty(const ring *which);
int report_is_due(void);
fishbed_sensor_report measure(void);
void servo_follow(int16_t bias, int16_t amplitude, uint16_t frequency);
void data_ready_pin(int up);
void sleep_until_interrupt(void);
"""


@pytest.mark.parametrize(
    ("compiler", "more"), [("gcc", []), ("clang", []), ("clang", ["--target=msp430"])]
)
def test_the_main_loop_of_the_page_compiles(build, tmp_path, compiler, more):
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is absent")
    (code,) = re.findall(r"```c\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    source = tmp_path / "main.c"
    source.write_text(LEFT_TO_THE_READER + code)
    build(f"page-{compiler}{len(more)}.o", "strict", source, more=more, compiler=compiler)
