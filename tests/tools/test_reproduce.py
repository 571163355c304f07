"""`fishbed reproduce`: exit codes, lines, the document, the page, the folder, and interruption.

The studies are made up, each for one case; what the real ones compute is tested beside each other.
"""

from __future__ import annotations

import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from tools.cli import main
from tools.studies import table
from tools.studies.account import Account, cells, document, error_text, pair, state, tolerance_text
from tools.studies.drawing import draw
from tools.studies.page import render
from tools.studies.study import Band, Check, Curve, Figure, Mark, Panel, Result, Surface
from tools.studies.table import Row
from tools.studies.workers import Outcome, run_studies

ROOT = Path(__file__).resolve().parents[2]

MADE_UP = """
import os, signal, time
import numpy as np
from tools.studies.study import *

X = np.linspace(0.0, 1.0, 5)
PANEL = Panel("(a)", "x (m)", "y (m)", (Curve("ours", X, X), Curve("other", X, -X, "dashed"),
    Curve("dots", X, X * X, "marks")), (Mark(0.5, 0.5, "half <of> it"),), (Band(0.1, 0.2, "seen"),))

def good(progress):
    progress(0.5)
    return Result((Check("length", 2.0, 2.01, "m", 0.01),),
                  (Figure("Fig. 1.1", "A line & more", (PANEL, PANEL)),), ("a note <here>",))

def off(progress):
    return Result((Check("length", 2.0, 2.5, "m", 0.01), Check("width", 1.0, 1.0, "m", 0.01)))

def nothing(progress):
    return Result((Check("no number", 2.0, float("nan"), "m", 0.01),))

def known(progress):
    return Result((Check("mass", 0.0, 3.0, "kg", 0.1, absolute=True, known_difference="misprint"),),
                  (Figure("Fig. 1.3", "", (Surface("s", "x", "y", "z", X, X, np.outer(X, X)),)),))

def raises(progress):
    raise ZeroDivisionError("by design")

def dies(progress):
    os._exit(7)

def where(progress):
    deaf = signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    return Result(notes=(str(os.getpid()), f"deaf: {deaf}"))

def endless(progress):
    progress(0.5)
    while True:
        time.sleep(0.05)
"""


