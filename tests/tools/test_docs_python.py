"""The Python in README and docs runs as it stands; a block that begins with imports is complete."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
BLOCK = re.compile(r"^```python\n((?:from|import) .*?)^```$", re.MULTILINE | re.DOTALL)
NEEDS_HARDWARE = {"docs/transports.md": "a serial port"}
"""Of these the imports alone run."""
NEEDS_OTHERS = {"docs/camera.md": "OpenCV, a detector of marks, and a camera"}
"""Of these not even the imports: they are Python, and no more is seen."""


def blocks() -> list[tuple[str, str]]:
    files = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
    return [
        (path.relative_to(ROOT).as_posix(), code)
        for path in files
        for code in BLOCK.findall(path.read_text(encoding="utf-8"))
    ]


def test_there_are_complete_examples() -> None:
    assert {name for name, _ in blocks()} >= {"README.md", "docs/averaging.md", "docs/plant.md"}


@pytest.mark.parametrize(
    ("name", "code"), [pytest.param(name, code, id=name) for name, code in blocks()]
)
def test_an_example_runs_as_it_stands(
    name: str, code: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    whole = compile(code, name, "exec")
    if name in NEEDS_HARDWARE:
        whole = compile(code.partition("\n\n")[0], name, "exec")
    if name in NEEDS_OTHERS:
        return
    # not "__main__": what only a script does (a sweep's processes) stays undone
    exec(whole, {"__name__": "example"})
