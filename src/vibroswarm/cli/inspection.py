"""``vibroswarm inspect``: where a surface vibrates, how sure that is, and what would have been missed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

from vibroswarm.cli.command_line import Option, number, pair_of, refuse, share
from vibroswarm.cli.deliver import claim, deliver
from vibroswarm.cli.options import Drawn, ScenarioOptions, Seed
from vibroswarm.cli.scenario_options import keywords_of, scenario_from
from vibroswarm.cli.terminal import progress_bar, say_compiling

if TYPE_CHECKING:
    from vibroswarm.floors.floor import Floor
    from vibroswarm.report.report import Report

DEFAULT: Final = "optimised-places"
"""Preset that is simulated by default: its robots walk to be mapped, and estimate their places."""

size = pair_of("x", "WxH, such as 1.2x0.8", float, low=1e-3)
"""Reads width and height, m."""


@dataclass(kw_only=True)
class Evidence:
    """Which samples are used, and what is known about them."""

    run: Annotated[int, Option("which run or session, from 0", low=0)] = 0
    laws: Annotated[
        str | None,
        Option("measured values (CSV), recording, preset or scenario", "FROM"),
    ] = None
    bits: Annotated[bool, Option("use readings of 0 and 1 instead of energies")] = False
    size: Annotated[
        tuple[float, float] | None, Option("of a CSV: width and height of the surface, m", "WxH", read=size)
    ] = None
    origin: Annotated[
        Literal["bottom-left", "top-left", "centre"],
        Option("of a CSV: where places count from"),
    ] = "bottom-left"
    spread_mm: Annotated[float, Option("of places in a CSV: standard deviation", "MM", low=0)] = 0.0
    robot_spread: Annotated[float, Option("of measured values, between robots", "P%", read=share)] = 0.0
    tile_spread: Annotated[
        float,
        Option("of measured values, between places of 20 cm", "P%", read=share),
    ] = 0.0


def sides(text: str) -> tuple[float | tuple[float, float], ...]:
    """Return sides from sizes in cm, such as ``5,10``; ``20x2`` is a rectangle along x, and one along y."""
    found: list[float | tuple[float, float]] = []
    for part in text.lower().replace(" ", "").split(","):
        each = [number(side, float, low=0.1, high=1e5) / 100.0 for side in part.split("x", 1)]
        found += each if len(each) == 1 else [(each[0], each[1]), (each[1], each[0])]
    return tuple(found)


@dataclass(kw_only=True)
class Damage:
    """What damage must be found, and how surely."""

    damage: Annotated[bool, Option("look for damage that need not follow the grid")] = False
    sizes: Annotated[
        tuple[Any, ...] | None,
        Option("squares, or 30x5 rectangles (default 7,10,14,20,28)", "CM,...", read=sides),
    ] = None
    least_cm: Annotated[float, Option("smallest side that must be found", "CM", low=0.1)] = 10.0
    contrasts: Annotated[
        tuple[float, ...], Option("contrasts that must be found", "C,...", low=0.01, high=1)
    ] = (1.0, 0.75, 0.5)
    prior: Annotated[float, Option("probability of damage before any sample", "P%", read=share)] = 0.5
    risk: Annotated[float, Option("tolerated probability after clearing", "P%", read=share)] = 0.05
    level: Annotated[float, Option("tolerated share of false calls", "P%", read=share)] = 0.05
    replicates: Annotated[int, Option("intact surfaces drawn for the p-value")] = 999


@dataclass(kw_only=True)
class Planned:
    """What robots and time would buy, of a scenario."""

    plan: Annotated[
        tuple[int, ...] | None,
        Option("do not inspect; report what this many robots would find", "N,...", low=1),
    ] = None
    minutes: Annotated[tuple[float, ...], Option("with --plan: ends", "MIN,...", low=0.001)] = (
        5.0,
        10.0,
        20.0,
    )
    want_cm: Annotated[
        float | None, Option("with --plan: size to be found in 90 % of inspections", "CM", low=0.1)
    ] = None
    plates: Annotated[int, Option("with --plan: drawn surfaces of each size", low=10)] = 100
    runs: Annotated[int, Option("with --plan: simulated inspections", low=4)] = 40


def inspect(
    source: Annotated[
        Path | None, Option("result or recording (folder), or CSV of places and values", "FROM")
    ] = None,
    /,
    *,
    evidence: Evidence,
    damage: Damage,
    planned: Planned,
    scenario: ScenarioOptions,
    seed: Seed = 1,
    output: Drawn,
) -> None:
    """Inspect a surface by place: where does it vibrate, and how sure is that?

    Reads a saved run, a recording, or a CSV (x_mm, y_mm, value); without any, simulates preset optimised-places. With
    a grid, each tile has a probability; without one: is there damage, and may one stop?

    examples:
      vibroswarm inspect first                             a run that was saved with --out first
      vibroswarm inspect plate.csv --laws reference.csv --size 1x1 --least-cm 15 --risk 1% --out plate
      vibroswarm inspect --plan 3,5,8 --minutes 5,10,20 --want-cm 10      how many robots?
    """
    from vibroswarm.inspection.inspection import inspect as inspect_source

    claim(output, "inspect", str(source), evidence, damage, planned, scenario, seed)
    if planned.plan is not None:
        refuse(source is not None, "--plan", "plans with a scenario; leave out the result or file")
        deliver(_plan(planned, damage, scenario, seed), output)
        return
    known: dict[str, Any] = {
        "run": evidence.run, "laws": evidence.laws, "bits": evidence.bits, "seed": seed, **_asked(damage),
        "spread_m": evidence.spread_mm / 1000.0, "spreads": (evidence.tile_spread, evidence.robot_spread),
        "size_m": evidence.size, "origin": evidence.origin,
    }  # fmt: skip
    inspected: Any = source
    if source is None:
        inspected = scenario_from(_with_default(scenario))
        say_compiling()
    else:
        is_csv = source.suffix.lower() == ".csv"
        of_csv = ("floor", "tiles", "image_threshold") if is_csv else ()
        given = [value for name, value in keywords_of(scenario).items() if name not in of_csv]
        refuse(any(given), str(source), "is inspected as it is; leave the options of a simulation out")
        known |= {"floor": _floor_of(scenario, evidence.size)}
    with progress_bar("inspecting") as progress:
        found = inspect_source(inspected, progress=progress, **known)
    tables = {"samples": found.samples.frame} | ({} if found.pooled is None else {"maps": found.maps})
    deliver(found, output, tables)


def _plan(planned: Planned, damage: Damage, scenario: ScenarioOptions, seed: int) -> Report:
    from vibroswarm.inspection.pod import plan
    from vibroswarm.report.inspection import plan_report

    wanted, ends_s = scenario_from(_with_default(scenario)), [60.0 * end for end in planned.minutes]
    each = max(1, round(2 * planned.plates / planned.runs))
    with progress_bar("plan") as progress:
        table = plan(
            wanted, planned.plan or (), ends_s, runs=planned.runs, seed=seed, each=each, level=damage.level,
            progress=progress,
        )  # fmt: skip
    want_m = None if planned.want_cm is None else planned.want_cm / 100.0
    setting = f"{planned.runs} simulated inspections, half of which give the threshold"
    return plan_report(table, want_m, setting, {"scenario": wanted.hash, "seed": str(seed)})


def _with_default(scenario: ScenarioOptions) -> ScenarioOptions:
    is_named = scenario.preset is not None or scenario.scenario is not None
    return scenario if is_named else replace(scenario, preset=DEFAULT)


def _asked(damage: Damage) -> dict[str, Any]:
    from vibroswarm.inspection.assessment import Question
    from vibroswarm.inspection.patches import SIZES_M

    question = Question(damage.least_cm / 100.0, damage.contrasts, damage.prior, damage.risk, damage.level)
    asked = None if damage == Damage() else question
    return {"question": asked, "sides_m": damage.sizes or SIZES_M, "replicates": damage.replicates}


def _floor_of(
    scenario: ScenarioOptions, size_m: tuple[float, float] | None
) -> Floor | tuple[int, int] | None:
    from vibroswarm.floors.io import parse_tiles

    if scenario.floor is not None and size_m is not None:
        sized = [f"arena.width_m={size_m[0]!r}", f"arena.height_m={size_m[1]!r}"]
        return scenario_from(replace(scenario, settings=sized)).floor_for(0, 0)
    return None if scenario.tiles is None else parse_tiles(scenario.tiles)