@pytest.fixture
def studies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A table of made-up studies, whose module worker processes find, too."""
    (tmp_path / "made_up_studies.py").write_text(MADE_UP)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.chdir(tmp_path)
    names = ("good", "off", "nothing", "known", "raises", "dies", "where", "endless")
    rows = tuple(Row(f"fig-1.{n}", name, f"made_up_studies:{name}") for n, name in enumerate(names))
    monkeypatch.setattr(table, "STUDIES", rows)
    return tmp_path


def row(name: str) -> Row:
    return next(row for row in table.STUDIES if row.description == name)


def test_what_agrees_ends_with_0_and_leaves_lines_and_a_folder(
    studies: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["reproduce", "fig-1.0", "fig-1.3"]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    head, line, *rest = said.out.split("\n")
    assert head.split() == ["study", "published", "computed", "error", "tolerance", "what"]
    assert " ".join(line.split()) == "fig-1.0 2 m 2.01 m +0.5 % ±1 % ok length"
    known = rest[rest.index("known differences") + 1 :]
    assert " ".join(known[0].split()) == "fig-1.3 0 kg 3 kg +3 ±0.1 differs mass"
    assert known[1].strip() == "misprint"
    assert rest[-2] == "report: reproduction/report.html"
    made = studies / "reproduction"
    assert sorted(entry.name for entry in made.iterdir()) == ["report.html", "results.json"]
    assert json.loads((made / "results.json").read_text())["ok"] is True


@pytest.mark.parametrize("name", ["fig-1.1", "fig-1.2", "fig-1.4"])
def test_a_number_off_or_missing_or_a_failed_study_ends_with_1(
    name: str, studies: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["reproduce", name, "--json"]) == 1
    said = capsys.readouterr()
    found = json.loads(said.out)
    assert found["ok"] is False
    failed = name == "fig-1.4"
    assert [study["state"] for study in found["studies"]] == ["failed" if failed else "off"]
    assert ("ZeroDivisionError: by design" in said.err) is failed


def test_the_document_has_its_keys_and_json_leaves_no_folder(
    studies: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["reproduce", "fig-1.3", "fig-1.1", "--json"]) == 1
    said = capsys.readouterr()
    assert said.err == ""
    found = json.loads(said.out)
    assert list(found) == ["version", "ok", "summary", "checks", "known_differences", "studies"]
    assert found["checks"][0] == {
        "study": "fig-1.1",
        "what": "length",
        "published": 2.0,
        "computed": 2.5,
        "unit": "m",
        "error": 0.25,
        "tolerance": 0.01,
        "absolute": False,
        "ok": False,
    }
    assert found["known_differences"][0]["reason"] == "misprint"
    assert found["known_differences"][0]["ok"] is False
    assert [(s["name"], s["state"]) for s in found["studies"]] == [
        ("fig-1.1", "off"),
        ("fig-1.3", "differs"),
    ]
    assert not (studies / "reproduction").exists()
    assert main(["reproduce", "fig-1.3", "--json", "--out", "there"]) == 0
    written = (studies / "there" / "results.json").read_text()
    assert written == capsys.readouterr().out


def test_an_unknown_study_is_one_line_with_the_nearest(
    studies: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["reproduce", "fig-1.1", "fg-1.3"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "no study 'fg-1.3' (nearest: fig-1.3" in said
    assert main(["reproduce", "zzz"]) == 2
    assert "see: fishbed list studies" in capsys.readouterr().err
    assert main(["reproduce", "--out", " "]) == 2


def test_a_folder_with_other_files_is_refused_before_anything_is_computed(
    studies: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = studies / "mine"
    mine.mkdir()
    (mine / "letter.txt").write_text("dear")
    assert main(["reproduce", "fig-1.7", "--out", str(mine)]) == 2  # fig-1.7 would never end
    assert "holds other files and no reproduction" in capsys.readouterr().err
    assert [entry.name for entry in mine.iterdir()] == ["letter.txt"]
    for _ in range(2):  # an earlier reproduction is replaced
        assert main(["reproduce", "fig-1.0", "--out", str(studies / "again")]) == 0


def test_processes_keep_the_order_and_share_the_work(studies: Path) -> None:
    rows = [row("where"), row("dies"), row("where"), row("raises"), row("good"), row("where")]
    told: list[tuple[int, float]] = []
    outcomes = run_studies(rows, lambda *said: told.append(said), pictures=True, workers=2)
    assert [outcome.row for outcome in outcomes] == rows
    assert [outcome.result is None for outcome in outcomes] == [
        False,
        True,
        False,
        True,
        *[False] * 2,
    ]
    assert "its process ended with 7" in outcomes[1].failure
    assert outcomes[3].failure.rstrip().endswith("ZeroDivisionError: by design")
    said = [o.result.notes for o in outcomes if o.result and o.row.description == "where"]
    assert [deaf for _, deaf in said] == ["deaf: True"] * 3  # Ctrl-C is the parent's affair
    pids = {pid for pid, _ in said}
    assert str(os.getpid()) not in pids
    assert {index for index, share in told if share == 1.0} == set(range(6))
    assert (4, 0.45) in told  # half of the computation; then come the pictures
    assert outcomes[4].pictures == run_studies([row("good")], pictures=True)[0].pictures
    assert len(outcomes[4].pictures) == 2


@pytest.mark.skipif(not hasattr(os, "killpg"), reason="needs process groups")
def test_ctrl_c_ends_with_130_in_one_line_and_leaves_nothing(studies: Path) -> None:
    code = (
        "import sys\nfrom tools.studies import table\nfrom tools.studies.table import Row\n"
        "table.STUDIES = (Row('a', '', 'made_up_studies:endless'),"
        " Row('b', '', 'made_up_studies:endless'))\n"
        "from tools.studies import workers\n"
        "workers.cores = lambda: 2\n"
        "from tools.commands import reproduce\n"
        "import contextlib\n"
        "def tell(rows):\n"
        "    @contextlib.contextmanager\n"
        "    def made():\n"
        "        yield lambda index, share: share and print('under way', flush=True)\n"
        "    return made()\n"
        "reproduce._progress = tell\n"
        "from tools.cli import main\nsys.exit(main(['reproduce', '--out', 'halted']))\n"
    )
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{studies}"}
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=studies,
        env=environment,
        start_new_session=True,
    )
    assert process.stdout is not None
    try:
        assert process.stdout.readline() == "under way\n"
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does: the whole group gets it
        _, error = process.communicate(timeout=30)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    assert (process.returncode, error) == (130, "fishbed: interrupted\n")
    assert sorted(entry.name for entry in studies.iterdir() if "halted" in entry.name) == []
    for _ in range(100):  # the group is empty as soon as the workers are gone
        try:
            os.killpg(process.pid, 0)
        except ProcessLookupError:
            break
        time.sleep(0.05)
    else:
        pytest.fail("a worker outlived the command")


def test_progress_is_shown_where_somebody_looks(
    studies: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    assert main(["reproduce", "fig-1.0"]) == 0
    assert "1 of 1" in capsys.readouterr().err


class Page(HTMLParser):
    """Whether every element is closed, what is linked and what is there, and the words."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.links: list[str] = []
        self.names: list[str] = []
        self.words = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag != "meta":
            self.open.append(tag)
        for key, value in attrs:
            if key in ("href", "src") and tag != "use":
                self.links.append(value or "")
            if key == "id" and "svg" not in self.open:
                self.names.append(value or "")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words += data


