"""The robots of the source, and the coefficients that were identified for them."""

from dataclasses import replace

from plant.parameters import Hydrodynamics, PlantParameters, Servo, Tail

COEFFICIENT_SETS: dict[str, Hydrodynamics] = {
    # Table 3.2: identified at one bias each; 20° is used throughout chapter 3
    "chapter-3": Hydrodynamics(),
    "chapter-3-30deg": Hydrodynamics(drag=0.2112, yaw_drag_n_m_s2=1.174e-3),
    "chapter-3-40deg": Hydrodynamics(drag=0.2712, yaw_drag_n_m_s2=1.282e-3),
    # (3.32), (3.33)
    "chapter-3-adapted": Hydrodynamics(
        drag=0.1936,
        drag_per_bias_squared=0.1412,
        yaw_drag_n_m_s2=9.655e-4,
        yaw_drag_per_bias_n_m_s2=4.383e-4,
    ),
    # (3.34)
    "chapter-3-surrogate": Hydrodynamics(
        drag=0.2131, lift=0.0, lift_per_bias=0.935, yaw_drag_n_m_s2=1.144e-3
    ),
    # chapter 4 takes the robot as anchored for the forces of its flexible tails
    "chapter-4": Hydrodynamics(drag=0.276, yaw_drag_n_m_s2=7.4e-4, body_motion_in_tail=0.0),
    # chapter 5 neglects the coupling and the body motion in the tail forces (5.5)
    "chapter-5": Hydrodynamics(
        drag=0.386, yaw_drag_n_m_s2=7.82e-4, body_motion_in_tail=0.0, munk_coupling=0.0
    ),
}
"""Published coefficient sets by name."""


def wang2014() -> PlantParameters:
    """Return the bundled model to believe: Table 3.1, chapter 3, open water, ideal servo."""
    return PlantParameters(servo=Servo(ideal=True))


def fishbed_robot() -> PlantParameters:
    """Return the same body with the HS-5646WP."""
    return PlantParameters()


def flexible_tail(segments: int = 5, modes: int = 0) -> Tail:
    """Return the tail of chapter 4: 8 cm × 2.5 cm × 0.3 mm, E 1.48 GPa, κ 0.079 s."""
    return Tail(
        segments=segments, modes=modes, modulus_pa=1.48e9, thickness_m=0.3e-3, damping_s=0.079
    )


def long_flexible_tail(segments: int = 5, modes: int = 0) -> Tail:
    """Return the second tail of chapter 4, of the same sheet: 9.8 cm × 2.34 cm."""
    return replace(flexible_tail(segments, modes), length_m=0.098, depth_m=0.0234)


def wang2014_flexible(tail: Tail | None = None) -> PlantParameters:
    """Return the robot of chapter 4 as published: anchored for its tail forces, ideal servo."""
    return PlantParameters(
        tail=tail or flexible_tail(),
        hydrodynamics=COEFFICIENT_SETS["chapter-4"],
        servo=Servo(ideal=True),
    )
