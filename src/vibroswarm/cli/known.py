"""``vibroswarm list`` and ``check``: what a scenario may name, and whether code of your own keeps its contract."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from vibroswarm.cli.command_line import Option
from vibroswarm.cli.deliver import print_report
from vibroswarm.cli.options import Json
from vibroswarm.errors import InputError, check_choice, nearest

KINDS: Final = {
    "strategies": "strategy",
    "networks": "network",
    "sensors": "sensor",
    "motions": "motion",
    "tasks": "task",
    "presets": "preset",
}
"""Kinds of names, with the singular."""


def known(
    kind: Annotated[str, Option("strategies, networks, sensors, motions, tasks, presets or floors", "KIND")],
    /,
    *,
    json: Json = False,
) -> None:
    """List what a scenario may name: strategies, networks, sensors, sources of motion, tasks, presets or floors.

    example:
      vibroswarm list strategies
    """
    check_choice(kind, "KIND", [*KINDS, "floors"])
    if kind == "floors":
        from vibroswarm.cli.floors import report_of
        from vibroswarm.floors.difficulty import measure
        from vibroswarm.floors.source import NAMES, pattern

        print_report(report_of({name: measure(pattern(name)) for name in NAMES}), as_json=json)
    else:
        import polars as pl

        from vibroswarm.report.report import Report, Table

        abouts = _abouts(KINDS[kind])
        frame = pl.DataFrame({"name": list(abouts), "about": list(abouts.values())})
        print_report(Report(kind.capitalize(), (), {kind: Table(frame)}), as_json=json)


def _abouts(kind: str) -> dict[str, str]:
    import vibroswarm.simulation  # noqa: F401  (registers the engines)
    from vibroswarm.scenario import plugins
    from vibroswarm.scenario.presets import describe, preset_names

    if kind == "preset":
        return {name: describe(name) for name in preset_names()}
    plugins.load_installed(kind)
    return {name: one.about for name, one in plugins.KINDS[kind].known().items()}


def check(
    name: Annotated[str, Option("FILE.py:NAME, or a known name", "NAME")],
    /,
    *,
    kind: Annotated[
        Literal["strategy", "network", "task", "sensor", "motion"] | None,
        Option("{names}, if several have that name", "KIND"),
    ] = None,
    json: Json = False,
) -> int:
    """Check a strategy, network, task, sensor or motion source.

    It must compile, repeat, give the same results in another process in plain Python, and return what it should.
    Its kind is detected. The exit code is 1 if a check fails; one that only warns does not count as failed.

    examples:
      vibroswarm check voter.py:voter
      vibroswarm check soft
      vibroswarm check event
    """
    import polars as pl

    from vibroswarm.report.report import Report, Table
    from vibroswarm.testing import CHECKS

    kind_found, known_name = _kind_and_name(kind, name)
    findings = CHECKS[kind_found](known_name)
    states = ["ok" if one.holds else "note" if one.is_warning else "FAIL" for one in findings]
    checks = [f"{one.what}: {one.why}" if one.why else one.what for one in findings]
    frame = pl.DataFrame({"state": states, "check": checks})
    verdict = "fails" if "FAIL" in states else "passes"
    answer = f"'{known_name}' {verdict}: {states.count('ok')} of {len(states)} checks hold."
    print_report(Report(f"Checks of {known_name}", (answer,), {"checks": Table(frame)}), as_json=json)
    return int("FAIL" in states)


def _kind_and_name(kind: str | None, text: str) -> tuple[str, str]:
    """Return the kind of what ``text`` names, which is loaded if it is FILE.py:NAME, and its registered name."""
    import vibroswarm.simulation  # noqa: F401  (registers the engines)
    from vibroswarm.scenario import plugins
    from vibroswarm.testing import CHECKS

    if plugins.is_code(text):
        loaded = plugins.load_file(kind, text)
        return str(plugins.kind_of(loaded)), plugins.name_in(text)
    known = {one: plugins.known_for(one, text) for one in CHECKS if kind in (None, one)}
    kinds = [one for one, names in known.items() if text in names]
    if len(kinds) != 1:
        similar = nearest(text, [name for names in known.values() for name in names])
        problem = f"is a {' and a '.join(kinds)}; add --kind" if kinds else f"is not known{similar}"
        raise InputError(problem, field=text)
    return kinds[0], text
