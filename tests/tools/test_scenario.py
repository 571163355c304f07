"""Scenarios: what loads, what is refused and how, and that writing and reading is identity."""

from __future__ import annotations

import tomllib
import types
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plant.extra_force import PLACES
from tools import scenario
from tools.configuration import Scenario
from tools.errors import ScenarioError

BUNDLED = (
    "circle",
    "fishbed-robot",
    "power-loss",
    "reach-target",
    "rough-link",
    "shoal",
    "shoal-survey",
    "survey-tank",
    "swim-forward",
    "track-targets",
    "wang2014",
)


def test_the_bundled_scenarios_are_those_of_the_issue() -> None:
    assert tuple(scenario.bundled()) == BUNDLED


@pytest.mark.parametrize("name", BUNDLED)
def test_a_bundled_scenario_loads_has_its_name_and_survives_writing(name: str) -> None:
    config = scenario.load(name)
    assert config.scenario.name == name
    assert scenario.from_mapping(tomllib.loads(scenario.to_toml(config))) == config


def test_bundled_scenarios_say_what_the_issue_asks() -> None:
    forward, circle, target, rough = (
        scenario.load(name) for name in ("swim-forward", "circle", "reach-target", "rough-link")
    )
    beat = forward.procboard.tail_beat
    assert (beat.bias_rad, beat.frequency_hz) == (0.0, 0.9)
    assert beat.amplitude_rad == pytest.approx(0.261799, abs=1e-6)
    assert circle.procboard.tail_beat.bias_rad == pytest.approx(0.349066, abs=1e-6)
    assert target.procboard.heading.target_m == (2.0, 2.0)
    assert target.procboard.heading.update_period_s == 5.0
    assert rough.radio.loss_probability == 0.3
    assert rough.link.bit_error_rate > 0
    assert scenario.load("power-loss").faults.flash_cuts


REFUSED = {
    "plant.bdoy.mass_kg=1": "plant.bdoy: no such key; did you mean plant.body?",
    "plant.body.mass_g=1": "did you mean plant.body.mass_kg?",
    "mass_kg=1": "did you mean plant.body.mass_kg?",
    "procboard.tail_beat.amplitude_deg=15": "procboard.tail_beat.amplitude_rad?",
    "link.zzzz=1": "link.zzzz: no such key; allowed here: bit_error_rate",
    "plant.body.mass_kg=-1": "plant.body.mass_kg = -1: must be a number > 0",
    'plant.body.mass_kg="a"': "plant.body.mass_kg = 'a': must be a number",
    "plant.body.mass_kg=true": "plant.body.mass_kg = true: must be a number",
    "plant=3": "plant = 3: must be a table",
    "scenario.duration_s=-5": "scenario.duration_s = -5: must be a number > 0",
    "scenario.duration_s=inf": "must be a finite number",
    "initial.x_m=nan": "initial.x_m = nan: must be a finite number",
    "scenario.seed=1.5": "must be a whole number",
    "tank.size_m=[1]": "must be a list in [ ] with 2 elements",
    "tank.size_m[0]=0": "tank.size_m[0] = 0: must be a number > 0",
    "tank.size_m[7]=1": "there is no tank.size_m[7]",
    "initial.x_m=50": "initial.x_m = 50: must lie in the tank",
    "link.bit_error_rate=1.5": "must be a number >= 0 and <= 0.5",
    "radio.tx_power_dbm=3": "must be one of 0, -1, -3",
    "procboard.application=foo": "must be one of 'open-loop', 'heading', 'target-tracking'",
    "procboard.address=0": "must not be the address of the other",
    "procboard.address=65535": "reserved",
    "procboard.heading.gain=-0.1": "must be a number >= 0",
    "navboard.gyro.bias_rad_s=1e300": "must be a number >= -50 and <= 50",
    "navboard.report_period_s=0.004": ">= 0.005",
    "procboard.tail_beat.amplitude_rad=1.6": "<= 1.57079",
    "navboard={control_hz=40, report_period_s=0.02}": "in a control tick: at least 0.025 s",
    "base_station.tail_beats=[{bias_rad=0.1}]": "tail_beats[0].at_s is missing",
    'scenario.name="../x"': "must begin with a letter or digit",
    "x": "write KEY=VALUE",
    "a..b=1": "is no key",
    "a=[": "is no TOML value",
    'a="1"\nb=2': "one value is wanted",
}


