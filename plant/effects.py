"""Every named physical effect as a change of the plant's parameters: the table ``EFFECTS``.

An effect has a name, parameters with units and bounds, and a pure function that applies values to
``PlantParameters``. The neutral value of every parameter is zero, and neutral values return
parameters that are equal to those given, so that the motion is the same bit for bit. The physics is
elsewhere; a row only says which parameters it moves. Names are those of the causes that a diagnosis
can find; what lies in sensors, clocks and links is no business of the plant and has no row here.

Bounds are physical, not tuned: a servo that lags by 2 s or a robot of ten times its mass is absurd,
and still computes. What is impossible for the given robot (a mass below zero) the parameters refuse
themselves; the message then names the effect.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from plant.checks import check_number
from plant.errors import InvalidParameterError
from plant.parameters import PlantParameters

Apply = Callable[[PlantParameters, Mapping[str, float]], PlantParameters]


@dataclass(frozen=True, slots=True)
class EffectParameter:
    """A number of an effect: neutral at zero, allowed in [least, most] (SI ``unit``, "" is 1)."""

    name: str
    unit: str
    least: float
    most: float

    @property
    def neutral(self) -> float:
        """The value that changes nothing: zero, for every effect."""
        return 0.0

    def __str__(self) -> str:
        """Name, unit and range in a few words."""
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.name} {self.least:g} … {self.most:g}{unit}"


@dataclass(frozen=True, slots=True)
class Effect:
    """A named change of the plant. ``change`` takes a value for each of ``parameters``."""

    name: str
    description: str
    parameters: tuple[EffectParameter, ...]
    change: Apply

    @property
    def part(self) -> str:
        """Its parameters in words, for `fishbed list`."""
        return ", ".join(str(item) for item in self.parameters)

    def apply(self, plant: PlantParameters, values: Mapping[str, float]) -> PlantParameters:
        """Return the changed plant; values that are missing are neutral.

        Raises ``InvalidParameterError`` with the path ``effects.NAME.PARAMETER`` for a name or a
        value that is not allowed, and ``effects.NAME`` where the plant cannot be changed so.
        """
        path = f"effects.{self.name}"
        known = {item.name: item for item in self.parameters}
        for name, value in values.items():
            if name not in known:
                raise InvalidParameterError(f"{path}.{name}", f"unknown; there are {[*known]}")
            bounds = known[name]
            check_number(f"{path}.{name}", value, least=bounds.least, most=bounds.most)
        full = {name: float(values.get(name, 0.0)) for name in known}
        try:
            return self.change(plant, full)
        except InvalidParameterError as error:
            given = ", ".join(f"{name} = {value:g}" for name, value in full.items())
            raise InvalidParameterError(
                path, f"{given} makes {error.field} impossible: {error.reason}"
            ) from error


def with_effects(
    plant: PlantParameters, values: Mapping[str, Mapping[str, float]]
) -> PlantParameters:
    """Apply several effects by name, in the order of the table whatever the order given."""
    for name in values:
        if name not in EFFECTS:
            raise InvalidParameterError(f"effects.{name}", "unknown effect")
    for name, effect in EFFECTS.items():
        if name in values:
            plant = effect.apply(plant, values[name])
    return plant


def _added(section: str, **fields: str) -> Apply:
    """Make a change that adds each parameter to a field of a section."""

    def change(plant: PlantParameters, values: Mapping[str, float]) -> PlantParameters:
        part = getattr(plant, section)
        sums = {field: getattr(part, field) + values[name] for name, field in fields.items()}
        return replace(plant, **{section: replace(part, **sums)})

    return change


def _scaled(section: str, *fields: str, sign: float = 1.0) -> Apply:
    """Make a change that multiplies fields of a section by 1 + k (1 − k with ``sign`` −1)."""

    def change(plant: PlantParameters, values: Mapping[str, float]) -> PlantParameters:
        part = getattr(plant, section)
        factor = 1.0 + sign * values["k"]
        products = {field: getattr(part, field) * factor for field in fields}
        return replace(plant, **{section: replace(part, **products)})

    return change


def _gain(plant: PlantParameters, values: Mapping[str, float]) -> PlantParameters:
    """(1 + g₀)(1 + g) − 1, written so that g = 0 leaves the bits of g₀."""
    before, g = plant.linkage.gain_error, values["g"]
    return replace(plant, linkage=replace(plant.linkage, gain_error=before + g + before * g))


def _payload(plant: PlantParameters, values: Mapping[str, float]) -> PlantParameters:
    """Body mass + dm, and the inertia in proportion: the payload is spread as the mass is."""
    body = plant.body
    mass = body.mass_kg + values["dm_kg"]
    inertia = body.yaw_inertia_kg_m2 * (mass / body.mass_kg)
    return replace(plant, body=replace(body, mass_kg=mass, yaw_inertia_kg_m2=inertia))


_SEGMENTS = 5
_DAMPING_S = 0.079
"""κ of chapter 4, damping over stiffness of the tail's sheet."""

_LEAST_COMPLIANCE = 1e-6
"""rad/(N·m): below, the joints are stiffer than parameters allow, and the tail is rigid."""


def _flexibility(plant: PlantParameters, values: Mapping[str, float]) -> PlantParameters:
    """Five segments with joints of compliance 1/K_S, beside what their joints have already."""
    tail, compliance = plant.tail, values["compliance_rad_n_m"]
    if compliance < _LEAST_COMPLIANCE:
        return plant
    if not tail.flexible:
        softer = replace(
            tail,
            segments=_SEGMENTS,
            joint_stiffness_n_m=1.0 / compliance,
            damping_s=_DAMPING_S,
        )
    elif tail.segments == _SEGMENTS and tail.joint_stiffness_n_m > 0.0:
        softer = replace(
            tail, joint_stiffness_n_m=1.0 / (1.0 / tail.joint_stiffness_n_m + compliance)
        )
    else:
        raise InvalidParameterError(
            "tail.segments",
            f"the effect is that of {_SEGMENTS} segments on a rigid tail, or on as many that have "
            "a joint_stiffness_n_m",
        )
    return replace(plant, tail=softer)


