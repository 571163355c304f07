"""From the parameters that people read to the record that compiled code reads."""

import math

from plant.layout import Packed
from plant.parameters import Linkage, PlantParameters
from plant.profile import factor_at, moments


def virtual_mass_kg_m(parameters: PlantParameters) -> float:
    """Virtual mass per length m = ¼πρd² at the tail's nominal depth, kg/m (3.8)."""
    depth = parameters.tail.depth_m
    return 0.25 * math.pi * parameters.water.density_kg_m3 * depth * depth


def pack(parameters: PlantParameters) -> Packed:
    """Make the record that the compiled right-hand side reads."""
    body, tail, hydro = parameters.body, parameters.tail, parameters.hydrodynamics
    water, walls, servo = parameters.water, parameters.walls, parameters.servo
    linkage = parameters.linkage
    length = tail.length_m
    mass_per_m = virtual_mass_kg_m(parameters)
    first, second, third = moments(mass_per_m, length, tail.depth_profile)
    tip = mass_per_m * factor_at(tail.depth_profile, 1.0) ** 2
    uniform = not tail.depth_profile
    return Packed(
        m1=float(body.mass_kg + body.added_mass_surge_kg),
        m2=float(body.mass_kg + body.added_mass_sway_kg),
        j3=float(body.yaw_inertia_kg_m2 + body.added_inertia_yaw_kg_m2),
        hinge=float(body.hinge_distance_m),
        half_rho_s=0.5 * water.density_kg_m3 * body.wetted_area_m2,
        drag=float(hydro.drag),
        drag_bias=float(hydro.drag_per_bias_squared),
        lift=float(hydro.lift),
        lift_bias=float(hydro.lift_per_bias),
        linear_drag=float(hydro.linear_drag_n_s_m),
        yaw_drag=float(hydro.yaw_drag_n_m_s2),
        yaw_drag_bias=float(hydro.yaw_drag_per_bias_n_m_s2),
        tail_length=float(length),
        tail_mass=tip,
        tail_first=first,
        tail_second=second,
        tail_third=third,
        taper_first=0.0 if uniform else first - tip * length,
        taper_second=0.0 if uniform else second - tip * length * length / 2.0,
        body_motion=float(hydro.body_motion_in_tail),
        munk=float(hydro.munk_coupling),
        current_x=float(water.current_x_m_s),
        current_y=float(water.current_y_m_s),
        placed=1.0 if water.sheared or walls.acting else 0.0,
        shear_x=float(water.shear_x_per_y_s),
        shear_y=float(water.shear_y_per_x_s),
        mass=float(body.mass_kg),
        wall_drag=float(walls.drag_rise),
        wall_stiffness=float(walls.stiffness_n_m),
        x_min=float(walls.x_min_m),
        y_min=float(walls.y_min_m),
        x_max=float(walls.x_max_m),
        y_max=float(walls.y_max_m),
        lag_rate=1.0 / servo.command_lag_s if servo.command_lag_s > 0.0 else 0.0,
        servo_ideal=1.0 if servo.ideal else 0.0,
        servo_tracks=1.0 if servo.tracks else 0.0,
        servo_speed=float(servo.largest_speed_rad_s),
        servo_gain=float(servo.position_gain_per_s),
        servo_rate=1.0 / servo.motor_lag_s,
        servo_dead_band=float(
            servo.extra_dead_band_rad + (0.0 if servo.ideal else servo.dead_band_rad)
        ),
        loosened=0.0 if linkage == Linkage() else 1.0,
        play=0.5 * linkage.play_rad,
        linkage_gain=1.0 + linkage.gain_error,
        linkage_fade=float(linkage.fade_per_s),
        linkage_offset=float(linkage.offset_rad),
        bias_forgetting=1.0 / hydro.bias_memory_s,
    )
