"""Drivers: what turns registers, pins and SPI bytes into operations on a chip."""
