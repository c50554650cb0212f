"""``vibroswarm list``: what a scenario may name."""

from __future__ import annotations

from typing import Annotated, Final

from vibroswarm.cli.command_line import Option
from vibroswarm.cli.deliver import print_report
from vibroswarm.cli.options import Json
from vibroswarm.errors import check_choice

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
