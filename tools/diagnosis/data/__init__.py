"""Measured data: an experiment's folder, tables and units, and what is wrong with them."""
