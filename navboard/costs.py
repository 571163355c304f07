"""What firmware's code costs in instruction cycles.

Counted by hand from the assembly that a C compiler makes of such code (about two cycles a C
operator on 16-bit data), and for floating point from the performance table of Microchip's 16-bit
library manual (DS51456), which is quoted from memory and so unconfirmed to 10 %. One cycle is
67.8 ns at 14.7456 MIPS.
"""

from __future__ import annotations

FLOAT_ADD = 122
FLOAT_MULTIPLY = 109
FLOAT_DIVIDE = 361
FLOAT_FROM_INTEGER = 60
FLOAT_ATAN2 = 2960

ISR_CONTEXT = 14  # prologue and epilogue: push and pop of W0–W7 and RCOUNT, estimated
SPI_ISR = ISR_CONTEXT + 46  # estimated: two buffer accesses, two bytes packed, index, zeros
UART_ISR = ISR_CONTEXT + 10
UART_CHARACTER = 16  # estimated: read, store, compare with LF
TICK_ISR = ISR_CONTEXT + 26  # estimated: flag, ASAM, counters of the supervisor
ADC_ISR = ISR_CONTEXT + 12
PPS_ISR = ISR_CONTEXT + 30  # estimated: 32-bit time stamp, extended to 48

I2C_POLL = 6  # estimated: BTST, BRA, and the loop's share of lateness
I2C_STEP = 12  # estimated: function call and register accesses an operation

MOTION_STEP = 240  # estimated: four 32-bit multiplications, table look-up, limits
SERVO_WRITE = 30  # estimated: one 32-bit multiplication, a shift, a store
ANALOG_CHANNEL = FLOAT_FROM_INTEGER + FLOAT_MULTIPLY + FLOAT_ADD
COMPASS = 4 * FLOAT_MULTIPLY + 4 * FLOAT_ADD + FLOAT_ATAN2
ACCELEROMETER = 3 * (FLOAT_FROM_INTEGER + FLOAT_MULTIPLY)
FILTER_PREDICT = 8 * FLOAT_MULTIPLY + 9 * FLOAT_ADD
FILTER_UPDATE = 10 * FLOAT_MULTIPLY + 12 * FLOAT_ADD + FLOAT_DIVIDE
REPORT = 13 * (FLOAT_MULTIPLY + FLOAT_FROM_INTEGER) + 400  # scaling of every field, packing
NMEA_CHARACTER = 45  # estimated: checksum, field splitting, digits
LINK_BYTE = 48  # estimated: CRC by table, COBS, copy
LINK_CALL = 350  # estimated: header, sequence numbers, timers
MESSAGE = 250  # estimated: dispatch and unpacking
EEPROM_POLL = 100
"""Cycles between two looks at NVMCON.WR."""
CONTROL_LOOP = 120  # estimated: scheduling of the rest of a tick
INITIALISE = 4_000  # estimated: start-up code clears 8 KiB of RAM, peripherals are set up
