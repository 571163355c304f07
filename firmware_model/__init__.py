"""The emulation kernel: time, scheduler, signals, registers, interrupts, CPU, power, trace; MCU peripherals."""
