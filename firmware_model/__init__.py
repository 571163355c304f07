"""The emulation kernel and the MCU peripherals.

Time, scheduler, signals, registers, interrupts, CPU, power and trace; one folder for each MCU.
"""
