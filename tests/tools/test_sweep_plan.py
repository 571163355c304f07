"""Which points a sweep has: what is typed, what the scenario's schema makes of it, what is refused.

Expected points are written out by hand; a sample is judged by what makes it a Latin hypercube.
"""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import pytest

from tools.cli import main
from tools.errors import ScenarioError
from tools.sweep.plan import Plan, make_plan
from tools.sweep.vary import Listed, parse_vary

BIAS = "procboard.tail_beat.bias_rad"
AMPLITUDE = "procboard.tail_beat.amplitude_rad"
MASS = "plant.body.mass_kg"


def points(plan: Plan) -> list[tuple[Any, ...]]:
    return [(*plan.values(point), plan.seed(point)) for point in range(len(plan))]


LISTS: dict[str, list[Any]] = {
    f"{BIAS}=0.1,0.2": [0.1, 0.2],
    f"{BIAS}=0": [0.0],
    f"{BIAS} = -1e-1 , +0.2": [-0.1, 0.2],
    f"{BIAS}=0.1:0.5:5": [0.1, 0.2, 0.3, 0.4, 0.5],  # exactly: 0.1 + 2 * 0.1 is 0.30000000000000004
    f"{BIAS}=0.2:-0.2:3": [0.2, 0.0, -0.2],
    "camera.frames_per_s=10:30:3": [10, 20, 30],
    "camera.fitted=true,false": [True, False],
    "procboard.application=open-loop,telemetry": ["open-loop", "telemetry"],
    'scenario.description="a, b","c"': ["a, b", "c"],
    "tank.size_m=[3,3],[4,5]": [[3.0, 3.0], [4.0, 5.0]],
    "tank.size_m[1]=3,4": [3.0, 4.0],
    "faults.supply_cuts=[],[{at_s=1,duration_s=2}]": [
        [],
        [{"at_s": 1.0, "duration_s": 2.0, "robots": ()}],
    ],
}


@pytest.mark.parametrize("text", LISTS)
def test_values_have_the_type_of_their_key(text: str) -> None:
    plan = make_plan("circle", [text])
    found = [plan.values(point)[0] for point in range(len(plan))]
    assert found == LISTS[text]
    assert [type(value) for value in found] == [type(value) for value in LISTS[text]]


def test_an_element_of_a_list_of_tables_can_be_varied() -> None:
    plan = make_plan("rough-link", ["base_station.tail_beats[0].bias_rad=0.1,0.2"])
    beats = [plan.config(point).base_station.tail_beats for point in (0, 1)]
    assert [beat[0].bias_rad for beat in beats] == [0.1, 0.2]


def test_several_keys_are_the_product_the_last_one_fastest() -> None:
    plan = make_plan("circle", [f"{BIAS}=0.1,0.2", f"{MASS}=0.3,0.4"], seed=7, duration_s=3)
    assert plan.keys == (BIAS, MASS)
    assert points(plan) == [(0.1, 0.3, 7), (0.1, 0.4, 7), (0.2, 0.3, 7), (0.2, 0.4, 7)]
    config = plan.config(2)
    assert (config.procboard.tail_beat.bias_rad, config.plant.body.mass_kg) == (0.2, 0.3)
    assert (config.scenario.seed, config.scenario.duration_s) == (7, 3.0)


def test_repeats_are_the_same_seeds_at_every_point() -> None:
    plan = make_plan("circle", [f"{BIAS}=0.1,0.2"], seed=5, repeat=2)
    assert points(plan) == [(0.1, 5), (0.1, 6), (0.2, 5), (0.2, 6)]
    assert plan.config(3).scenario.seed == 6
    alone = make_plan("circle", [], repeat=3)
    assert points(alone) == [(1,), (2,), (3,)]


def test_the_seed_can_be_varied_itself() -> None:
    plan = make_plan("circle", ["scenario.seed=3:9:3"])
    assert points(plan) == [(3, 3), (6, 6), (9, 9)]


def test_sets_hold_at_every_point() -> None:
    plan = make_plan("circle", [f"{BIAS}=0.1,0.2"], sets=[f"{MASS}=0.35"])
    assert {plan.config(point).plant.body.mass_kg for point in (0, 1)} == {0.35}


