"""A scenario or a study from the options of the command line, so that Python makes the same from the same keywords::

scenario_of(preset="text", floor="diagonal:0.46", robots=8, settings=["run.t_end_s=600"])
study_of(strategy=["none", "soft"], robots=[5, 10], vary=["strategy.soft.eta=1,2"], runs=1000)
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, TypedDict, Unpack

from vibroswarm.core.untrusted_files import parsed_toml, read_text
from vibroswarm.errors import InputError, nearest
from vibroswarm.floors.floor import sides_inside
from vibroswarm.floors.io import parse_tiles
from vibroswarm.floors.source import family, fields_of_file, is_generated, resolve, source_of
from vibroswarm.scenario import plugins
from vibroswarm.scenario.presets import preset_names
from vibroswarm.scenario.scenario import (
    Scenario,
    changes,
    parse_settings,
    parse_values,
    preset,
)
from vibroswarm.sensors.energies import read_energies
from vibroswarm.strategies.place_map import WITH_MAP
from vibroswarm.study.cells import LABEL
from vibroswarm.study.precision import Precision
from vibroswarm.study.spec import Study, with_fields

RUNS: Final = 100
"""Runs of each cell if neither ``runs`` nor ``until`` is given."""
FIELDS: Final = {
    "strategy": "strategy.name",
    "robots": "swarm.robots",
    "floor": "floor.source",
    "network": "network.name",
    "task": "task.name",
}
"""Options that name the value of a field."""


class ScenarioOptions(TypedDict, total=False):
    """What a scenario is made of, as on the command line; None, and an empty list, are as if left out."""

    preset: str | None
    scenario: Path | None
    """A file in TOML, in the place of a preset."""
    floor: str | None
    tiles: str | None
    image_threshold: float | None
    strategy: str | Sequence[str] | None
    robots: int | Sequence[int] | None
    network: str | None
    task: str | None
    energies: Path | None
    settings: Sequence[str]
    """Of ``--set``: texts FIELD=VALUE."""


def scenario_of(**options: Unpack[ScenarioOptions]) -> Scenario:
    """Return the scenario of ``preset`` or ``scenario``, changed by other options, and by ``settings`` last."""
    base = base_of(**options)
    return base.with_values(values_of(base, **options))


def base_of(**options: Unpack[ScenarioOptions]) -> Scenario:
    """Return the scenario of which options change fields."""
    name, file = options.get("preset"), options.get("scenario")
    if name and file:
        raise InputError("conflicts with --preset; use one of them", field="--scenario")
    return Scenario.read(file) if file else preset(name or "paper")


def scenario_named(name: str, settings: Sequence[str] = (), field: str | None = None) -> Scenario:
    """Return the scenario of a preset or file, with fields set by ``settings``."""
    if name not in preset_names() and not Path(name).is_file():
        raise InputError(
            f"'{name}' is neither a file nor a preset{nearest(name, preset_names())}", field=field
        )
    base = preset(name) if name in preset_names() else Scenario.read(name)
    return base.with_values(parse_settings(settings))


def stated_fields(**options: Unpack[ScenarioOptions]) -> list[str]:
    """Return the fields that --set and --strategy state, and that logs therefore do not decide."""
    strategy = [] if options.get("strategy") is None else ["strategy.name"]
    return [*parse_settings(options.get("settings", ())), *strategy]


def check_one_floor(made: Scenario, /, **options: Unpack[ScenarioOptions]) -> None:
    """Refuse a recording without its floor, or with a random one: its robots were on one real floor."""
    if options.get("floor") is None and options.get("scenario") is None:
        raise InputError("is required: on which floor were the robots?", field="--floor")
    if made.change.is_random or (made.floor.is_named and is_generated(made.floor.source)):
        raise InputError("is random, but a recording has one floor; give its file", field="--floor")


def values_of(base: Scenario, **options: Unpack[ScenarioOptions]) -> dict[str, Any]:
    """Return the values of the fields that options set, by dotted names; files of user code are loaded.

    ``base`` has the random floor if ``tiles`` is given alone, and the numbers of tiles if a random ``floor`` is.
    """
    floor, tiles = options.get("floor"), options.get("tiles")
    settings = parse_settings(options.get("settings", ()))
    threshold = settings.get("floor.image_threshold", options.get("image_threshold"))
    values: dict[str, Any] = {}
    if floor is not None or tiles is not None:
        values = _floor_values(base, floor, tiles, threshold)
    if threshold is not None:
        values["floor.image_threshold"] = threshold
    for option in ("robots", "strategy", "network", "task"):
        if (chosen_one := _the_one(options.get(option), option)) is not None:
            values[FIELDS[option]] = chosen_one if option == "robots" else chosen(option, chosen_one)
    if (energies := options.get("energies")) is not None:
        vibrating, still = read_energies(energies)
        values["sensor.model"] = "energies"
        values |= {"sensor.vibrating_energies": vibrating, "sensor.still_energies": still}
    for kind in plugins.KINDS:  # user code may also be named by --set, as in strategy.name=FILE.py:NAME
        if plugins.is_code(settings.get(field := plugins.field_of(kind))):
            settings[field] = chosen(kind, settings[field])
    values |= settings
    return values


def several(value: Any) -> tuple[Any, ...]:
    """Return the values of an option, of which there may be several, one or none."""
    if isinstance(value, Sequence) and not isinstance(value, str):
        return tuple(value)
    return () if value is None else (value,)


def _the_one(value: Any, option: str) -> Any:
    values = several(value)
    if len(values) > 1:
        raise InputError(f"{','.join(map(str, values))}: give one value here", field=f"--{option}")
    return values[0] if values else None


def chosen(kind: str, text: str) -> str:
    """Check a name, or load FILE.py:NAME, and return it as scenarios and results store it."""
    if plugins.is_code(text):
        return str(plugins.load_file(kind, text).code)
    if kind == "motion":
        import vibroswarm.simulation  # noqa: F401  (registers the engines)
    known = plugins.known_for(kind, text)
    if text not in known:
        raise InputError(
            f"unknown {kind} '{text}'{nearest(text, known)} (known: {', '.join(known)}; or FILE.py:NAME)",
            field=f"--{kind}",
        )
    return text


def _floor_values(
    base: Scenario, spec: str | None, tiles: str | None, threshold: float | None
) -> dict[str, Any]:
    """Return the fields of the floor; tiles of a file are copied, so that the scenario does not depend on it."""
    size = None if tiles is None else parse_tiles(tiles)
    if spec is None:
        if not (base.floor.is_named and is_generated(base.floor.source)):
            raise InputError(
                "applies to a random floor, coordinate list or picture; add --floor", field="--tiles"
            )
        spec = base.floor.source
    if is_generated(spec):
        rows, columns = size or (base.floor.rows, base.floor.columns)
        resolve(spec, (rows, columns))  # refuses a fill ratio that is no whole number of tiles
        drawn = {"floor.source": spec, "floor.tiles": None, "floor.values": None}
        return {**drawn, "floor.rows": rows, "floor.columns": columns}
    found = fields_of_file(spec, size, threshold)
    if family(spec) is not None:
        found["tiles"] = None
    return {f"floor.{name}": value for name, value in found.items()}


def warnings_of(scenario: Scenario) -> list[str]:
    """Return the warnings about a scenario: final decisions on changing floors, answers asked for once, a large map."""
    found, strategy, task = [], scenario.strategy.entry, scenario.task
    is_final = strategy.decides == "once" and not (strategy.revises and scenario.decision.revise)
    if scenario.change.is_given and is_final and task.name != "changed" and not task.asks_number:
        found.append(
            "the floor changes, and decisions are final; set decision.revise, with soft, forget or reset"
        )
    if getattr(scenario.strategy.params, "tells_anew", False) and not task.entry.is_asked_anew(task.params):
        found.append("robots withdraw each answer but are asked only once; set task.changed.since = answer")
    if scenario.strategy.name in WITH_MAP:
        floor = scenario.floor_for(0, 0)  # whose size is that of all runs
        if sides_inside(floor.geometry, *scenario.arena.size_m) is not None:
            found.append("the floor extends beyond the arena: maps count all tiles of the grid alike")
    return found


def study_of(
    *files: Path,
    vary: Sequence[str] = (),
    runs: int | None = None,
    until: str | None = None,
    figure: str | None = None,
    max_runs: int | None = None,
    seed: int | None = None,
    motion: str | None = None,
    **scenario: Unpack[ScenarioOptions],
) -> Study:
    """Return the study of a file, or that of a scenario: its base, the varied fields, and the number of runs.

    Args:
        files: a study, or several scenarios side by side, in place of all other options but ``runs``.
        vary: texts FIELD=A,B; several strategies or numbers of robots also vary.
        until, figure, max_runs: runs are added until the figure's interval is this narrow; not with ``runs``.
    Raises:
        InputError: options conflict, or a name, field or value is wrong.
    """
    if files:
        others = {**scenario, "vary": vary, "until": until, "seed": seed, "motion": motion}
        if given := [name for name, value in others.items() if value or value == 0]:
            name = "set" if given[0] == "settings" else given[0].replace("_", "-")
            raise InputError("is not for a study file, which says what is simulated", field=f"--{name}")
        study = Study.read(files[0]) if len(files) == 1 else _side_by_side(files)
        return study if runs is None else study.with_runs(runs)
    varied = _varied(vary)
    for option in ("strategy", "robots"):
        if len(values := several(scenario.get(option))) > 1:
            varied[FIELDS[option]] = [v if option == "robots" else chosen(option, v) for v in values]
            scenario[option] = values[:1]
    precision = Precision.of(until, figure=figure, max_runs=max_runs) if until else None
    return Study(
        base=_base_beside(varied, scenario),
        vary={"grid": varied} if varied else {},
        runs=RUNS if runs is None and precision is None else runs,
        until=precision,
        seed=1 if seed is None else seed,
        motion=chosen("motion", motion or "event"),
        folder=Path(),  # floor files that options name are relative to the current folder
    )


def _side_by_side(files: Sequence[Path]) -> Study:
    """Return the study of several scenarios, given by files or names of presets, which label the cells."""
    scenarios = [scenario_named(str(file)) for file in files]
    base = scenarios[0]
    points = [
        {LABEL: str(file), **{k: v for k, v in changes(one, base).items() if v is not None}}
        for file, one in zip(files, scenarios, strict=True)
    ]
    study = Study(base, {"list": points})
    for cell, scenario in zip(study.cells, scenarios, strict=True):
        if cell.scenario != scenario:
            raise InputError(f"leaves out a field that '{files[0]}' sets; give it first", field=cell.name)
    return study


def _base_beside(varied: dict[str, list[Any]], scenario: ScenarioOptions) -> dict[str, Any]:
    """Return the base of a study, which may fit together only with the values that vary."""
    if "preset" in varied:
        return with_fields({}, values_of(preset("paper"), **scenario))
    try:
        return scenario_of(**scenario).model_dump(exclude_none=True)
    except InputError:
        if not varied:
            raise
        base = base_of(**scenario)
        return with_fields(base.model_dump(exclude_none=True), values_of(base, **scenario))


def _varied(texts: Sequence[str]) -> dict[str, list[Any]]:
    """Return the varied values by dotted field name, parsed from texts ``FIELD=A,B``; user code is loaded."""
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
    more_than: float | None = None, boundary_of: str | None = None, **scenario: Unpack[ScenarioOptions]
) -> Scenario:
    """Return the scenario of a detection; robots allow for their sensor's errors unless ``boundary_of`` is set."""
    given = parse_settings(scenario.get("settings", ()))
    scenario["robots"] = several(scenario.get("robots"))[:1]
    if scenario.get("tiles") is not None and scenario.get("floor") is None:
        scenario["floor"] = source_of(
            "random", 0.0
        )  # only the number of tiles counts, and all can have this share
    values: dict[str, Any] = {} if more_than is None else {"decision.decision_boundary": more_than}
    file = scenario.get("scenario")
    stated = {} if file is None else parsed_toml(read_text(file, "a scenario"), str(file)).get("decision", {})
    if boundary_of is not None or not ("decision.boundary_of" in given or "boundary_of" in stated):
        values["decision.boundary_of"] = boundary_of or "tiles"
    return scenario_of(**scenario).with_values(values)