_K = (EffectParameter("k", "", -1.0, 100.0),)

_ROWS = (
    Effect(
        "water_current",
        "uniform steady current in the tank frame",
        (
            EffectParameter("cx_m_s", "m/s", -10.0, 10.0),
            EffectParameter("cy_m_s", "m/s", -10.0, 10.0),
        ),
        _added("water", cx_m_s="current_x_m_s", cy_m_s="current_y_m_s"),
    ),
    Effect(
        "tail_offset",
        "true bias = commanded + delta",
        (EffectParameter("delta_rad", "rad", -1.5, 1.5),),
        _added("linkage", delta_rad="offset_rad"),
    ),
    Effect(
        "tail_gain",
        "true deflection = (1 + g) × commanded",
        (EffectParameter("g", "", -1.0, 10.0),),
        _gain,
    ),
    Effect(
        "tail_fade",
        "deflection falls as 1 − k t over a run, to zero at most (a sagging pack)",
        (EffectParameter("k_per_s", "1/s", -1.0, 1.0),),
        _added("linkage", k_per_s="fade_per_s"),
    ),
    Effect(
        "servo_lag",
        "first-order lag from command to tail",
        (EffectParameter("tau_s", "s", 0.0, 10.0),),
        _added("servo", tau_s="command_lag_s"),
    ),
    Effect(
        "servo_delay",
        "pure delay from command to tail",
        (EffectParameter("delay_s", "s", 0.0, 10.0),),
        _added("servo", delay_s="command_delay_s"),
    ),
    Effect(
        "servo_rate_limit",
        "1 / (largest speed of the servo); 0 is unlimited",
        (EffectParameter("excess_s_rad", "s/rad", 0.0, 1e3),),
        _added("servo", excess_s_rad="slowness_s_rad"),
    ),
    Effect(
        "servo_deadband",
        "the servo does not move while |command − position| < delta",
        (EffectParameter("delta_rad", "rad", 0.0, 1.0),),
        _added("servo", delta_rad="extra_dead_band_rad"),
    ),
    Effect(
        "servo_backlash",
        "full width of play between servo and tail",
        (EffectParameter("play_rad", "rad", 0.0, 2.0),),
        _added("linkage", play_rad="play_rad"),
    ),
    Effect(
        "drag_scale",
        "C_D × (1 + k), at every bias",
        _K,
        _scaled("hydrodynamics", "drag", "drag_per_bias_squared"),
    ),
    Effect(
        "yaw_drag_scale",
        "K_D × (1 + k), at every bias",
        _K,
        _scaled("hydrodynamics", "yaw_drag_n_m_s2", "yaw_drag_per_bias_n_m_s2"),
    ),
    Effect(
        "lift_scale",
        "C_L (or its surrogate C′_L) × (1 + k)",
        _K,
        _scaled("hydrodynamics", "lift", "lift_per_bias"),
    ),
    Effect(
        "drag_vs_bias",
        "drag that rises with the tail-beat bias: C_D + cd α₀², K_D + kd |α₀|",
        (
            EffectParameter("cd_per_rad2", "1/rad²", -100.0, 100.0),
            EffectParameter("kd_per_rad", "N·m·s²/rad", -1.0, 1.0),
        ),
        _added(
            "hydrodynamics",
            cd_per_rad2="drag_per_bias_squared",
            kd_per_rad="yaw_drag_per_bias_n_m_s2",
        ),
    ),
    Effect(
        "linear_drag",
        "extra force −b V on the body",
        (EffectParameter("b_n_s_m", "N·s/m", 0.0, 100.0),),
        _added("hydrodynamics", b_n_s_m="linear_drag_n_s_m"),
    ),
    Effect("added_mass_surge", "−X_u̇ × (1 + k)", _K, _scaled("body", "added_mass_surge_kg")),
    Effect("added_mass_sway", "−Y_v̇ × (1 + k)", _K, _scaled("body", "added_mass_sway_kg")),
    Effect("added_inertia_yaw", "−N_ṙ × (1 + k)", _K, _scaled("body", "added_inertia_yaw_kg_m2")),
    Effect(
        "payload",
        "body mass + dm, inertia in proportion",
        (EffectParameter("dm_kg", "kg", -100.0, 100.0),),
        _payload,
    ),
    Effect(
        "tail_flexibility",
        "1 / K_S of the joints of a five-segment tail; 0 is a rigid one",
        (EffectParameter("compliance_rad_n_m", "rad/(N·m)", 0.0, 1e4),),
        _flexibility,
    ),
    Effect(
        "fin_damage",
        "tail depth × (1 − k)",
        (EffectParameter("k", "", -1.0, 0.99),),
        _scaled("tail", "depth_m", sign=-1.0),
    ),
    Effect(
        "tail_body_coupling",
        "share of the body motion in the tail forces + k; the share stays within 0 and 1",
        (EffectParameter("k", "", -1.0, 1.0),),
        _added("hydrodynamics", k="body_motion_in_tail"),
    ),
    Effect(
        "wall_effect",
        "drag × (1 + k exp(−distance to the nearest wall / 0.1 m))",
        _K,
        _added("walls", k="drag_rise"),
    ),
)

EFFECTS: dict[str, Effect] = {row.name: row for row in _ROWS}
"""Effects by name, in the order in which they are applied."""