def test_a_sample_is_a_latin_hypercube_and_repeatable() -> None:
    count = 12
    varied = [
        f"{MASS}=0.2:0.5",
        "camera.frames_per_s=10:12",
        "procboard.application=open-loop,telemetry",
    ]
    plan = make_plan("circle", varied, sample=count)
    columns = list(zip(*(plan.values(point) for point in range(count)), strict=True))
    masses = sorted(columns[0])
    width = (0.5 - 0.2) / count
    for cell, mass in enumerate(masses):  # each of the n cells holds one value
        assert 0.2 + cell * width <= mass <= 0.2 + (cell + 1) * width
    assert masses != list(columns[0])
    assert sorted(columns[1]) == [10] * 4 + [11] * 4 + [12] * 4
    assert sorted(columns[2]) == ["open-loop"] * 6 + ["telemetry"] * 6
    assert points(make_plan("circle", varied, sample=count)) == points(plan)
    assert points(make_plan("circle", varied, sample=count, seed=2)) != points(plan)


def test_a_range_is_drawn_up_to_both_of_its_bounds() -> None:
    whole = parse_vary("camera.frames_per_s=10:12")
    assert [whole.drawn(part) for part in (0.0, 0.34, 0.999999)] == [10, 11, 12]
    real = parse_vary(f"{MASS}=0.1:0.3")
    assert real.drawn(0.0) == 0.1
    assert 0.29 < real.drawn(0.9999999999999999) <= 0.3
    listed = parse_vary(f"{MASS}=0.1,0.2")
    assert isinstance(listed, Listed)
    assert [listed.drawn(part) for part in (0.0, 0.499, 0.5, 0.9999999999999999)] == [
        0.1,
        0.1,
        0.2,
        0.2,
    ]


