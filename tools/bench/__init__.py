"""The bench: the only place where boards, wires, air, water and host are put together."""

from tools.bench.bench import Bench

__all__ = ["Bench"]
