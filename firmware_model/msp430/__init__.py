"""MSP430F1611: its peripherals at register level, at their true addresses.

One file for each peripheral, named as in the user's guide (SLAU049); `mcu.py` wires them together.
"""
