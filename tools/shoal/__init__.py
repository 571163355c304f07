"""Several emulated robots and a base station, on one clock and one medium."""

from tools.shoal.assembler import ShoalBench

__all__ = ["ShoalBench"]
