"""Drivers of the navigation board: registers and counts in, SI out.

A driver knows the data sheet of its chip and the registers of the MCU, and nothing of the chip's
model: constants are stated again here, so that an error in either shows.
"""
