"""What ``vibroswarm evaluate`` and ``detect`` run, from their words, so that Python runs the same with the same words::

study_of(strategy=["none", "soft"], robots=[5, 10], vary=["strategy.soft.eta=1,2"], runs=1000)
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, Unpack

from vibroswarm.core.untrusted_files import parsed_toml, read_text
from vibroswarm.errors import InputError, named
from vibroswarm.floors.source import source_of
from vibroswarm.scenario import plugins
from vibroswarm.scenario.scenario import Scenario, parse_settings, parse_values, preset
from vibroswarm.study.factors import fields_in
from vibroswarm.study.precision import Precision
from vibroswarm.study.scenario_words import (
    ScenarioWords,
    base_of,
    chosen,
    refuse_without_effect,
    scenario_of,
    several,
    values_of,
)
from vibroswarm.study.spec import Study, with_fields

RUNS = 100
"""Runs of each cell if neither ``runs`` nor ``until`` is given."""


FIELDS: Final = {
    "strategy": "strategy.name",
    "robots": "swarm.robots",
    "floor": "floor.source",
    "network": "network.name",
    "task": "task.name",
}
"""Words that name the value of a field."""


def study_of(
    file: Path | None = None,
    /,
    *,
    vary: Sequence[str] = (),
    runs: int | None = None,
    until: str | None = None,
    figure: str | None = None,
    max_runs: int | None = None,
    keep_samples: bool = False,
    seed: int | None = None,
    motion: str | None = None,
    **scenario: Unpack[ScenarioWords],
) -> Study:
    """Return the study of a file, or that of a scenario: its base, the varied fields, and the number of runs.

    Args:
        file: it says all but ``runs``, so that no other word may be given with it.
        vary: texts FIELD=A,B; several strategies or numbers of robots also vary.
        until, figure, max_runs: runs are added until the figure's interval is this narrow; not with ``runs``.
    Raises:
        InputError: words conflict, or a name, field or value is wrong.
    """
    if file is not None:
        own = {
            "vary": vary,
            "until": until,
            "figure": figure,
            "max_runs": max_runs,
            "keep_samples": keep_samples,
        }
        _refuse_beside_file({**scenario, "seed": seed, "motion": motion, **own})
        study = Study.read(file)
        return study if runs is None else study.with_runs(runs)
    varied = _varied(vary)
    for word, field in FIELDS.items():
        if field in varied and several(scenario.get(word)):
            raise InputError(f"is also set by --{word}; use one of them", field=f"--vary {field}")
    for word in ("strategy", "robots"):
        if values := _several(scenario, word):
            varied[FIELDS[word]] = values
    # If presets are varied, the base holds only the fields that words set; all others come from each preset.
    base = _base_of_presets(scenario) if "preset" in varied else _base_beside(varied, scenario)
    for field, values in varied.items():  # code is loaded by now: its parameters are fields
        with named(f"--vary {field}"):
            fields_in({field: values}, "--vary")
    precision = _precision(runs, until, figure, max_runs)
    study = Study(
        base=base,
        vary={"grid": varied} if varied else {},
        runs=None if precision else RUNS if runs is None else runs,
        until=precision,
        seed=1 if seed is None else seed,
        motion=chosen("motion", motion or "event"),
        keep=("samples",) if keep_samples else (),
        folder=Path(),  # floor files that options name are relative to the current folder
    )
    scenarios = [cell.scenario for cell in study.cells]
    given = parse_settings(scenario.get("settings", ()))
    refuse_without_effect(varied, scenarios, "--vary ", beside=given)
    refuse_without_effect(given, scenarios, "--set ", beside=varied)
    return study


def _refuse_beside_file(words: dict[str, Any]) -> None:
    """Refuse words for a scenario beside a study file."""
    given = [name for name, value in words.items() if value or (value == 0 and value is not False)]
    if given:
        name = "set" if given[0] == "settings" else given[0].replace("_", "-")
        raise InputError("is not for a study file, which says what is simulated", field=f"--{name}")


def _several(scenario: ScenarioWords, word: str) -> list[Any]:
    """Take the values of a word that has several out of a scenario's words; an empty list if it has one or none."""
    values = several(scenario.get(word))
    if len(values) < 2:
        return []
    if word == "robots":
        del scenario["robots"]
        return list(values)
    # The base has the first: the paper's strategy may not go together with the other options.
    scenario["strategy"] = values[:1]
    return [chosen("strategy", str(name)) for name in values]


