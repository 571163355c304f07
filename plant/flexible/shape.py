"""What a flexible tail looks like: points along it in body axes, and its tip.

Trajectories carry the bend behind the columns of a rigid tail (``flexible.layout``).
"""

import numpy as np

from plant.arrays import FloatArray
from plant.errors import InvalidParameterError
from plant.flexible.modes import shape
from plant.layout import ROW, Column
from plant.parameters import PlantParameters
from plant.trajectory import Trajectory


def bend(parameters: PlantParameters, trajectory: Trajectory) -> tuple[FloatArray, FloatArray]:
    """Bend coordinates (n, E) and their rates: α_2 … α_N (rad), or η_1 … η_E (m)."""
    count = parameters.tail.modes or parameters.tail.segments - 1
    rows = trajectory.rows
    if rows.shape[1] != ROW + 2 * count:
        raise InvalidParameterError("trajectory", "was not made by a robot with this tail")
    return rows[:, ROW : ROW + count], rows[:, ROW + count :]


def segment_angles(parameters: PlantParameters, trajectory: Trajectory) -> FloatArray:
    """Angles α_1 … α_N of the segments to the −x axis, (n, N), rad; of a rigid tail one."""
    if parameters.tail.modes:
        raise InvalidParameterError("tail.modes", "a beam has no segments")
    angles, _ = bend(parameters, trajectory)
    return np.column_stack((trajectory.tail_angle_rad, angles))


def tail_points(
    parameters: PlantParameters, trajectory: Trajectory, stations: int = 21
) -> FloatArray:
    """Points along the tail in body axes from its joint, (n, points, 2), m; joint to tip.

    For segments the N + 1 ends of the segments; for a beam ``stations`` points, displaced along
    the normal of the tangent at the base as the linear theory has it.
    """
    tail = parameters.tail
    if not tail.modes:
        angles = segment_angles(parameters, trajectory)
        length = tail.length_m / tail.segments
        ends = np.zeros((len(angles), tail.segments + 1, 2))
        ends[:, 1:, 0] = -length * np.cumsum(np.cos(angles), axis=1)
        ends[:, 1:, 1] = -length * np.cumsum(np.sin(angles), axis=1)
        return ends
    eta, _ = bend(parameters, trajectory)
    along = np.linspace(0.0, 1.0, stations)
    forms = np.array([[shape(i + 1).value(float(x)) for x in along] for i in range(tail.modes)])
    displaced = eta @ forms
    alpha = trajectory.column(Column.ALPHA)[:, np.newaxis]
    sine, cosine = np.sin(alpha), np.cos(alpha)
    along = tail.length_m * along
    return np.stack(
        (-along * cosine + displaced * sine, -along * sine - displaced * cosine), axis=2
    )


def tip_displacement_m(parameters: PlantParameters, trajectory: Trajectory) -> FloatArray:
    """Displacement of the tip from the body's axis (Fig. 4.7), (n,), m; positive where α is."""
    displaced: FloatArray = -tail_points(parameters, trajectory, 2)[:, -1, 1]
    return displaced
