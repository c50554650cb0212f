"""A scenario from the words of the command line: a preset or file, changed by options.

Each function takes the options of a command as keywords, so that Python makes the same scenario with the same words::

    scenario_of(preset="text", floor="diagonal:0.46", robots=8, settings=["run.t_end_s=600"])

``warnings_of`` lists valid settings that are probably mistakes.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final, TypedDict, Unpack

from vibroswarm import strategies, tasks
from vibroswarm.core.numbers import listed
from vibroswarm.errors import InputError, nearest, shown
from vibroswarm.floors.floor import sides_inside
from vibroswarm.floors.io import check_threshold, is_picture, parse_tiles
from vibroswarm.floors.source import family, fields_of_file, is_generated, resolve
from vibroswarm.observation.measured_csv import read_energies
from vibroswarm.scenario import plugins
from vibroswarm.scenario.change_fields import change_warnings
from vibroswarm.scenario.fault_fields import OF_ANY_SENSOR, OF_TWO_KINDS, SINCE
from vibroswarm.scenario.presets import preset_names
from vibroswarm.scenario.scenario import Scenario, parse_settings, preset, value_of
from vibroswarm.strategies.place_map import WITH_MAP


class ScenarioWords(TypedDict, total=False):
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


def scenario_of(**words: Unpack[ScenarioWords]) -> Scenario:
    """Return the scenario that the words describe.

    The base is the scenario of ``preset`` or ``scenario``, or else the preset "paper". Other words such as ``floor``
    change its fields; the fields of ``settings`` override these.

    Raises:
        InputError: a word or field is wrong.
    """
    base = base_of(**words)
    return base.with_values(values_of(base, **words))


def base_of(**words: Unpack[ScenarioWords]) -> Scenario:
    """Return the scenario of which the words change fields.

    Raises:
        InputError: there are two, or it is wrong.
    """
    named, file = words.get("preset"), words.get("scenario")
    if named and file:
        raise InputError("conflicts with --preset; use one of them", field="--scenario")
    return Scenario.read(file) if file else preset(named or "paper")


def scenario_named(name: str, settings: Sequence[str] = (), field: str | None = None) -> Scenario:
    """Return the scenario of a preset or file, with fields set by ``settings``.

    Args:
        field: what names it, for messages.
    Raises:
        InputError: there is neither such a preset nor such a file, or a field or value is wrong.
    """
    if name in preset_names():
        base = preset(name)
    elif Path(name).is_file():
        base = Scenario.read(name)
    else:
        raise InputError(
            f"'{name}' is neither a file nor a preset{nearest(name, preset_names())} (there are "
            f"{', '.join(preset_names())})",
            field=field,
        )
    return base.with_values(parse_settings(settings))


NEEDS: Final = {
    "robot.misalignment_drift_samples": ["robot.misalignment_drift"],
    "faults.stuck_class": ["faults.stuck"],
    **{f"faults.{name}": ["faults.biased"] for name in (*OF_TWO_KINDS, *OF_ANY_SENSOR)},
    **{
        f"faults.{since}": [f"faults.{kind}" for kind in SINCE if SINCE[kind] == since]
        for since in SINCE.values()
    },
}
"""Fields that have an effect only if another one, or one of several, is set."""
OF_PLACES: Final = re.compile(r"odometry\..*|localisation\.(?!method$).*|rays\.noise_m")
"""Fields by which robots find their places."""
CHOOSES_PLACES: Final = ("strategy.name", "localisation.method")
"""Fields that say whether they do."""


def _may_revise(scenario: Scenario) -> bool:
    loaded = strategies.known().get(scenario.strategy.name)
    return loaded is None or loaded.revises


def refuse_without_effect(
    fields: Iterable[str], scenarios: Iterable[Scenario], option: str = "", beside: Iterable[str] = ()
) -> None:
    """Refuse fields that have no effect in any of the scenarios, as what they belong to is not selected, or off.

    Args:
        fields: dotted names. option: what a message has before the name, such as "--set ".
        beside: fields that another option sets.
    Raises:
        InputError: there is such a field.
    """
    fields, scenarios = list(fields), list(scenarios)
    stated = {*fields, *beside}
    choices = [choice for scenario in scenarios for choice in scenario.choices]
    for field in fields:
        needed = NEEDS.get(field)
        # A fault that is set to 0, as in the first of several runs, is no mistake.
        if needed and not any(
            name in stated or value_of(each, name) for name in needed for each in scenarios
        ):
            raise InputError(
                f"has no effect without {listed(needed, 'or')}; set it too, or leave this out",
                field=option + field,
            )
        if OF_PLACES.fullmatch(field) and all(each.place_method == "true" for each in scenarios):
            raise InputError(
                'has no effect on robots that estimate no places; set localisation.method = "mixture", or leave this '
                "out",
                field=option + field,
            )
        if field == "decision.revise" and not any(_may_revise(each) for each in scenarios):
            raise InputError(
                "has no effect: the strategy never revises a decision by it; use one that does, such as soft, forget, "
                "reset, fading or dirichlet_soft, or leave this out",
                field=option + field,
            )
        kind, *path = field.split(".")
        names = {choice.selected for choice in choices if choice.kind == kind}
        if len(path) > 1 and names and path[0] not in names:
            raise InputError(
                f"has no effect: {plugins.field_of(kind)} is {listed(map(shown, sorted(names)))}; set it to "
                f"{shown(path[0])}, or leave this out",
                field=option + field,
            )


def stated_fields(**words: Unpack[ScenarioWords]) -> list[str]:
    """Return the names of the fields that --set and --strategy state, and that logs therefore do not decide.

    No other option states a field that can be inferred from logs, except --preset and --scenario, whose values are
    replaced by inferred ones.
    """
    stated = [*parse_settings(words.get("settings", ()))]
    return stated + (["strategy.name"] if words.get("strategy") is not None else [])


def check_one_floor(made: Scenario, /, **words: Unpack[ScenarioWords]) -> None:
    """Refuse a recording without its floor, or with a random one: its robots were on one real floor.

    A random floor that all runs share (``redraw = "study"``) is refused too: it depends on the seed of a simulation.
    The floor of a preset is that of a simulation.

    Args:
        made: the scenario that the words describe. words: of which ``floor`` or ``scenario`` must state the floor.
    Raises:
        InputError: neither is given; or the floor of the scenario, or its change, is random.
    """
    if words.get("floor") is None and words.get("scenario") is None:
        raise InputError("is required: on which floor were the robots?", field="--floor")
    if made.change.is_random:
        raise InputError(
            "is random, but a recording's floor changed as it did; state the tiles", field="change"
        )
    if made.floor.is_named and is_generated(made.floor.source):
        raise InputError("is random, but a recording has one floor; give its file", field="--floor")


def values_of(base: Scenario, **words: Unpack[ScenarioWords]) -> dict[str, Any]:
    """Return the values of the fields that words set, by dotted names such as ``swarm.robots``.

    If a value is user code (FILE.py:NAME), the file is loaded.

    Args:
        base: the scenario whose fields are set. Its random floor is used if ``tiles`` is given without ``floor``, and
            its numbers of rows and columns if ``floor`` names a random floor and ``tiles`` is not given.
    Raises:
        InputError: a value is wrong.
    """
    values: dict[str, Any] = {}
    floor, tiles = words.get("floor"), words.get("tiles")
    settings = parse_settings(words.get("settings", ()))
    threshold = _image_threshold(floor, words.get("image_threshold"), settings)
    if floor is not None or tiles is not None:
        values |= _floor_values(base, floor, tiles, threshold)
    if threshold is not None:
        values["floor.image_threshold"] = threshold
    robots = _the_one(words.get("robots"), "--robots")
    if robots is not None:
        values["swarm.robots"] = robots
    for kind in ("strategy", "network", "task"):
        name = _the_one(words.get(kind), f"--{kind}")
        if name is not None:
            values[f"{kind}.name"] = chosen(kind, name)
    if (energies := words.get("energies")) is not None:
        vibrating, still = read_energies(energies)
        values |= {
            "sensor.model": "energies",
            "sensor.vibrating_energies": vibrating,
            "sensor.still_energies": still,
        }
    for kind in plugins.KINDS:  # user code may also be named by --set, as in strategy.name=FILE.py:NAME
        field = plugins.field_of(kind)
        if plugins.is_code(settings.get(field)):
            settings[field] = chosen(kind, settings[field])
    values |= settings  # --set overrides other options
    return values


def several(value: Any) -> tuple[Any, ...]:
    """Return the values of a word, of which there may be several, one or none."""
    if isinstance(value, Sequence) and not isinstance(value, str):
        return tuple(value)
    return () if value is None else (value,)


def _the_one(value: Any, option: str) -> Any:
    """Return the value of an option that may hold several, but only one here; None if it holds none."""
    values = several(value)
    if len(values) > 1:
        raise InputError(f"{','.join(map(str, values))}: give one value here", field=option)
    return values[0] if values else None


def chosen(kind: str, text: str) -> str:
    """Check the name of a strategy, network, task or motion source, and return it as scenarios and results store it.

    Args:
        kind: "strategy", "network", "task" or "motion".
        text: a known name, or FILE.py:NAME, which is loaded and returned with the hash of its code.
    Raises:
        InputError: the name is unknown, or the file cannot be loaded.
    """
    if plugins.is_code(text):
        return str(plugins.load_file(kind, text).code)
    if kind == "motion":
        import vibroswarm.simulation  # noqa: F401  (registers the engines)
    known = plugins.known_for(kind, text)
    parts = [part.strip() for part in text.split(",")]
    if kind == "strategy" and len(parts) > 1 and all(part in known for part in parts):
        raise InputError(
            f"'{text}' names several strategies, and this command takes one; to compare them: "
            f"vibroswarm evaluate --strategy {','.join(parts)}",
            field="--strategy",
        )
    if text not in known:
        names = [*known, "grid"] if kind == "method" else known  # --method takes a grid too
        raise InputError(
            f"unknown {kind} '{text}'{nearest(text, names)} (known: {', '.join(names)}; or FILE.py:NAME)",
            field=f"--{kind}",
        )
    return text


def _image_threshold(floor: str | None, given: Any, settings: dict[str, Any]) -> float | None:
    """Return the brightness from which tiles of the picture vibrate; None if no option sets it.

    Args:
        floor, given: of ``--floor`` and ``--image-threshold``. settings: of ``--set``, which override other options.
    Raises:
        InputError: it is no share, or is given without a picture.
    """
    name = "floor.image_threshold"
    field: str = "--image-threshold"
    if name in settings:
        field, given = name, settings[name]
        check_threshold(given, field)
    if given is not None and (floor is None or not is_picture(floor)):
        raise InputError("applies to a picture; add --floor FILE.png", field=field)
    return None if given is None else float(given)


def _floor_values(
    base: Scenario, spec: str | None, tiles: str | None, threshold: float | None
) -> dict[str, Any]:
    """Return the fields of the floor that ``--floor`` and ``--tiles`` describe.

    A random floor is stored by name and size, a pattern by name. The tiles of a file are copied into the scenario, so
    that the scenario does not depend on the file; ``floor.rows`` and ``floor.columns``, which only random floors use,
    are not set then.

    Args:
        base: the scenario whose fields are set. Without ``--floor``, its random floor is used; without ``--tiles``, a
            random floor has the base's size.
        spec: the text of ``--floor``; None if it is not given.
        tiles: the text of ``--tiles``; None if it is not given.
        threshold: as ``read_tiles`` takes it.
    Raises:
        InputError: there is no such floor, or ``--tiles`` is wrong or does not apply to the floor.
    """
    size = None if tiles is None else parse_tiles(tiles)
    if spec is None:
        if not (base.floor.is_named and is_generated(base.floor.source)):
            raise InputError(
                "applies to a random floor, coordinate list or picture; add --floor", field="--tiles"
            )
        spec = base.floor.source
    if is_generated(spec) and size is None:
        size = (base.floor.rows, base.floor.columns)
    # A random floor is drawn when it is simulated: here, only the size of its grid counts.
    if is_generated(spec):
        grid, _ = resolve(spec, size)
        return {
            "floor.source": spec,
            "floor.tiles": None,
            "floor.values": None,
            "floor.rows": grid.shape[0],
            "floor.columns": grid.shape[1],
        }
    found = fields_of_file(spec, size, threshold)
    if family(spec) is not None:
        found["tiles"] = None
    return {f"floor.{name}": value for name, value in found.items()}


def warnings_of(scenario: Scenario) -> list[str]:
    """Return the warnings about a scenario, without a full stop."""
    return [
        *_relay_warnings(scenario),
        *_map_warnings(scenario),
        *change_warnings(scenario.change, _is_final(scenario)),
        *_anew_warnings(scenario),
    ]


def _anew_warnings(scenario: Scenario) -> list[str]:
    """Return a warning if robots withdraw their answers, and the task, whose code is loaded, does not ask again."""
    task = tasks.known().get(scenario.task.name)
    withdraws = getattr(scenario.strategy.params, "tells_anew", False)
    if not withdraws or task is None or task.is_asked_anew(scenario.task.params):
        return []
    return [
        "robots withdraw each answer but are asked only once; set task.changed.since = answer, or "
        "strategy.reset.tells_anew = false"
    ]


def _relay_warnings(scenario: Scenario) -> list[str]:
    """Return a warning if robots fail that relay messages, which the network does not know."""
    failing = [kind for kind in ("radio_dead", "battery_empty") if kind in scenario.faults.kinds]
    if scenario.network.name != "tree" or not failing:
        return []
    return [
        f"network tree: robots with faults.{' and faults.'.join(failing)} go on relaying others' messages"
    ]


def _map_warnings(scenario: Scenario) -> list[str]:
    """Return a warning if robots map a grid of which a part lies outside the arena, where no robot samples."""
    if scenario.strategy.name not in WITH_MAP:
        return []
    floor = scenario.floor_for(0, 0)  # whose size is that of all runs
    if sides_inside(floor.geometry, *scenario.arena.size_m) is None:
        return []
    return [
        f"the floor extends beyond the arena: '{scenario.strategy.name}' counts all tiles of the grid alike, but the "
        "right answer is that of the part inside"
    ]


def _is_final(scenario: Scenario) -> bool:
    """Return whether robots keep their decisions, which are asked for; False for a strategy that is not loaded."""
    known, asked = strategies.known().get(scenario.strategy.name), scenario.task
    if known is None or known.decides == "opinion" or asked.name == "changed" or asked.asks_number:
        return False
    return not (known.revises and scenario.decision.revise)