WRONG: dict[tuple[str, ...], tuple[str, ...]] = {
    (): ("nothing is varied", "--vary"),
    ("--vary", MASS): (MASS, "KEY=A,B"),
    ("--vary", f"{MASS}="): ("KEY=A,B",),
    ("--vary", f"{MASS}=0.3,,0.4"): ("a value is empty",),
    ("--vary", f"{MASS}=0.3,0.3"): ("0.3 is there twice",),
    ("--vary", f"{MASS}=0.3,-0.4"): (f"--vary: {MASS} = -0.4", "> 0.001"),
    ("--vary", f'{MASS}=0.3,"heavy"'): (f"{MASS} = 'heavy'", "must be a number"),
    ("--vary", "plant.body.mass_g=300:400:3"): ("plant.body.mass_g", "did you mean " + MASS),
    ("--vary", "plant.body={mass_kg=0.3}"): ("vary the keys in it",),
    ("--vary", "faults.supply_cuts[0].at_s=1,2"): ("there is no faults.supply_cuts[0]",),
    ("--vary", f"{MASS}=0.3:0.4"): (f"{MASS}=0.3:0.4:COUNT", "--sample"),
    ("--vary", f"{MASS}=0.3:0.4:1"): ("from 2 to",),
    ("--vary", f"{MASS}=0.3:0.4:2.5"): ("whole number from 2 to",),
    ("--vary", f"{MASS}=0.3:0.3:2"): ("are the same",),
    ("--vary", "camera.frames_per_s=10:15:3"): ("camera.frames_per_s", "whole number", "12.5"),
    ("--vary", "procboard.application=1:3:2"): ("procboard.application is no number",),
    ("--vary", f"{MASS}=0.3,0.4", "--set", f"{MASS}=0.3"): (MASS, "set by --set as well"),
    ("--vary", "tank.size_m=[3,3]", "--vary", "tank.size_m[0]=4"): ("by another --vary as well",),
    ("--vary", "scenario.seed=1,2", "--repeat", "2"): ("set by --repeat as well",),
    ("--vary", "scenario.seed=1,2", "--seed", "2"): ("set by --seed as well",),
    ("--vary", "scenario.duration_s=1,2", "--duration", "2"): ("set by --duration as well",),
    ("--vary", f"{BIAS}=0.1,0.8", "--vary", f"{AMPLITUDE}=0.1,0.4"): (
        f"{AMPLITUDE} = 0.4",
        "tail_limit_rad",
        f"where {BIAS}=0.8, {AMPLITUDE}=0.4",
    ),
    ("--vary", "plant.tail.segments=1,5"): (
        "plant.tail.modulus_pa: a flexible tail needs a stiffness",
        "where plant.tail.segments=5",
    ),
    ("--vary", "effects.payload.dm_kg=0.05,-1"): ("body.mass_kg", "where effects.payload.dm_kg=-1"),
    ("--vary", 'tank.temperature.file="","nope.csv"'): (
        "nope.csv: cannot be read",
        "where tank.temperature.file=nope.csv",
    ),
    ("--vary", 'tank.pollutant.file="","mine.csv"'): ("tank.pollutant.file: mine.csv: ",),
    ("--vary", f"{MASS}=0.3,0.4", "--set", "hil.nav='pty:'"): ("hil: a sweep takes no", "[hil]"),
    ("--vary", 'hil.proc="","pty:"'): ("hil: a sweep takes no", "fishbed hil"),
    ("--vary", f"{MASS}=0.3:0.4", "--sample", "100001"): ("at most 100000",),
    ("--vary", f"{MASS}=0.4:0.3", "--sample", "3"): ("first bound must be below",),
    ("--vary", "camera.frames_per_s=1.5:3", "--sample", "3"): ("must be whole numbers",),
    ("--vary", f"{MASS}=0.3:0.4:400", "--vary", f"{BIAS}=0:0.1:400"): ("400 × 400 = 160000",),
    ("--vary", f"{MASS}=0.3:0.4:400", "--repeat", "400"): ("160000 points",),
    ("--repeat", "2", "--seed", str(2**53)): ("--repeat 2", "seed"),
    ("--repeat", "0"): ("--repeat", "above 0"),
    ("--sample", "3", "--repeat", "2"): ("--sample 3: of what?",),
    ("--vary", f"{MASS}=0.3", "--jobs", "2", "--scheduler", "x:1"): ("--jobs and --scheduler",),
    ("--vary", f"{MASS}=0.3", "--out", "table.xlsx"): ("table.xlsx", ".csv or .json"),
    ("--vary", f"{MASS}=0.3", "--out", "."): ("is a folder",),
    ("--vary", f"{MASS}=0.3", "--out", "mine.csv"): ("mine.csv", "something else"),
    ("--vary", f"{MASS}=0.3", "--out", "mine.csv/t.csv"): ("cannot be written",),
    ("--vary", f"{MASS}=0.3", "--scheduler", "nonsense"): ("no address such as tcp://",),
}


@pytest.mark.parametrize("arguments", WRONG, ids=" ".join)
def test_what_cannot_be_is_one_line_before_anything_runs(
    arguments: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.csv").write_text("my,own\n")
    assert main(["sweep", "circle", *arguments]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert len(said.err.splitlines()) == 1, said.err
    for part in WRONG[arguments]:
        assert part in said.err
    assert [entry.name for entry in tmp_path.iterdir()] == ["mine.csv"]
    assert (tmp_path / "mine.csv").read_text() == "my,own\n"


def test_the_digest_knows_everything_that_decides_the_table() -> None:
    base: dict[str, Any] = {"source": "circle", "varied": [f"{BIAS}=0.1,0.2"]}
    others: list[dict[str, Any]] = [
        {"source": "swim-forward"},
        {"varied": [f"{BIAS}=0.1,0.3"]},
        {"varied": [f"{AMPLITUDE}=0.1,0.2"]},
        {"seed": 2},
        {"repeat": 2},
        {"duration_s": 3.0},
        {"sets": [f"{MASS}=0.3"]},
    ]
    digests = [make_plan(**{**base, **other}).digest() for other in [{}, *others]]
    for one, two in itertools.combinations(digests, 2):
        assert one != two
    assert make_plan(**base).digest() == digests[0]


def test_ranges_are_for_samples_only() -> None:
    with pytest.raises(ScenarioError, match="--sample"):
        make_plan("circle", [f"{BIAS}=0.1:0.2"])
