"""Archives: confirmed where nothing was touched, refused or told where something was."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from vibroswarm.cli import main
from vibroswarm.errors import InputError
from vibroswarm.paper.archive import HEAD, Zipped
from vibroswarm.paper.cells import Cell
from vibroswarm.paper.verify_archive import check_work, verify
from vibroswarm.scenario.scenario import preset

Entries = dict[str, bytes]


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of one item, twelve cells of 12 runs."""
    folder = tmp_path_factory.mktemp("archive")
    asked = ["--only", "fill-ratios", "--columns", "paper", "--runs", "12", "--no-pictures"]
    path = folder / "paper.zip"
    assert main(["reproduce", *asked, "--out", str(folder / "out"), "--archive", str(path)]) == 0
    return path


def _entries(path: Path) -> Entries:
    with zipfile.ZipFile(path) as file:
        return {name: file.read(name) for name in file.namelist()}


def _changed(path: Path, change: Callable[[Entries], None], folder: Path, *, honest: bool) -> Path:
    """A copy with changed entries; ``honest``: with the hashes as they were."""
    entries = _entries(path)
    change(entries)
    if not honest:
        head = json.loads(entries[HEAD])
        head["sha256"] = {n: hashlib.sha256(d).hexdigest() for n, d in entries.items() if n != HEAD}
        entries[HEAD] = json.dumps(head).encode()
    out = folder / "changed.zip"
    with zipfile.ZipFile(out, "w") as file:
        for name, data in entries.items():
            file.writestr(name, data)
    return out


def test_an_archive_holds_what_is_needed_and_no_more(archive: Path) -> None:
    entries = _entries(archive)
    head = json.loads(entries[HEAD])
    cells = pl.read_csv(io.BytesIO(entries["cells.csv"]))
    assert cells.height == 12
    assert {f"scenarios/{name}.toml" for name in cells["scenario"]} <= set(entries)
    assert set(head["sha256"]) == set(entries) - {HEAD}
    assert {"vibroswarm", "numba", "architecture", "code"} <= set(head["versions"])
    assert not any(name.endswith((".pkl", ".pickle", ".parquet")) for name in entries)


def test_the_same_reproduction_gives_the_same_bytes(archive: Path, tmp_path: Path) -> None:
    asked = ["--only", "fill-ratios", "--columns", "paper", "--runs", "12", "--no-pictures"]
    with_cells = tmp_path / "again.zip"
    out = archive.parent / "out"
    assert main(["reproduce", *asked, "--out", str(out), "--archive", str(with_cells)]) == 0
    assert with_cells.read_bytes() == archive.read_bytes()


def test_the_command_confirms_it_bit_by_bit(archive: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["reproduce", "--from", str(archive), "--check", "3"]) == 0
    told = capsys.readouterr().out
    assert told.count("recomputed: vibroswarm evaluate") == 3
    assert "Confirmed bit by bit" in told


def test_with_other_versions_it_is_compared_event_by_event(archive: Path, tmp_path: Path) -> None:
    def older(entries: Entries) -> None:
        head = json.loads(entries[HEAD])
        head["versions"]["architecture"] = "vax"
        entries[HEAD] = json.dumps(head).encode()

    found = verify(_changed(archive, older, tmp_path, honest=True), 2)
    assert found.how == "event by event"
    assert "vax" in found.why
    assert found.wrong == ()


def _edit(name: str, edit: Callable[[pl.DataFrame], pl.DataFrame]) -> Callable[[Entries], None]:
    def change(entries: Entries) -> None:
        table = pl.read_csv(io.BytesIO(entries[name]), infer_schema_length=None)
        entries[name] = edit(table).write_csv().encode()

    return change


def _swap_scenarios(entries: Entries) -> None:
    one, other = [name for name in entries if name.startswith("scenarios/")][:2]
    entries[one], entries[other] = entries[other], entries[one]


TAMPERED = {
    "a figure": (_edit("cells.csv", lambda t: t.with_columns(pl.col("belief_in_truth") + 0.01)), " differ"),
    "a digest": (_edit("cells.csv", lambda t: t.with_columns(digest=pl.lit("0" * 64))), "its robots differ"),
    "a robot": (_edit("robots.csv", lambda t: t.with_columns(pl.col("samples") + 1)), "runs 0, 1"),
    "a seed": (_edit("cells.csv", lambda t: t.with_columns(block=1 - pl.col("block"))), " differ"),
    "a table": (
        _edit("tables/fill-ratios-cells.csv", lambda t: t.with_columns(pl.col("decision_time_s") - 50)),
        "rows that match no cell",
    ),
    "a verdict": (_edit("claims.csv", lambda t: t.with_columns(paper=pl.lit("reproduced"))), "do not follow"),
}  # fmt: skip


