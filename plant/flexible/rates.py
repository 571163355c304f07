"""One right-hand side for both kinds of flexible tail, so that one integrator is compiled."""

from typing import Any

from plant.compiled import compiled_apart
from plant.flexible.beam import beam_rates
from plant.flexible.segments import segment_rates
from plant.layout import Drive, Packed


@compiled_apart
def flexible_rates(
    p: Packed, drive: Drive, time_s: float, y: Any, out: Any, parts: Any, modes: int, work: Any
) -> None:
    """Write rates and loads (``flexible.layout``) of state ``y`` into ``out``.

    ``parts``: the tail's table; ``modes``: number of beam modes, 0 for segments; ``work``: scratch
    space of ``layout.work_shape``.
    """
    if modes > 0:
        beam_rates(p, drive, time_s, y, out, parts, modes, work)
    else:
        segment_rates(p, drive, time_s, y, out, parts, work)
