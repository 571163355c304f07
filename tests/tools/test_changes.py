"""What a scenario changes in the bundled model, against keys that were set by hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from tools import scenario
from tools.records.changes import changes
from tools.records.data import RunData
from tools.report.page import render

MakeRun = Callable[..., RunData]
SETS = (
    ("effects.fin_damage.k=0.15", "k = 0.15", "0"),
    ("effects.tail_offset.delta_rad=-0.1", "delta = −0.1 rad", "0 rad"),
    ("plant.tail.segments=5", "5", "1"),
    ("plant.tail.modulus_pa=1.48e9", "1.48e+09 Pa", "0 Pa"),
    ("plant.tail.thickness_m=3e-4", "0.0003 m", "0 m"),
    ("plant.tail.depth_profile=[1.0, 1.2]", "1.2", "none"),
    ("plant.water.shear_x_per_y_s=0.02", "0.02 1/s", "0 1/s"),
    ("plant.walls.stiffness_n_m=40.0", "40 N/m", "0 N/m"),
    ("navboard.gps.fitted=true", "yes", "no"),
    ("tank.size_m[1]=5.0", "5 m", "4 m"),
)


def test_every_key_that_was_set_is_told_with_its_unit_and_no_other() -> None:
    config = scenario.load("wang2014", [setting for setting, _, _ in SETS])
    found = changes(config)
    assert found.model == "wang2014"
    said = {row.key: (row.value, row.usual) for row in found.rows}
    for setting, value, usual in SETS:
        key = setting.partition("=")[0]
        key = "plant.tail.depth_profile[1]" if "profile" in key else key
        assert said.pop(key) == (value, usual)
    assert set(said) == {"plant.tail.depth_profile[0]"}  # the profile's other element
    assert found.rows[0].key.startswith("effects.")


def test_every_bundled_scenario_changes_nothing_and_seeds_are_no_change() -> None:
    for name in scenario.bundled():
        config = scenario.load(name, ["records.truth_period_s=0.01"], duration_s=3.0, seed=9)
        assert changes(config).rows == ()


def test_a_scenario_of_another_name_is_held_against_the_nearest_model(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(
        'base = "reach-target"\n[scenario]\nname = "mine"\n[effects.payload]\ndm_kg = 0.05\n'
    )
    found = changes(scenario.load(str(file)))
    assert found.model == "reach-target"
    assert [(row.key, row.value) for row in found.rows] == [
        ("effects.payload.dm_kg", "dm = 0.05 kg")
    ]
    assert found.rows[0].what == "payload: body mass + dm, inertia in proportion"


def test_the_report_has_the_list_where_there_is_one(make_run: MakeRun) -> None:
    data = make_run(5.0)
    plain = replace(data, changes=changes(scenario.load("circle")))
    changed = replace(data, changes=changes(scenario.load("circle", [SETS[0][0]])))
    assert "Changed in" not in render(data) + render(plain)
    page = render(changed)
    assert "Changed in the bundled model circle" in page
    assert "effects.fin_damage.k" in page
