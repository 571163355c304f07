"""The page of scenario keys says what the types say."""

from __future__ import annotations

from tools import scenario
from tools.reference import MARK, PAGE, reference


def test_the_page_is_up_to_date() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert text.partition(MARK)[2].strip() == reference().strip(), "run: python -m tools.reference"


def test_the_page_has_every_key_of_a_full_scenario() -> None:
    text = reference()
    for key in scenario.keys(scenario.load("rough-link")):
        section, _, name = key.rpartition(".")
        name = name.partition("[")[0]
        head = f"### `{section.partition('[')[0]}`"
        assert head in text
        assert f"| `{name}` |" in text.partition(head)[2].partition("### ")[0]
