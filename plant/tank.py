"""The tank: a rectangle of water with walls along the axes of the tank frame."""

from dataclasses import dataclass

from plant.checks import check_number


@dataclass(frozen=True, slots=True)
class Tank:
    """Walls at x_min, x_max, y_min, y_max (m). The default leaves room to the target (2, 2)."""

    x_min_m: float = -2.0
    y_min_m: float = -2.0
    x_max_m: float = 4.0
    y_max_m: float = 4.0
    depth_m: float = 0.6

    def __post_init__(self) -> None:
        """Refuse tanks without extent."""
        check_number("tank.x_min_m", self.x_min_m)
        check_number("tank.y_min_m", self.y_min_m)
        check_number("tank.x_max_m", self.x_max_m, above=self.x_min_m)
        check_number("tank.y_max_m", self.y_max_m, above=self.y_min_m)
        check_number("tank.depth_m", self.depth_m, above=0.0)

    @property
    def corners_m(self) -> tuple[tuple[float, float], ...]:
        """Corners counter-clockwise from (x_min, y_min)."""
        return (
            (self.x_min_m, self.y_min_m),
            (self.x_max_m, self.y_min_m),
            (self.x_max_m, self.y_max_m),
            (self.x_min_m, self.y_max_m),
        )

    def wall_distance_m(self, x_m: float, y_m: float) -> float:
        """Distance to the nearest wall, negative outside (there: to the wall most overstepped)."""
        return min(x_m - self.x_min_m, self.x_max_m - x_m, y_m - self.y_min_m, self.y_max_m - y_m)

    def contains(self, x_m: float, y_m: float) -> bool:
        """Tell whether a point lies in the water, walls included."""
        return self.wall_distance_m(x_m, y_m) >= 0.0
