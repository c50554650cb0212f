"""``vibroswarm show`` on whatever commands write, and one rule for folders that exist already."""

from __future__ import annotations

import json
import os
import shutil
import webbrowser
from pathlib import Path

import polars as pl
import pytest

from helpers.commands import json_of, output_of, refusal_of, words_of
from vibroswarm import preset, simulate
from vibroswarm.cli import main
from vibroswarm.cli.show import _needs_kernels
from vibroswarm.core.folders import FORMAT, kind_of, manifest_text
from vibroswarm.documents.saved import begin, save
from vibroswarm.show.document import Document, Table

ROOT = Path(__file__).parents[2]
SHORT = ["--set", "run.t_end_s=60", "--set", "decision.min_observations=5"]
STUDY = ["--runs", "4", "--robots", "2", *SHORT]
LEAGUE = ["--patterns", "stripe", "--strategy", "none,soft", "--robots", "2", *SHORT]
LOGS = [f"examples/lab/session-{k}.csv" for k in (1, 2)]
ON_FLOOR = ["--floor", "examples/lab/floor.txt", "--tiles", "5x5"]

COMMANDS: dict[str, list[str]] = {
    "run": ["run", "--robots", "2", *SHORT],
    "evaluate": ["evaluate", "--strategy", "none,soft", "--no-pictures", *STUDY],
    "detect": ["detect", "--fills", "0.4,0.6", *STUDY],
    "tradeoff": ["evaluate", "tradeoff", "--thresholds", "0.8,0.95", "--observations", "0,5", *STUDY],
    "league": ["league", "--runs", "3", "--belief-runs", "0", "--fault-runs", "0", *LEAGUE],
    "optimize": ["optimize", "search.toml", "--budget", "120", "--fresh", "4", "--no-pictures"],
    "lab import": ["lab", "import", *LOGS, *ON_FLOOR],
}
SEARCH = """
[scenario]
preset = "paper"
swarm = { robots = 2 }
run = { t_end_s = 60 }
[space]
"decision.min_observations" = { from = 1, to = 20 }
[search]
method = "random"
finalists = 2
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    """The folder in which commands run, with their input."""
    place = tmp_path_factory.mktemp("written")
    shutil.copytree(ROOT / "examples", place / "examples")
    (place / "search.toml").write_text(SEARCH)
    return place


@pytest.fixture(autouse=True)
def here(place, monkeypatch):
    monkeypatch.chdir(place)
    monkeypatch.setenv("COLUMNS", "60")


def out_of(name: str) -> str:
    return name.replace(" ", "-")


def made(name: str, capsys: pytest.CaptureFixture[str]) -> str:
    """What the command prints when its folder is made, or made again."""
    return output_of(capsys, *COMMANDS[name], "--out", out_of(name))


def results(text: str) -> list[str]:
    """Lines of results, without those of where they are saved."""
    places = ("Saved", "Page", "Report", "Not saved")
    return [line for line in text.splitlines() if line.strip() and not line.startswith(places)]


@pytest.mark.slow
@pytest.mark.usefixtures("blank_pictures")
@pytest.mark.parametrize("name", COMMANDS)
def test_results_are_shown_again_and_only_the_same_work_goes_on(name, capsys):
    Path(out_of(name)).mkdir()  # an empty folder is used
    printed = results(made(name, capsys))
    assert len(printed) >= 4
    assert max(map(len, printed)) <= 60, "no line is wider than the terminal"
    shown = results(output_of(capsys, "show", out_of(name)))
    assert shown[-len(printed) :] == printed
    assert json_of(capsys, "show", out_of(name), "--json")
    assert results(made(name, capsys)) == printed, "the same work is no obstacle"
    other = [*COMMANDS[name], "--out", out_of(name), "--seed", "7"]
    if name == "lab import":
        other = ["lab", "import", LOGS[0], *ON_FLOOR, "--out", out_of(name)]
    err = refusal_of(capsys, *other)
    assert out_of(name) in err
    assert "give another --out, or add --force to replace it" in err
    assert results(output_of(capsys, "show", out_of(name))) == shown, "nothing was changed"


def test_a_damaged_file_is_named_when_its_folder_is_refused(tmp_path, capsys):
    out = tmp_path / "out"
    command = [*COMMANDS["evaluate"], "--out", out]
    output_of(capsys, *command)
    (out / "study.toml").unlink()
    refusal = refusal_of(capsys, *command)
    assert "out: study.toml cannot be read: there is no such file; give another --out, or add" in refusal


@pytest.mark.slow
def test_force_replaces_what_vibroswarm_wrote_and_nothing_else(tmp_path, capsys):
    out = tmp_path / "out"
    assert main([*COMMANDS["evaluate"], "--out", str(out)]) == 0
    assert main([*COMMANDS["run"], "--out", str(out)]) == 2
    assert main([*COMMANDS["run"], "--out", str(out), "--force"]) == 0
    assert (out / "run.html").exists()
    assert kind_of(out) == "result"
    assert main([*COMMANDS["evaluate"], "--out", str(out)]) == 2
    assert main([*COMMANDS["evaluate"], "--out", str(out), "--force"]) == 0
    assert kind_of(out) == "study"
    assert not (out / "run.html").exists()
    mine = tmp_path / "thesis"
    mine.mkdir()
    (mine / "thesis.tex").write_text("ten years")
    capsys.readouterr()
    for name in COMMANDS:
        assert main([*COMMANDS[name], "--out", str(mine), "--force"]) == 2, name
        assert "--force does not replace it" in capsys.readouterr().err
        assert [path.name for path in mine.iterdir()] == ["thesis.tex"]
    assert "is not a folder of vibroswarm" in refusal_of(
        capsys, "reproduce", "--only", "fill-ratios", "--out", mine
    )


def test_a_scenario_is_shown(capsys):
    assert main(["scenario", "--robots", "8", "--out", "scenario.toml"]) == 0
    assert "swarm.robots 8 5" in words_of(capsys, "show", "scenario.toml")
    json_of(capsys, "show", "scenario.toml", "--json")


def test_tables_settings_and_studies_are_shown(tmp_path, capsys):
    (tmp_path / "a.csv").write_text("name,value\nx,0.25\n")
    told = "# how\n# forced_error: of these settings.\n\n"
    (tmp_path / "settings.toml").write_text(f'{told}[none]\n"decision.credible_threshold" = 0.9\n')
    (tmp_path / "study.toml").write_text('runs = 4\n[grid]\n"strategy.name" = ["none", "soft"]\n')
    for name, words in {
        "a.csv": "name value x 0.25",
        "settings.toml": "how Forced error: of these settings. strategy field value none decision.credible",
        "study.toml": "2 cells, seed 1, varied: strategy.name",
        ".": "a.csv 1 2",
    }.items():
        assert words in words_of(capsys, "show", tmp_path / name)


def test_an_error_without_words_is_told_by_its_type(tmp_path, monkeypatch, capsys):
    def fail(*_given, **_options):
        raise pl.exceptions.ComputeError

    (tmp_path / "a.csv").write_text("name,value\nx,0.25\n")
    monkeypatch.setattr(pl, "read_csv", fail)
    assert "a.csv: cannot be read: ComputeError" in refusal_of(capsys, "show", tmp_path / "a.csv")


@pytest.mark.parametrize(
    "begin",
    ["1.0e+00,0.0e+00\n", "\ufeff1,0\n", "# a floor of our own\n1,0\n"],
    ids=["savetxt", "mark", "comment"],
)
def test_each_floor_that_can_be_read_is_shown_as_a_floor(begin, tmp_path, capsys):
    path = tmp_path / "floor.csv"
    path.write_text(begin + "0,1\n", encoding="utf-8")
    said = words_of(capsys, "show", path)
    assert "2 x 2" in said
    assert "2 vibrating" in said
    json_of(capsys, "show", path, "--json")


def test_a_grid_is_not_shown_as_a_search(tmp_path, capsys):
    from vibroswarm.optimize.grid import Grid

    (tmp_path / "grid.toml").write_text(Grid.paper().to_toml(), encoding="utf-8")
    assert main(["show", str(tmp_path / "grid.toml")]) == 0
    cells = len(Grid.paper().study.cells)
    assert capsys.readouterr().out.startswith(f"Grid of {cells} cells over ")


def test_what_is_not_finite_is_null_in_json(tmp_path, capsys):
    path = tmp_path / "a.csv"
    path.write_text("name,value\nx,inf\ny,-inf\nz,NaN\nw,0.25\n")
    rows = json_of(capsys, "show", path, "--json")["tables"]["table"]
    assert rows == [{"name": n, "value": v} for n, v in (("x", None), ("y", None), ("z", None), ("w", 0.25))]


@pytest.mark.parametrize(
    "harm",
    [
        lambda about: about.pop("document"),
        lambda about: about["document"].pop("answer"),
        lambda about: about["document"].__setitem__("parts", [{"words": 5}]),
        lambda about: about["document"].__setitem__("parts", [{"frame": {"a": [1], "b": [1, 2]}}]),
        lambda about: about["document"].__setitem__("parts", [{"frame": {"a": [1]}, "names": 2}]),
        lambda about: about.__setitem__("format", 99),
        lambda about: about.__setitem__("format", 1),
    ],
)
def test_a_damaged_file_of_what_was_printed_is_named(harm, tmp_path, capsys):
    document = {"title": "x", "answer": ["fine"]}
    about = {"format": FORMAT, "kind": "document", "command": "league", "document": document}
    begin(tmp_path, "league")
    (tmp_path / "printed.json").write_text(json.dumps(about))
    assert main(["show", str(tmp_path)]) == 0
    harm(about)
    (tmp_path / "printed.json").write_text(json.dumps(about))
    assert "printed.json" in refusal_of(capsys, "show", tmp_path)


def test_what_was_printed_is_saved_without_indents(tmp_path):
    """A number a line made two thirds of a file of 30 MB."""
    rows = Table(pl.DataFrame({"a": range(1000)}))
    save(Document("x", ("fine",), parts=(rows,)), tmp_path, "league", page=None)
    assert (tmp_path / "printed.json").read_text().count("\n") == 1
    assert main(["show", str(tmp_path)]) == 0


def test_escape_sequences_of_a_foreign_file_reach_no_terminal(tmp_path, capsys):
    parts = [{"words": "a\x1b[2Jb"}, {"frame": {"\x1b]0;x\x07": ["\x1b[31m"]}}]
    document = {"title": "\x1b[2J", "answer": ["\x1b[2J"], "warnings": ["\x1b[2J"], "parts": parts}
    (tmp_path / "printed.json").write_text(
        json.dumps({"format": FORMAT, "kind": "document", "command": "x", "document": document})
    )
    begin(tmp_path, "x")
    assert "\x1b" not in output_of(capsys, "show", tmp_path)


def test_open(tmp_path, monkeypatch, capsys):
    page = tmp_path / "run.html"
    page.write_text("<p>")
    (tmp_path / "a.csv").write_text("a\n1\n")
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", lambda address: opened.append(address) or True)
    monkeypatch.setattr("vibroswarm.cli.deliver.has_display", lambda: True)
    assert main(["show", str(tmp_path), "--open"]) == 0
    assert opened == [page.resolve().as_uri()]
    monkeypatch.setattr("vibroswarm.cli.deliver.has_display", lambda: False)
    assert main(["show", str(tmp_path), "--open"]) == 0
    assert len(opened) == 1
    assert f"no browser can be opened here; open {page}" in capsys.readouterr().err
    page.unlink()
    assert "has no page to open" in refusal_of(capsys, "show", tmp_path, "--open")
    assert "--open: needs --out" in refusal_of(capsys, "run", "--open")


def test_a_result_without_run_0_is_shown(tmp_path, capsys):
    simulate(preset("paper").with_values({"run.t_end_s": 60.0}), 1, [5, 6]).write(tmp_path / "result")
    assert "'random:0.48'" in output_of(capsys, "show", tmp_path / "result")


def test_a_changed_table_of_a_command_is_refused(tmp_path, capsys):
    """It would still parse."""
    line = ["detect", "--fills", "0.4,0.6", "--no-pictures", *STUDY, "--out", str(tmp_path / "out")]
    assert main(line) == 0
    table = tmp_path / "out" / "detection.parquet"
    assert main(["show", str(table)]) == 0
    pl.read_parquet(table).head(1).write_parquet(table)
    assert f"{table}: " in refusal_of(capsys, "show", table)


def test_a_pipe_in_the_place_of_a_scenario_is_not_opened(tmp_path):
    (tmp_path / "vibroswarm.json").write_text(manifest_text("result"))
    os.mkfifo(tmp_path / "scenario.toml")  # opening it would wait for ever
    assert _needs_kernels(tmp_path)


def test_a_study_compared_at_equal_error_is_shown_by_compiled_kernels(tmp_path):
    """It simulates runs again, which takes minutes as plain Python."""
    (tmp_path / "vibroswarm.json").write_text(manifest_text("study"))
    (tmp_path / "study.toml").write_text('[scenario]\nsensor = { model = "gamma" }\n')
    assert not _needs_kernels(tmp_path)
    (tmp_path / "equal_error.csv").touch()
    assert _needs_kernels(tmp_path)


def test_a_damaged_run_is_said_and_computed_again(tmp_path, caplog):
    line = [*COMMANDS["run"], "--out", str(tmp_path / "out")]
    assert main(line) == 0
    table = tmp_path / "out" / "observations.parquet"
    before = table.read_bytes()
    pl.read_parquet(table).with_columns(observation=1 - pl.col("observation")).write_parquet(table)
    assert main(["show", str(tmp_path / "out")]) == 2
    assert main(line) == 0
    assert f"{table}: " in caplog.text
    assert "computed again" in caplog.text
    assert table.read_bytes() == before
