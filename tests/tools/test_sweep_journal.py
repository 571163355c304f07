"""The journal and the table: what a power cut leaves, whose journal it is, what a table says."""

from __future__ import annotations

import csv
import io
import json
import sys
from pathlib import Path
from typing import Any

import pytest

from tools.records.data import METRICS
from tools.sweep.journal import Journal, JournalError
from tools.sweep.plan import make_plan
from tools.sweep.table import Table, make_table, to_csv, to_json, write_table

HEADER = {
    "scenario": "circle",
    "points": 9,
    "version": "1",
    "definition": "that sweep",
    "code": "that code",
}
RECORDS: list[dict[str, Any]] = [
    {"trace_sha256": "ab", "metrics": {"speed_m_s": 0.1 + 0.2, "turn_radius_m": None}},
    {"error": "circle: the motion diverged"},
    {"trace_sha256": "cd", "metrics": {"speed_m_s": 1e-9, "arrival_s": 4.5}},
]


def write(path: Path, *points: int) -> bytes:
    with Journal(path, HEADER) as journal:
        for point in points:
            journal.add(point, RECORDS[point % 3])
    return path.read_bytes()


def read(path: Path, **changed: str) -> dict[int, dict[str, Any]]:
    with Journal(path, {**HEADER, **changed}) as journal:
        return journal.records


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    path = tmp_path / "new" / "t.csv.partial"
    write(path, 2, 0)
    write(path, 1)
    assert read(path) == {0: RECORDS[0], 1: RECORDS[1], 2: RECORDS[2]}


def test_a_journal_cut_anywhere_goes_on_with_what_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "t.csv.partial"
    whole = write(path, 0, 1, 2)
    lines = whole.splitlines(keepends=True)
    ends = [sum(map(len, lines[: n + 1])) for n in range(len(lines))]
    for cut in range(len(whole) + 1):
        path.write_bytes(whole[:cut])
        kept = max(sum(cut >= end for end in ends) - 1, 0)
        assert read(path) == dict(enumerate(RECORDS[:kept])), cut
        for point in range(kept, 3):
            write(path, point)
        assert path.read_bytes() == whole, cut


def test_zeros_that_a_power_cut_leaves_are_no_results(tmp_path: Path) -> None:
    path = tmp_path / "t.csv.partial"
    whole = write(path, 0, 1)
    path.write_bytes(whole + bytes(300))
    assert set(read(path)) == {0, 1}
    assert path.read_bytes() == whole
    path.write_bytes(whole + bytes(30) + b"\n" + whole.splitlines(keepends=True)[-1])
    assert set(read(path)) == {0, 1}


def test_a_point_that_was_given_up_is_tried_again(tmp_path: Path) -> None:
    path = tmp_path / "t.csv.partial"
    with Journal(path, HEADER) as journal:
        journal.add(0, {"error": "given up: its process died 3 times", "given_up": True})
        journal.add(1, RECORDS[1])
    assert set(read(path)) == {1}


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"definition": "another"}, r"another sweep is unfinished there \(9 points of circle\)"),
        ({"code": "another"}, r"begun with other sources of fishbed \(1\)"),
    ],
)
def test_the_journal_of_another_sweep_is_left_alone(
    changed: dict[str, str], says: str, tmp_path: Path
) -> None:
    path = tmp_path / "t.csv.partial"
    whole = write(path, 0)
    with pytest.raises(JournalError, match=says + r".*--restart"):
        read(path, **changed)
    assert path.read_bytes() == whole
    with Journal(path, {**HEADER, **changed}, restart=True) as journal:
        assert journal.records == {}


@pytest.mark.parametrize("restart", [False, True])
@pytest.mark.parametrize("content", [b"my,own\n1,2\n", b"{}", b'{"a": 1}\n', b"{\n"])
def test_somebodys_file_is_no_journal(content: bytes, restart: bool, tmp_path: Path) -> None:
    path = tmp_path / "t.csv.partial"
    path.write_bytes(content)
    with pytest.raises(JournalError, match="is no journal"):
        Journal(path, HEADER, restart=restart)
    assert path.read_bytes() == content


@pytest.mark.skipif(sys.platform == "win32", reason="no lock there")
def test_two_sweeps_do_not_write_one_journal(tmp_path: Path) -> None:
    path = tmp_path / "t.csv.partial"
    with (
        Journal(path, HEADER),
        pytest.raises(JournalError, match="another sweep is writing"),
    ):
        Journal(path, HEADER)


def table() -> Table:
    plan = make_plan(
        "circle", ["tank.size_m=[3,3],[4,4],[5,5]", "camera.fitted=true"], seed=4, duration_s=1
    )
    return make_table(plan, dict(enumerate(RECORDS)))


def test_a_table_has_a_row_a_point_and_a_column_a_metric() -> None:
    made = table()
    assert made.columns == (
        "point",
        "tank.size_m",
        "camera.fitted",
        "seed",
        "trace_sha256",
        *METRICS,
        "arrival_s",
        "error",
    )
    assert made.failed == 1
    assert made.column("speed_m_s") == [0.1 + 0.2, None, 1e-9]
    assert made.column("arrival_s") == [None, None, 4.5]
    rows = list(csv.DictReader(io.StringIO(to_csv(made))))
    assert [row["point"] for row in rows] == ["0", "1", "2"]
    assert rows[0]["tank.size_m"] == "[3.0, 3.0]"
    assert rows[0]["camera.fitted"] == "true"
    assert float(rows[0]["speed_m_s"]) == 0.1 + 0.2
    assert rows[0]["turn_radius_m"] == rows[0]["error"] == rows[1]["speed_m_s"] == ""
    assert rows[1]["error"] == "circle: the motion diverged"


def test_json_says_the_same() -> None:
    made = table()
    document = json.loads(to_json(made))
    assert document["sweep"]["failed"] == 1
    assert document["sweep"]["vary"] == ["tank.size_m", "camera.fitted"]
    assert tuple(document["columns"]) == made.columns
    for row, expected in zip(document["rows"], made.rows, strict=True):
        assert tuple(row) == made.columns
        assert tuple(row.values()) == expected


def test_metrics_of_several_robots_keep_their_names() -> None:
    records = {0: {"trace_sha256": "a", "metrics": {"one": {"speed_m_s": 1.0}, "two": {"x": 2}}}}
    made = make_table(make_plan("circle", ["scenario.seed=1"]), records)
    assert made.column("one.speed_m_s") == [1.0]
    assert made.column("two.x") == [2]


def test_a_table_that_cannot_be_finished_leaves_the_old_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "t.csv"
    out.write_text("point,\n")

    def fail(number: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", fail)
    with pytest.raises(OSError, match=r"t\.csv: cannot be written: No space left"):
        write_table(out, table())
    assert [entry.name for entry in tmp_path.iterdir()] == ["t.csv"]
    assert out.read_text() == "point,\n"
