"""Every public class has a short text and a view; those of searches, leagues, fits and reproductions say the answer."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import re
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import polars as pl
import pytest

import vibroswarm
from helpers.markup import HOSTILE, Markup
from vibroswarm import Study, fields, preset, verdict
from vibroswarm.analysis.verdict import headline
from vibroswarm.calibrate.camera import RIGHT
from vibroswarm.calibrate.fit import Fit, Fitted
from vibroswarm.core.numbers import number
from vibroswarm.documents import DOCUMENTS, document_of
from vibroswarm.documents.notebook import html_of
from vibroswarm.floors.design import make_floor
from vibroswarm.league.entries import entries_of, floors_of
from vibroswarm.league.standings import League
from vibroswarm.league.tuning import tune
from vibroswarm.optimize.loop import Found, run_search
from vibroswarm.optimize.objective import Objective
from vibroswarm.optimize.spec import Search
from vibroswarm.optimize.validation import Scored, Truth, truth_of
from vibroswarm.paper.claims import MEASURED, all_claims
from vibroswarm.paper.item import CLAIMS, Settings
from vibroswarm.paper.items import all_items
from vibroswarm.paper.reproduce import ItemResult, Reproduction
from vibroswarm.recordings.recording import Recording
from vibroswarm.scenario.scenario import FieldNames, field_names

pytestmark = pytest.mark.usefixtures("without_layout")

ROOT = Path(__file__).parents[2]
STUBS = sorted(Path(vibroswarm.__file__).parent.rglob("*.pyi"))
MORE = ("plots", "networks", "tasks", "strategies", "testing", "league.standings", "league.entries", "league.tuning",
        "calibrate.effect", "calibrate.message_loss", "calibrate.fit_camera", "analysis.forced_error", "optimize.grid",
        "optimize.scenario_comparison", "optimize.sensitivity", "optimize.validation", "optimize.archive",
        "study.evaluation")  # fmt: skip
"""Modules of public names and of results of public functions, beside the stubs and the API pages."""
NO_OBJECTS = (
    *("Array", "NoParams", "NoArrays", "NoState", "Bit", "State", "Params", "Work", "Workers", "Bar"),
    *(
        "SingleProcessPools",
        "SenseProgram",
        "ClassBorders",
        "SenseState",
        "WalkProgram",
        "WalkState",
        "Dice",
        "World",
        "Arrays",
        "Message",
        "Beliefs",
        "Reading",
        "DetailedReading",
    ),
    *(
        "Draws",
        "Job",
        "StudyProgress",
        "Asked",
        "SensorFaults",
        "Picture",
        "TableView",
        "DrawnPicture",
        "Drawn",
    ),
)
"""Declarations that authors of strategies write, rows of robots' programs, and inner parts of pages and pools."""


def public_modules() -> set[str]:
    stubs = {".".join(stub.relative_to(Path(vibroswarm.__file__).parents[1]).parent.parts) for stub in STUBS}
    pages = "".join(page.read_text(encoding="utf-8") for page in (ROOT / "docs" / "api").glob("*.md"))
    return stubs | set(re.findall(r"automodule:: ([\w.]+)", pages)) | {f"vibroswarm.{name}" for name in MORE}


def public_names(module: ModuleType) -> list[str]:
    own = [
        name
        for name, value in vars(module).items()
        if name[0] != "_" and getattr(value, "__module__", None) == module.__name__
    ]
    return list(getattr(module, "__all__", own))


def public_classes() -> list[type]:
    found: dict[type, None] = {}
    for name in sorted(public_modules()):
        module = importlib.import_module(name)
        for one in public_names(module):
            value = getattr(module, one)
            is_shown = inspect.isclass(value) and not issubclass(value, BaseException)
            if is_shown and (value.__name__ not in NO_OBJECTS or value is vibroswarm.plots.Picture):
                found[value] = None
    return list(found)


CLASSES = public_classes()
LARGE = (pl.DataFrame({f"c{k}": range(100) for k in range(50)}), HOSTILE * 40, np.zeros((100, 3)), list(range(999)),
         {str(k): k for k in range(99)}, 0.1 + 0.2, None, [Fitted(HOSTILE, 1.0, 1.0, 1.0, 1.0)] * 99)  # fmt: skip
"""Values of fields that a view must shorten or escape."""