@pytest.mark.parametrize("text", REFUSED)
def test_nonsense_is_refused_in_one_line_with_its_path(text: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario.load("swim-forward", [text])
    message = str(caught.value)
    assert REFUSED[text] in message
    assert "\n" not in message
    assert message.startswith("--set")


def test_who_heads_for_a_target_beats_its_tail() -> None:
    with pytest.raises(
        ScenarioError, match=r"^--set: procboard\.tail_beat\.frequency_hz = 0: must"
    ):
        scenario.load("reach-target", ["procboard.tail_beat.frequency_hz=0"])


def floats(kind: Any) -> list[Any]:
    """The numeric types inside a declared type, with what is annotated there."""
    bare = scenario.bare_type(kind)
    if get_origin(bare) is tuple:
        return [found for arg in get_args(bare) if arg is not ... for found in floats(arg)]
    if isinstance(bare, type) and issubclass(bare, msgspec.Struct):
        return [
            found
            for hint in get_type_hints(bare, include_extras=True).values()
            for found in floats(hint)
        ]
    return [kind] if bare is float else []


def test_every_number_has_both_bounds_and_what_is_printed_of_them_is_allowed() -> None:
    found = floats(Scenario)
    assert len(found) > 90
    for kind in found:
        words = scenario.bounds(kind)
        assert ">" in words, kind
        assert "<" in words, kind
        for sign, text in (part.split(" ") for part in words.split(" and ")):
            if "=" in sign:
                decoded = kind if get_origin(kind) is Annotated else get_args(kind)[0]
                assert msgspec.convert(float(text), decoded) == float(text)


def test_a_message_names_the_file_that_must_be_mended(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text('base = "circle"\n[plant.body]\nmass_kg = -2\n', encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"mine\.toml: plant\.body\.mass_kg = -2"):
        scenario.load(file)


def test_the_option_is_named_where_the_option_is_wrong() -> None:
    with pytest.raises(ScenarioError, match=r"^--seed: scenario\.seed = -1"):
        scenario.load(seed=-1)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[plant", "not valid TOML"),
        ('base = "nowhere"', "no scenario of this name"),
        ("base = 3", "must be a scenario's name"),
        ('base = "mine.toml"', "goes round in a circle"),
    ],
)
def test_broken_files_are_refused(tmp_path: Path, text: str, says: str) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ScenarioError, match=says):
        scenario.load(file)


def test_missing_and_unreadable_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="cannot be read: No such file"):
        scenario.load(tmp_path / "none.toml")
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ScenarioError, match="UTF-8"):
        scenario.load(binary)
    with pytest.raises(ScenarioError, match="did you mean circle"):
        scenario.load("circel")


def test_inheritance_merges_tables_replaces_lists_and_prefers_a_file_beside(tmp_path: Path) -> None:
    (tmp_path / "mother.toml").write_text(
        'base = "rough-link"\n[plant.body]\nmass_kg = 0.5\n', encoding="utf-8"
    )
    (tmp_path / "child.toml").write_text(
        'base = "mother.toml"\n[scenario]\nname = "child"\n[plant.tail]\nlength_m = 0.1\n'
        "[[base_station.tail_beats]]\nat_s = 1.0\n",
        encoding="utf-8",
    )
    config = scenario.load(tmp_path / "child.toml")
    assert config.scenario.name == "child"
    assert config.plant.body.mass_kg == 0.5
    assert config.plant.tail.length_m == 0.1
    assert config.radio.loss_probability == 0.3
    assert [beat.at_s for beat in config.base_station.tail_beats] == [1.0]