def test_the_page_has_all_pictures_numbers_and_differences(studies: Path) -> None:
    account = Account(run_studies([row(n) for n in ("good", "off", "known", "raises")], workers=1))
    text = render(account, "1.2.3")
    assert text == render(account, "1.2.3")
    page = Page(text)
    assert page.open == []
    assert page.names == ["fig-1.0", "fig-1.1", "fig-1.3", "fig-1.4"]
    assert {link[1:] for link in page.links} == set(page.names)
    pictures = re.findall(r"<svg.*?</svg>", text, re.DOTALL)
    assert len(pictures) == 3
    identifiers: list[str] = []
    for picture in pictures:
        root = ElementTree.fromstring(picture)
        identifiers += [e.get("id", "") for e in root.iter() if e.get("id")]
    assert len(identifiers) == len(set(identifiers))
    assert "half &lt;of&gt; it" in pictures[0]
    assert "seen" in pictures[0]
    for said in ("A line & more", "a note <here>", "misprint", "ZeroDivisionError: by design"):
        assert said in page.words
    assert account.sentence() in page.words
    assert account.sentence() == (
        "1 of 2 published figures and tables with printed numbers agree; 1 number differs for a "
        "known reason; 1 study failed."
    )


def test_the_verdict_reads_well_for_few_studies(studies: Path) -> None:
    said = {
        name: Account(run_studies([row(part) for part in name.split()], workers=1)).sentence()
        for name in ("good", "off", "where", "known", "good good", "good where where")
    }
    assert said == {
        "good": "The printed numbers of fig-1.0 agree.",
        "off": "The printed numbers of fig-1.1 do not agree.",
        "where": "No printed numbers to compare here; 1 is drawn without any.",
        "known": "No printed numbers to compare here; 1 number differs for a known reason.",
        "good good": "All 2 published figures and tables with printed numbers agree.",
        "good where where": "The printed numbers of fig-1.0 agree; 2 more are drawn without any.",
    }


def test_pictures_take_the_colours_of_the_page_and_are_the_same_every_time() -> None:
    x = np.linspace(0.0, 1.0, 50)
    panel = Panel("", "x", "y", (Curve("a", x, np.sin(x)),), (Mark(0.5, 0.4, "m"),))
    picture = draw(panel, "salt")
    assert picture == draw(panel, "salt")
    assert set(re.findall(r"stroke: ([^;\"]+)", picture)) == {
        f"var(--{name})" for name in ("c1", "grid", "truth", "ink")
    }
    assert "<style" not in picture  # a style sheet in a picture would rule the whole page
    assert "DejaVu" not in picture
    assert not re.search(r"#[0-9a-f]{6}", picture)


@pytest.mark.parametrize(
    ("check", "published", "computed", "error", "tolerance", "verdict"),
    [
        (Check("", 27.5, 27.4476, "cm", 0.01), "27.5", "27.45", "−0.19 %", "±1 %", "ok"),
        (Check("", 1.0413e-4, 1.04131e-4, "", 5e-9, True), "1.0413e-4", "1.04131e-4", "+1e-9",
         "±5e-9", "ok"),
        (Check("", 0.026776, 0.026776, "m", 1e-6, True), "0.026776", "0.026776", "0", "±1e-6",
         "ok"),
        (Check("", -1.0, 3.0, "", 0.1), "−1", "3", "+400 %", "±10 %", "OFF"),
        (Check("", 1.0, math.nan, "", 0.1), "1", "nan", "nan", "±10 %", "OFF"),
        (Check("", 1.0, 2.0, "", 0.1, known_difference="so"), "1", "2", "+100 %", "±10 %",
         "differs"),
    ],
)  # fmt: skip
def test_numbers_are_written_as_people_do(
    check: Check, published: str, computed: str, error: str, tolerance: str, verdict: str
) -> None:
    assert pair(check) == (published, computed)
    assert error_text(check) == error
    assert tolerance_text(check) == tolerance
    assert cells("", check)[-2] == verdict


def test_a_check_that_cannot_fail_is_refused() -> None:
    for bad in (0.0, -1.0, math.inf, math.nan):
        with pytest.raises(ValueError, match="tolerance"):
            Check("a", 1.0, 1.0, "", bad)
    with pytest.raises(ValueError, match="relative to zero"):
        Check("a", 0.0, 1.0, "", 0.1)
    with pytest.raises(ValueError, match="no published number"):
        Check("a", math.nan, 1.0, "", 0.1)
    at_the_edge = Check("a", 1.0, 1.25, "", 0.25)
    assert at_the_edge.ok
    assert Check("a", 1.0, 1.2500001, "", 0.25).failed
    with pytest.raises(ValueError, match="curve"):
        Curve("a", np.zeros(3), np.zeros(4))
    with pytest.raises(ValueError, match="surface"):
        Surface("a", "", "", "", np.zeros(3), np.zeros(4), np.zeros((3, 4)))


def test_states_and_the_document_of_an_empty_account() -> None:
    figure = Figure("Fig. 9", "", ())
    made = Row("fig-9", "", "none:none")
    assert state(Outcome(made, Result(figures=(figure,)))) == "drawn"
    assert state(Outcome(made, None, "x")) == "failed"
    found = document(Account(()), "1")
    assert found["ok"] is True
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert Band(0.0, 1.0, "").label == ""


def test_every_row_of_the_real_table_has_its_own_name_and_its_function() -> None:
    names = [row.name for row in table.STUDIES]
    assert len(names) == len(set(names))
    for item in table.STUDIES:
        assert re.fullmatch(r"(fig|table)-\d\.\d+", item.name)
        assert callable(item.load().compute)