def test_the_public_classes_are_found() -> None:
    assert len(STUBS) >= 3
    assert {
        "Scenario",
        "Result",
        "Found",
        "FloorDesign",
        "Standings",
        "Reproduction",
        "Fit",
        "Recording",
    } <= {kind.__name__ for kind in CLASSES}
    assert len(CLASSES) > 80


def test_every_public_class_has_a_view_and_no_text_with_all_its_values() -> None:
    for kind in CLASSES:
        assert hasattr(kind, "_repr_html_"), kind
        written_by_us = kind.__repr__.__module__.startswith("vibroswarm")
        assert written_by_us or issubclass(kind, tuple), (
            f"{kind} is shown as a dataclass, with all its tables"
        )
        assert not hasattr(kind.__repr__, "__wrapped__"), kind  # dataclasses wrap the one that they write


@pytest.mark.parametrize("kind", [ItemResult, Recording], ids=lambda kind: kind.__name__)
def test_large_values_give_a_short_text_and_a_view_in_which_nothing_runs(kind: Any) -> None:
    """Made of large and hostile values, of which only the general view and text may be given."""
    from vibroswarm.core.notebook_view import NotebookView
    from vibroswarm.documents.notebook import values_document
    from vibroswarm.show.page import fragment_html

    value = object.__new__(kind)
    for place, field in enumerate(dataclasses.fields(kind)):
        object.__setattr__(value, field.name, LARGE[place % len(LARGE)])
    text = NotebookView.__repr__(value)
    assert text.startswith(f"{kind.__name__}(")
    assert len(text) < 200
    assert "\n" not in text
    view = Markup(fragment_html(values_document(value)))
    view.check_inert()
    assert len(view.text) < 20_000


def test_documents_that_are_found_by_name_are_of_classes_that_exist() -> None:
    for name in DOCUMENTS:
        module, _, kind = name.rpartition(".")
        assert getattr(importlib.import_module(module), kind).__module__ == module


def test_a_dataclass_without_it_is_seen() -> None:
    @dataclasses.dataclass
    class Plain:
        values: list[int]

    assert hasattr(Plain.__repr__, "__wrapped__")
    assert not hasattr(Plain, "_repr_html_")


def shown(value: Any, *words: str) -> Markup:
    view = Markup(value._repr_html_())
    view.check_inert()
    for word in words:
        assert word in view.text.replace("\u00a0", " ")
    text = repr(value)
    assert len(text) < 200
    assert "\n" not in text
    return view


@pytest.fixture(scope="module")
def found() -> Found:
    return run_search(Search.read(ROOT / "tests" / "helpers" / "small_search.toml"), workers=1)


@pytest.fixture(scope="module")
def truth(found: Found) -> Truth:
    return truth_of(found, runs=150)


def test_a_search_shows_its_winner_and_how_scores_fell(found: Found, truth: Truth) -> None:
    view = shown(found, f"Believed score: {number(found.believed)}", f"{found.runs:,} runs", *found.values)
    assert "img" in view.tags
    assert repr(found).startswith(
        f"Found(pso, {len(found.archive)} candidates in {found.runs} runs; believed score "
    )
    assert f"true {truth.winner.score.estimate:.4g}" in repr(truth)
    shown(truth, truth.words, number(truth.believed))
    assert isinstance(truth.winner, Scored)
    shown(truth.winner, truth.winner.name)
    shown(found.search)
    shown(found.archive)


def test_a_search_with_a_front_is_not_said_to_have_none(found: Found) -> None:
    """The control is the same search without a candidate on its front."""
    two = (Objective("decision_time", "mean"), Objective("errors", "mean"))
    search = dataclasses.replace(found.search.with_settings(method="nsga2", final=None), objectives=two)
    none = dataclasses.replace(found, search=search, front=())
    some = dataclasses.replace(none, front=(found.best,))
    assert "There is no front" in html_of(none)
    assert "There is no front" not in html_of(some)
    assert "Candidates on the front: 1" in html_of(some)
    assert "The winner was not scored on fresh runs" in html_of(found)