def test_set_reaches_into_lists_and_later_ones_win() -> None:
    sets = ["base_station.tail_beats[1].bias_rad=0.5", "link.bit_error_rate=0"]
    config = scenario.load("rough-link", [*sets, "link.bit_error_rate=1e-3"])
    assert config.base_station.tail_beats[1].bias_rad == 0.5
    assert config.link.bit_error_rate == 1e-3


def test_every_leaf_has_a_key_that_set_accepts() -> None:
    config = scenario.load("rough-link")
    sets = [
        f"{key}={value if not isinstance(value, bool) else str(value).lower()}"
        for key, value in scenario.keys(config).items()
        if isinstance(value, (int, float))
    ]
    assert len(sets) > 80
    assert scenario.load("rough-link", sets) == config


def _strategy(kind: Any) -> st.SearchStrategy[Any]:
    """Values of a declared type within its declared bounds."""
    metas = [meta for meta in getattr(kind, "__metadata__", ()) if isinstance(meta, msgspec.Meta)]
    bare = kind
    while get_origin(bare) is Annotated:
        bare = get_args(bare)[0]
    origin = get_origin(bare)
    if origin in (Union, types.UnionType):
        options = [None if arg is type(None) else arg for arg in get_args(bare)]
        return st.one_of(*(st.none() if arg is None else _strategy(arg) for arg in options))
    if origin is Literal:
        return st.sampled_from(get_args(bare))
    if origin is dict:
        return st.dictionaries(st.sampled_from(list(PLACES)), _strategy(get_args(bare)[1]))
    if origin is tuple:
        args = get_args(bare)
        if args[-1] is Ellipsis:
            return st.lists(_strategy(args[0]), max_size=2).map(tuple)
        return st.tuples(*(_strategy(arg) for arg in args))
    if isinstance(bare, type) and issubclass(bare, msgspec.Struct):
        hints = get_type_hints(bare, include_extras=True)
        hints.pop("robots", None)  # addresses of a shoal, which is checked against them
        return st.builds(bare, **{name: _strategy(hint) for name, hint in hints.items()})
    low = next((v for m in metas for v in (m.ge, m.gt) if v is not None), None)
    high = next((v for m in metas for v in (m.le, m.lt) if v is not None), None)
    if bare is bool:
        return st.booleans()
    if bare is int:
        return st.integers(low, high)
    if bare is str:
        if any(meta.pattern for meta in metas):
            return st.from_regex(r"\A[A-Za-z0-9][A-Za-z0-9._-]{0,9}\Z")
        return st.text(max_size=8, alphabet=st.characters(exclude_categories=["Cs"]))
    open_low = any(meta.gt is not None for meta in metas)
    return st.floats(
        low, high, allow_nan=False, allow_infinity=False, exclude_min=open_low and low is not None
    )


CONSISTENT = ("initial", "tank", "base_station", "procboard", "hil", "shoal")
"""Sections that are checked against each other; the property uses the defaults for them."""

SCENARIOS = st.builds(
    Scenario,
    **{
        name: _strategy(hint)
        for name, hint in get_type_hints(Scenario, include_extras=True).items()
        if name not in CONSISTENT
    },
).filter(
    lambda config: (
        config.navboard.tail_limit_rad > config.procboard.tail_beat.amplitude_rad
        and config.navboard.report_period_s * config.navboard.control_hz >= 1.0
    )
)


@settings(max_examples=60, deadline=None)
@given(SCENARIOS)
def test_any_valid_scenario_written_as_toml_loads_to_the_identical_one(config: Scenario) -> None:
    again = scenario.from_mapping(tomllib.loads(scenario.to_toml(config)))
    assert again == config
    assert scenario.to_toml(again) == scenario.to_toml(config)