def _precision(
    runs: int | None, until: str | None, figure: str | None, max_runs: int | None
) -> Precision | None:
    """Return the precision that is wanted; None if there is a number of runs."""
    if until is None:
        if figure is not None or max_runs is not None:
            raise InputError("needs --until", field="--figure" if figure is not None else "--max-runs")
        return None
    if runs is not None:
        raise InputError("use --runs or --until, not both", field="--until")
    return Precision.from_words(until, figure, max_runs)


def _base_beside(varied: dict[str, list[Any]], scenario: ScenarioWords) -> dict[str, Any]:
    """Return the base of a study, which may fit together only with the values that vary: each cell is then judged.

    Raises:
        InputError: the scenario is invalid, and nothing varies.
    """
    try:
        return scenario_of(**scenario).model_dump(exclude_none=True)
    except InputError:
        if not varied:
            raise
        base = base_of(**scenario)
        return with_fields(base.model_dump(exclude_none=True), values_of(base, **scenario))


def _base_of_presets(scenario: ScenarioWords) -> dict[str, Any]:
    """Return the base of a study that varies presets: only the fields that words set, by section and field.

    These fields override those of every preset. All other fields of a cell come from the cell's preset.

    Raises:
        InputError: a preset or a file is given too.
    """
    for option in ("preset", "scenario"):
        if scenario.get(option) is not None:
            raise InputError("conflicts with --vary preset; use one of them", field=f"--{option}")
    # The paper's preset gives the size of a random floor if --tiles does not.
    return with_fields({}, values_of(preset("paper"), **scenario))


def _varied(texts: Sequence[str]) -> dict[str, list[Any]]:
    """Return the varied values by dotted field name, parsed from texts ``FIELD=A,B``.

    If a value is user code (FILE.py:NAME), the file is loaded, so that the code's name and fields are known.

    Raises:
        InputError: a text is not of this form, a field is given twice, or a value of user code cannot be loaded.
    """
    vary: dict[str, list[Any]] = {}
    for text in texts:
        name, values = parse_values(text)
        if name in vary:
            raise InputError("is varied twice", field=f"--vary {name}")
        kind = name.partition(".")[0]
        names_code = kind in plugins.KINDS and name == plugins.field_of(kind)
        vary[name] = [chosen(kind, one) if names_code and plugins.is_code(one) else one for one in values]
    return vary


def detection_scenario(
    more_than: float | None = None, boundary_of: str | None = None, **scenario: Unpack[ScenarioWords]
) -> Scenario:
    """Return the scenario of a detection; its robots allow for their sensor's errors by default.

    Args:
        more_than: share of the tiles that is asked about. boundary_of: "tiles" or "readings". scenario: other words;
            of several numbers of robots, the first is that of the scenario.
    Raises:
        InputError: two words say the same.
    """
    given = parse_settings(scenario.get("settings", ()))
    values: dict[str, Any] = {}
    if more_than is not None:
        values["decision.decision_boundary"] = more_than
    scenario["robots"] = several(scenario.get("robots"))[:1]
    if scenario.get("tiles") is not None and scenario.get("floor") is None:
        # Of the floor only the number of tiles is used: any number of tiles has this share.
        scenario["floor"] = source_of("random", 0.0)
    base = scenario_of(**scenario)
    refuse_without_effect(given, [base], "--set ")
    by_default = base.task.name == "fill_ratio"  # ``detection_study`` refuses other tasks
    if boundary_of is not None or (
        by_default and not ("decision.boundary_of" in given or _file_says_boundary(scenario))
    ):
        values["decision.boundary_of"] = boundary_of or "tiles"
    for name, option in (
        ("decision.decision_boundary", "--more-than"),
        ("decision.boundary_of", "--boundary-of"),
    ):
        if name in given and name in values:
            raise InputError(f"is also set by --set {name}; use one of them", field=option)
    return base.with_values(values)


def _file_says_boundary(scenario: ScenarioWords) -> bool:
    """Return whether the file of a scenario has the field ``decision.boundary_of``."""
    path = scenario.get("scenario")
    if path is None:
        return False
    return "boundary_of" in parsed_toml(read_text(path, "a scenario"), str(path)).get("decision", {})