def test_standings_show_one_row_per_entry() -> None:
    base = preset("paper").with_values({"decision.min_observations": 40, "run.t_end_s": 200.0})
    league = League(
        base, entries_of(["none", "soft"], {}), floors_of(["random"], [0.48]), (4,), runs=8, seed=3
    )
    standings = league.play()
    shares = [f"{100 * share:.1f}" for share in standings.table["forced_error"]]
    shown(standings, "Smallest forced error", "Not tuned for a league", *shares)
    document = document_of(standings)
    assert document is not None
    assert document.tables["standings"].frame["name"].to_list() == standings.table["name"].to_list()
    assert "smallest forced error: '" in repr(standings)
    shown(league, "2 entries", "8 runs", "by default")
    tuned = tune(base, ["soft"], floors_of(["random"], [0.48]), (4,), points=1, runs=1)
    shown(tuned, "strategy.soft.eta", "1 setting for each tuned field", "favour the settings that were lucky")


def test_a_fit_shows_fields_and_estimates() -> None:
    estimates = (Fitted("speed factor", 0.912345, 0.01, 0.89, 0.93),)
    checks = {"share of avoidance": (0.3, 0.1, 0.2)}
    fit = Fit(preset("paper"), {"robot.radius_m": 0.0123}, estimates, checks, 5, 2, RIGHT)
    shown(fit, "robot.radius_m", "0.0123", "0.91234 [0.89000, 0.93000]", "Outside", "2 sessions", "bursts")


def test_a_reproduction_shows_a_verdict_for_each_claim() -> None:
    claim = next(claim for claim in all_claims() if claim.cells == 1 and claim.kind == "claim")
    row = {
        "value": claim.value,
        "column": claim.columns[0],
        "cell": "",
        "estimate": 1e9,
        "n": 10,
        "exact": True,
    }
    rows = pl.DataFrame([row], schema={name: MEASURED[name] for name in row}).with_columns(
        pl.lit(None, MEASURED[name]).alias(name) for name in MEASURED if name not in row
    )
    item = next(item for item in all_items() if item.name == claim.item)
    item = dataclasses.replace(item, pictures=lambda tables, settings: iter(()))  # it has no tables to draw
    made = (ItemResult(item, {CLAIMS: rows.select(list(MEASURED))}), ItemResult(item, {}, HOSTILE))
    reproduction = Reproduction(Settings(runs=10), made, {}, None)
    (one,) = reproduction.decided
    assert one.verdict in ("reproduced", "not reproduced")
    view = shown(reproduction, f"1 {one.verdict}", claim.statement, "10 runs", HOSTILE)
    assert view.tags.count("tr") == 2 * 2, "verdicts, and the measured values"
    assert repr(reproduction) == f"Reproduction(2 items, 10 runs of each cell; 1 {one.verdict})"
    shown(one, claim.statement, one.verdict)
    shown(claim, claim.statement)
    shown(made[0])


def test_a_designed_floor_shows_floor_and_measures() -> None:
    design = make_floor(4, 4, 0.5, 0.3)
    view = shown(design, f"{design.difficulty.moran_index:.3f}")
    assert "img" in view.tags
    shown(design.difficulty)


def test_a_recording_shows_its_verdict_and_player(tmp_path: Path) -> None:
    from vibroswarm.cli import main

    lab = ROOT / "examples" / "lab"
    arguments = [
        str(lab / "session-1.csv"),
        "--floor",
        str(lab / "floor.txt"),
        "--out",
        str(tmp_path / "lab"),
    ]
    assert main(["lab", "import", *arguments, "-q"]) == 0
    recording = Recording.read(tmp_path / "lab")
    view = shown(recording, headline(verdict(recording)))
    assert repr(recording).startswith("Recording(1 run")
    assert len(view.frames) == 1


def test_field_names_complete() -> None:
    assert fields.swarm.robots == "swarm.robots"
    assert {"strategy", "floor", "run"} <= set(dir(fields))
    sections = [fields]
    names = []
    while sections:
        section = sections.pop()
        below = [getattr(section, name) for name in dir(section)]
        names += [one for one in below if isinstance(one, str)]
        sections += [one for one in below if isinstance(one, FieldNames)]
    assert sorted(names) == sorted(field_names())
    study = Study(preset("paper"), {"grid": {fields.swarm.robots: [5, 6]}}, 1)
    assert len(study.cells) == 2
    with pytest.raises(AttributeError, match=r"swarm\.robot', did you mean 'robots'"):
        _ = fields.swarm.robot
    assert not hasattr(fields, "_ipython_canary_method_should_not_exist_")
    shown(fields, "swarm")