@pytest.mark.parametrize("what", list(TAMPERED))
def test_a_tampered_archive_is_not_confirmed(what: str, archive: Path, tmp_path: Path) -> None:
    """Also where whoever changed it has mended the hashes."""
    change, says = TAMPERED[what]
    found = verify(_changed(archive, change, tmp_path, honest=False), 12)
    assert any(says in words for words in found.wrong)
    plain = verify(_changed(archive, change, tmp_path, honest=True), 1)
    assert any("differs from the file that was archived" in words for words in plain.wrong)


def test_the_command_fails_on_a_tampered_archive(
    archive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = _changed(archive, TAMPERED["a figure"][0], tmp_path, honest=False)
    assert main(["reproduce", "--from", str(path), "--check", "1"]) == 1
    captured = capsys.readouterr()
    assert "DIFFERS: cell" in captured.out
    assert "not confirmed" in captured.err


def test_a_scenario_under_another_name_is_refused(archive: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not match the scenario of that name"):
        verify(_changed(archive, _swap_scenarios, tmp_path, honest=False), 12)


def test_an_archive_cannot_ask_for_years_of_work(archive: Path, tmp_path: Path) -> None:
    huge = _edit("cells.csv", lambda table: table.with_columns(runs=pl.lit(10**7)))
    with pytest.raises(InputError, match="too large to be recomputed here"):
        verify(_changed(archive, huge, tmp_path, honest=False), 1)


@pytest.mark.parametrize(("version", "words"), [(1, "make the archive again"), (9, "update vibroswarm")])
def test_an_archive_of_another_format_is_refused_in_one_sentence(
    archive: Path, tmp_path: Path, version: int, words: str
) -> None:
    def other(entries: Entries) -> None:
        entries[HEAD] = json.dumps(json.loads(entries[HEAD]) | {"format": version}).encode()

    with pytest.raises(InputError, match=words):
        verify(_changed(archive, other, tmp_path, honest=False), 1)


def test_absurd_work_is_refused_with_an_estimate() -> None:
    """Each within the limits of its own, together weeks of work."""
    scenario = preset("paper").with_values(
        {"swarm.robots": 100, "run.t_end_s": 8000.0, "arena.width_m": 5.0, "arena.height_m": 5.0}
    )
    check_work([Cell("paper", scenario.with_values({"swarm.robots": 5, "run.t_end_s": 1200.0}))], 1000, "it")
    with pytest.raises(InputError, match=r"^it: .* about \d+ days of one core.*--check"):
        check_work([Cell("paper", scenario)], 100_000, "it")
    often = scenario.with_values({"sample.sample_interval_ms": 0.0, "sample.stop_ms": 20.0})
    with pytest.raises(InputError, match="samples a run"):
        check_work([Cell("paper", often)], 1, "it")


@pytest.mark.parametrize("name", ["cells.csv", "robots.csv", "measured.csv", "claims.csv"])
def test_a_table_without_a_column_is_refused(archive: Path, tmp_path: Path, name: str) -> None:
    for column in pl.read_csv(io.BytesIO(_entries(archive)[name]), infer_schema_length=None).columns:
        less = _edit(name, lambda table, column=column: table.drop(column))  # type: ignore[misc]
        with pytest.raises(InputError, match=f"'{column}'"):
            verify(_changed(archive, less, tmp_path, honest=False), 1)


@pytest.mark.parametrize(
    ("name", "column", "value"),
    [("cells.csv", "runs", None), ("cells.csv", "runs", -5), ("cells.csv", "runs", 0),
     ("cells.csv", "runs", "x"), ("cells.csv", "block", 1.5), ("cells.csv", "key", "a"),
     ("cells.csv", "scenario", "../../x"), ("cells.csv", "belief_in_truth", 7.0), ("robots.csv", "robot", -1),
     ("robots.csv", "belief_below", "inf"), ("robots.csv", "decision", None), ("measured.csv", "n", "x")],
)  # fmt: skip
def test_a_table_of_wrong_values_is_refused(
    archive: Path, tmp_path: Path, name: str, column: str, value: Any
) -> None:
    wrong = _edit(name, lambda table: table.with_columns(pl.lit(value).alias(column)))
    with pytest.raises(InputError):
        verify(_changed(archive, wrong, tmp_path, honest=False), 1)


def test_an_archive_packed_in_an_odd_way_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "lzma.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_LZMA) as file:
        file.writestr(HEAD, b"{}")
    with pytest.raises(InputError, match="deflate"):
        verify(path)


@pytest.mark.parametrize(
    "name", ["../evil.toml", "/etc/passwd", "a/../../b.csv", "scenarios\\x.toml", "C:evil", "a/b/c.csv", ""]
)
def test_odd_names_are_refused(name: str, tmp_path: Path) -> None:
    path = tmp_path / "odd.zip"
    with zipfile.ZipFile(path, "w") as file:
        file.writestr(HEAD, b"{}")
        file.writestr(zipfile.ZipInfo(name or " "), b"x")
    with pytest.raises(InputError, match="invalid name"):
        verify(path)
    assert sorted(one.name for one in tmp_path.iterdir()) == ["odd.zip"]


def test_what_unpacks_to_too_much_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "bomb.zip"
    monkeypatch.setattr("vibroswarm.paper.archive.MOST_BYTES", 2**20)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for k in range(6):
            file.writestr(f"part{k}.csv", bytes(2**18))
    assert path.stat().st_size < 2**14
    with pytest.raises(InputError, match="too large"):
        verify(path)


@pytest.mark.parametrize("data", [b"", b"PK", b"no zip at all" * 50])
def test_what_is_no_archive_is_refused(data: bytes, tmp_path: Path) -> None:
    path = tmp_path / "no.zip"
    path.write_bytes(data)
    with pytest.raises(InputError, match="not a zip file"):
        verify(path)
    with pytest.raises(InputError, match="not a file"):
        verify(tmp_path / "nothing.zip")


@pytest.mark.parametrize("head", [b"", b"[]", b'{"format": 1}', b'{"format": "new"}', b"[" * 5000])
def test_a_head_that_is_none_is_refused(head: bytes, tmp_path: Path) -> None:
    path = tmp_path / "head.zip"
    with zipfile.ZipFile(path, "w") as file:
        file.writestr(HEAD, head)
    with pytest.raises(InputError, match="not an archive of a reproduction"):
        verify(path)


def test_a_cut_or_spoilt_archive_is_told(archive: Path, tmp_path: Path) -> None:
    """Any byte of an entry's data: told as damaged, never a traceback."""
    data = bytearray(archive.read_bytes())
    with zipfile.ZipFile(archive) as file:
        entry = file.getinfo("robots.csv")
    at = entry.header_offset + 30 + len(entry.filename) + entry.compress_size // 2
    data[at] ^= 0xFF
    spoilt = tmp_path / "spoilt.zip"
    spoilt.write_bytes(bytes(data))
    with Zipped(spoilt) as file, pytest.raises(InputError, match="damaged"):
        file.read("robots.csv")
    spoilt.write_bytes(bytes(data[: len(data) // 2]))
    with pytest.raises(InputError, match="not a zip file"):
        verify(spoilt)


def test_an_archive_of_items_without_cells_is_confirmed_by_its_hashes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "paper.zip"
    asked = ["reproduce", "--only", "difficulty", "--runs", "4", "--no-pictures", "--archive", str(path)]
    assert main([*asked, "--out", str(tmp_path / "out")]) == 0
    assert "cells.csv" not in _entries(path)
    capsys.readouterr()
    assert main(["reproduce", "--from", str(path), "--check"]) == 0
    assert "no cells that could be recomputed" in capsys.readouterr().out
    (table,) = (name for name in _entries(path) if name.startswith("tables/"))
    changed = _changed(path, lambda entries: entries.update({table: b"a\n1\n"}), tmp_path, honest=True)
    assert verify(changed).wrong == (f"{table} differs from the file that was archived",)


def test_an_archive_with_scenarios_needs_its_cells(archive: Path, tmp_path: Path) -> None:
    changed = _changed(archive, lambda entries: entries.pop("cells.csv"), tmp_path, honest=False)
    with pytest.raises(InputError, match=r"has no 'cells\.csv'"):
        verify(changed)


def test_from_and_check_go_together(archive: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["reproduce", "--from", str(archive)]) == 2
    assert main(["reproduce", "--check"]) == 2
    assert "needs --check, and --check needs --from" in capsys.readouterr().err


def test_an_archive_in_the_folder_is_no_strange_file(tmp_path: Path) -> None:
    """The same command can be run again."""
    out = tmp_path / "out"
    command = ["reproduce", "--only", "difficulty", "--runs", "4", "--no-pictures"]
    command += ["--out", str(out), "--archive", str(out / "paper.zip")]
    assert main(command) == 0
    assert main(command) == 0
