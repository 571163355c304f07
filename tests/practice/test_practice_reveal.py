"""The score of a diagnosis: every kind of answer against every kind of verdict."""

import json
import math
from pathlib import Path
from typing import Any

import pytest

from tools.cli import main
from tools.practice.folder import SEALED, seal, unseal
from tools.practice.reveal import Estimate, score

ANSWERS = {
    "none": [],
    "one": [{"name": "water_current", "size": 1.0, "parameters": {"cx_m_s": 0.01}}],
    "two": [
        {"name": "water_current", "size": 1.0, "parameters": {}},
        {"name": "gyro_bias", "size": 1.0, "parameters": {}},
    ],
    "unlisted": [{"name": "tether", "size": 1.0, "parameters": {}}],
}


def diagnosis(verdict: str, *names: str, confusable: tuple[tuple[str, ...], ...] = ()) -> Any:
    told = {"cx_m_s": {"estimate": 0.012, "standard_error": 0.001, "unit": "m/s"}}
    return {
        "verdict": verdict,
        "causes": [{"name": name, "parameters": told} for name in names],
        "confusable": [list(group) for group in confusable],
    }


@pytest.mark.parametrize(
    ("kind", "told", "expected"),
    [
        ("none", diagnosis("nothing_wrong"), "exact"),
        ("none", diagnosis("named", "payload"), "false_alarm"),
        ("none", diagnosis("unexplained"), "false_alarm"),
        ("one", diagnosis("named", "water_current"), "exact"),
        ("one", diagnosis("named", "water_current", "payload"), "in_set"),
        ("one", diagnosis("ambiguous", "payload", "water_current"), "in_set"),
        (
            "one",
            diagnosis("ambiguous", "payload", confusable=(("payload", "water_current"),)),
            "in_set",
        ),
        ("one", diagnosis("named", "payload"), "wrong"),
        ("one", diagnosis("unexplained"), "unexplained"),
        ("one", diagnosis("nothing_wrong"), "missed"),
        ("two", diagnosis("named", "gyro_bias", "water_current"), "exact"),
        ("two", diagnosis("named", "gyro_bias"), "wrong"),
        ("unlisted", diagnosis("unexplained"), "exact"),
        ("unlisted", diagnosis("named", "unknown_force"), "exact"),
        ("unlisted", diagnosis("named", "payload"), "wrong"),
    ],
)
def test_scores(kind: str, told: Any, expected: str) -> None:
    assert score({"kind": kind, "effects": ANSWERS[kind]}, told).score == expected


def test_an_estimate_stands_beside_the_truth() -> None:
    told = score({"kind": "one", "effects": ANSWERS["one"]}, diagnosis("named", "water_current"))
    (item,) = told.estimates
    assert item.errors == pytest.approx(2.0)


def test_the_command_reveals(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    answer = {"seed": 1, "kind": "one", "strength": 100.0, "effects": ANSWERS["one"]}
    (tmp_path / SEALED).write_bytes(seal(answer))
    assert unseal(tmp_path) == answer
    assert main(["practice", "--reveal", str(tmp_path)]) == 2
    assert "was not diagnosed yet" in capsys.readouterr().err
    (tmp_path / "diagnosis.json").write_text(json.dumps(diagnosis("named", "water_current")))
    assert main(["practice", "--reveal", str(tmp_path)]) == 0
    assert "true 0.01 m/s, estimated 0.012 ± 0.001" in capsys.readouterr().out
    (tmp_path / SEALED).write_bytes(b"nonsense")
    assert main(["practice", "--reveal", str(tmp_path)]) == 2


def test_a_phase_is_compared_modulo_a_turn() -> None:
    near = Estimate("compass_hard_iron", "phi_rad", 3.1, -3.1, 0.1, "rad")
    assert near.errors == pytest.approx((2.0 * math.pi - 6.2) / 0.1)
