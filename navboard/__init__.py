"""The dsPIC navigation board: chips, drivers, motion, sensor and SPI controllers."""
