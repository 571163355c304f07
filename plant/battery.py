"""The pack: two lithium-polymer cells, 7.4 V, 13.32 Wh; charge counted from currents.

Terminal voltage = cells · OCV(state of charge) − R · current. The open-circuit curve is the one
that circulates as the "LiPo voltage chart" among model builders (4.20 V full, 3.84 V at half,
3.27 V empty per cell); the data sheet of the robot's pack is not published, so curve and internal
resistance are assumed. The knee below 10 % is what a run notices: speed falls with voltage.
"""

from bisect import bisect_left
from dataclasses import dataclass
from itertools import pairwise

from plant.checks import check_number
from plant.errors import InvalidParameterError

OPEN_CIRCUIT_V = (
    (0.00, 3.27),
    (0.05, 3.61),
    (0.10, 3.69),
    (0.20, 3.73),
    (0.30, 3.77),
    (0.40, 3.80),
    (0.50, 3.84),
    (0.60, 3.87),
    (0.70, 3.95),
    (0.80, 4.02),
    (0.90, 4.11),
    (1.00, 4.20),
)
"""Open-circuit voltage of one cell over state of charge (assumed, see above)."""


@dataclass(frozen=True, slots=True)
class BatteryParameters:
    """Pack data. 13.32 Wh at 7.4 V are 1.8 Ah (source, Table 2.1); the rest is assumed."""

    cells: int = 2
    capacity_ah: float = 1.8
    internal_resistance_ohm: float = 0.12
    initial_charge: float = 1.0
    cut_off_v_per_cell: float = 3.0
    open_circuit_v: tuple[tuple[float, float], ...] = OPEN_CIRCUIT_V

    def __post_init__(self) -> None:
        """Refuse a pack without cells, and a curve that does not rise from empty to full."""
        if isinstance(self.cells, bool) or not isinstance(self.cells, int) or self.cells < 1:
            raise InvalidParameterError("battery.cells", f"must be 1 or more, got {self.cells!r}")
        check_number("battery.capacity_ah", self.capacity_ah, above=0.0)
        check_number("battery.internal_resistance_ohm", self.internal_resistance_ohm, least=0.0)
        check_number("battery.initial_charge", self.initial_charge, least=0.0, most=1.0)
        check_number("battery.cut_off_v_per_cell", self.cut_off_v_per_cell, least=0.0)
        curve = self.open_circuit_v
        if len(curve) < 2 or curve[0][0] != 0.0 or curve[-1][0] != 1.0:
            raise InvalidParameterError("battery.open_circuit_v", "must run from charge 0 to 1")
        for (charge, volts), (more_charge, more_volts) in pairwise(curve):
            if more_charge <= charge or more_volts <= volts:
                raise InvalidParameterError("battery.open_circuit_v", "must rise at every point")


class Battery:
    """A pack in use. ``draw`` counts charge; voltages follow from what is left."""

    __slots__ = ("_capacity_c", "_charges", "charge_drawn_c", "energy_j", "parameters")

    def __init__(self, parameters: BatteryParameters | None = None) -> None:
        self.parameters = parameters or BatteryParameters()
        self._capacity_c = self.parameters.capacity_ah * 3600.0
        self._charges = [charge for charge, _ in self.parameters.open_circuit_v]
        self.charge_drawn_c = (1.0 - self.parameters.initial_charge) * self._capacity_c
        self.energy_j = 0.0
        """Energy given to the load so far, J."""

    @property
    def state_of_charge(self) -> float:
        """Fraction of the capacity that is left, 0…1."""
        return max(0.0, 1.0 - self.charge_drawn_c / self._capacity_c)

    def draw(self, current_a: float, duration_s: float) -> None:
        """Take a current for a time, negative currents charging up to full."""
        self.energy_j += self.terminal_v(current_a) * current_a * duration_s
        drawn = self.charge_drawn_c + current_a * duration_s
        self.charge_drawn_c = min(max(drawn, 0.0), self._capacity_c)

    def open_circuit_v(self) -> float:
        """Voltage of the unloaded pack, linear between the points of the curve."""
        charge = self.state_of_charge
        parameters = self.parameters
        above = max(1, bisect_left(self._charges, charge))
        low, low_v = parameters.open_circuit_v[above - 1]
        high, high_v = parameters.open_circuit_v[above]
        cell_v = low_v + (charge - low) / (high - low) * (high_v - low_v)
        return parameters.cells * cell_v

    def terminal_v(self, current_a: float) -> float:
        """Voltage under a load; 0 where protection has cut the pack off."""
        if self.charge_drawn_c >= self._capacity_c:
            return 0.0
        volts = self.open_circuit_v() - self.parameters.internal_resistance_ohm * current_a
        cut_off = self.parameters.cells * self.parameters.cut_off_v_per_cell
        return volts if volts >= cut_off else 0.0
