"""Counts who heard whom, at the beginning of every frame in the air."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tools.records.shoal_data import Hearing

if TYPE_CHECKING:
    from collections.abc import Mapping

    from radio_802154.air import Transmission
    from radio_802154.medium import Medium


class Tally:
    """Listens to a medium with all its antennas placed; `names` of them by their antennas'."""

    def __init__(self, medium: Medium, names: Mapping[str, str]) -> None:
        count = len(medium.ports)
        self._names = tuple(names[port.name] for port in medium.ports)
        self._sent = np.zeros(count, dtype=np.int64)
        self._heard = np.zeros((count, count), dtype=np.int64)
        medium.on_begin = self._begins

    def _begins(self, transmission: Transmission) -> None:
        self._sent[transmission.source] += 1
        self._heard[transmission.source, transmission.listeners] += 1

    def hearing(self) -> Hearing:
        """Return the counts so far."""
        return Hearing(self._names, self._sent.copy(), self._heard.copy())
