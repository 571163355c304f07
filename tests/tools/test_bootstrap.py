"""Set-up: the environment is used again exactly as long as what it was made from is the same."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tools import bootstrap

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def steps(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[list[str]]:
    """A project of two files, and a pip that notes what it is told."""
    for name in ("pyproject.toml", "constraints.txt"):
        (tmp_path / name).write_text(name)
    noted: list[list[str]] = []
    monkeypatch.setattr(bootstrap, "ROOT", str(tmp_path))
    monkeypatch.setenv("FISHBED_VENV", str(tmp_path / "env"))
    monkeypatch.setattr(bootstrap, "step", lambda what, command: noted.append(command))

    def create(folder: str, with_pip: bool) -> None:
        assert with_pip
        python = Path(bootstrap.program(folder, "python"))
        python.parent.mkdir(parents=True)
        python.touch()
        (Path(folder) / "pyvenv.cfg").touch()

    monkeypatch.setattr("venv.create", create)
    return noted


def test_an_environment_is_made_once_and_again_when_its_sources_change(
    steps: list[list[str]], tmp_path: Path
) -> None:
    bootstrap.make_environment("test")
    assert [command[-1] for command in steps] == ["setuptools", ".[test]"]
    assert all("constraints.txt" in command for command in steps)
    assert "--no-build-isolation" in steps[-1]
    bootstrap.make_environment("test")
    bootstrap.make_environment("")  # the one for tests serves a run as well
    assert len(steps) == 2
    (tmp_path / "constraints.txt").write_text("numpy==1")
    bootstrap.make_environment("test")
    assert len(steps) == 4


def test_test_packages_go_on_top_of_an_environment_for_runs(steps: list[list[str]]) -> None:
    kept = Path(bootstrap.make_environment("")) / "pyvenv.cfg"
    kept.write_text("kept")
    bootstrap.make_environment("test")
    assert [command[-1] for command in steps] == ["setuptools", ".", ".[test]"]
    assert kept.read_text() == "kept"
    bootstrap.make_environment("test")
    bootstrap.make_environment("")
    assert len(steps) == 3


def test_an_addition_that_fails_leaves_the_environment_for_runs(
    steps: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    venv = bootstrap.make_environment("")

    def fail(what: str, command: list[str]) -> None:
        raise bootstrap.SetUpError("no network")

    monkeypatch.setattr(bootstrap, "step", fail)
    assert bootstrap.main(["env"]) == 2
    assert not bootstrap.up_to_date(venv, ["test"])
    assert bootstrap.up_to_date(venv, [""])


def test_a_failed_step_leaves_no_stamp(
    steps: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(what: str, command: list[str]) -> None:
        raise bootstrap.SetUpError("no network")

    monkeypatch.setattr(bootstrap, "step", fail)
    assert bootstrap.main(["env"]) == 2
    assert not bootstrap.up_to_date(bootstrap.environment_dir(), ["", "test"])


def test_a_folder_that_is_no_environment_is_left_alone(
    steps: list[list[str]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "env").mkdir()
    (tmp_path / "env" / "thesis.tex").touch()
    assert bootstrap.main(["env"]) == 2
    assert (tmp_path / "env" / "thesis.tex").exists()
    assert "is no environment" in capsys.readouterr().err


def test_old_pythons_and_wrong_words_are_told_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert bootstrap.main(["swim"]) == 2
    assert bootstrap.main([]) == 2
    capsys.readouterr()
    monkeypatch.setattr(sys, "version_info", (3, 9, 2))
    assert bootstrap.main(["run"]) == 2
    assert "Python 3.11 or newer is needed" in capsys.readouterr().err


def test_a_failing_command_is_one_line_with_the_remedy() -> None:
    with pytest.raises(bootstrap.SetUpError, match=r"'trying' failed \(exit 3\).*index"):
        bootstrap.step("trying", [sys.executable, "-c", "raise SystemExit(3)"])


def test_checks_run_all_and_the_first_failure_is_the_exit_code(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    codes = {"ruff": 0, "mypy": 5, "lint-imports": 0, "python": 1}
    ran: list[str] = []

    def fake(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        ran.append(Path(command[0]).name)
        return subprocess.CompletedProcess(command, codes[ran[-1]])

    monkeypatch.setattr(subprocess, "run", fake)
    assert bootstrap.test("env", []) == 5
    assert ran == ["ruff", "mypy", "lint-imports", "python"]


def test_old_pythons_can_read_the_script_and_need_nothing_for_it() -> None:
    tree = ast.parse((ROOT / "tools" / "bootstrap.py").read_text(), feature_version=(3, 6))
    imported = {
        alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.Import)
        for alias in node.names
    }
    assert imported <= set(sys.stdlib_module_names)
    # Values only; formatted strings with "=" or walrus would not parse above.
    assert not [node for node in ast.walk(tree) if isinstance(node, ast.JoinedStr)]


def normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def test_every_requirement_is_pinned_and_no_pin_has_an_address() -> None:
    lines = [
        line
        for line in (ROOT / "constraints.txt").read_text().splitlines()
        if line and not line.startswith("#")
    ]
    pins = {}
    for line in lines:
        name, version = line.split("==")
        assert re.fullmatch(r"[0-9][0-9A-Za-z.]*", version)
        pins[normal(name)] = version
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    wanted = [
        *project["project"]["dependencies"],
        *project["project"]["optional-dependencies"]["test"],
        *project["build-system"]["requires"],
    ]
    for requirement in wanted:
        match = re.match(r"([A-Za-z0-9_.-]+)>=([0-9.]+)(; .+)?$", requirement)
        assert match, requirement
        pin = pins[normal(match[1])]
        assert [int(p) for p in re.findall(r"\d+", pin)][:2] >= [
            int(p) for p in re.findall(r"\d+", match[2])
        ][:2]


def test_the_environment_can_be_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("FISHBED_VENV", raising=False)
    assert bootstrap.environment_dir() == str(ROOT / ".venv")
