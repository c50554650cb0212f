"""``vibroswarm inspect``: where a surface vibrates, how sure that is, and what would have been missed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

from vibroswarm.cli.command_line import Option
from vibroswarm.cli.deliver import deliver
from vibroswarm.cli.option_values import number, pair_of, refuse, share
from vibroswarm.cli.options import PRESETS, Drawn, ScenarioOptions, Seed
from vibroswarm.cli.out_folder import claim
from vibroswarm.cli.progress import progress_bar, say_compiling
from vibroswarm.cli.scenario_options import keywords_of, scenario_from
from vibroswarm.errors import check_choice

if TYPE_CHECKING:
    from vibroswarm.floors.floor import Floor
    from vibroswarm.inspection.inspection import Inspection
    from vibroswarm.show.document import Document

DEFAULT: Final = "optimised-places"
"""Preset that is simulated by default: its robots walk to be mapped, and estimate their places."""


size = pair_of("x", "WxH, such as 1.2x0.8", float, low=1e-3)
"""Reads width and height, m."""


@dataclass(kw_only=True)
class SimulatedSurface(ScenarioOptions):
    """A scenario that is simulated if there are no samples."""

    preset: Annotated[str | None, Option(f"{{names}} (default {DEFAULT})", names=PRESETS)] = None


@dataclass(kw_only=True)
class Evidence:
    """Which samples are used, and what is known about them."""

    run: Annotated[int, Option("which run or session, from 0", low=0)] = 0
    laws: Annotated[
        str | None,
        Option(
            "what values mean: measured ones (CSV: kind,energy), folder of a recording, preset or scenario (default: "
            "the simulated scenario's; for a recording, fitted to its other sessions)",
            "FROM",
        ),
    ] = None
    bits: Annotated[bool, Option("use readings of 0 and 1 instead of energies")] = False
    size: Annotated[
        tuple[float, float] | None, Option("of a CSV: width and height of the surface, m", "WxH", read=size)
    ] = None
    spread_mm: Annotated[
        float, Option("of a CSV, or seen by a camera: standard deviation of places", "MM", low=0)
    ] = 0.0
    robot_spread: Annotated[
        float,
        Option(
            "of measured values (--laws CSV): standard deviation of how robots differ (default none)",
            "P%",
            read=share,
        ),
    ] = 0.0
    tile_spread: Annotated[
        float,
        Option(
            "of measured values: standard deviation of how places of 20 cm differ (default none)",
            "P%",
            read=share,
        ),
    ] = 0.0


def forms(text: str) -> tuple[Any, ...]:
    """Return forms from sizes in cm, such as ``5,10,disc14``; ``20x2`` is a crack along x, and one along y."""
    from vibroswarm.inspection.patches import Form

    found = []
    for part in text.lower().replace(" ", "").split(","):
        size = part.removeprefix("disc")
        sides = [
            number(side, float, low=0.1, high=1e5) / 100.0 for side in size.split("x", 1 - (size != part))
        ]
        if len(sides) == 1:
            found.append(Form(sides[0], sides[0], size != part))
        else:
            found += [Form(sides[0], sides[1]), Form(sides[1], sides[0])]
    return tuple(found)


@dataclass(kw_only=True)
class Damage:
    """What damage must be found, and how surely."""

    damage: Annotated[
        bool, Option("look for damage that need not follow the grid (always, without a grid)")
    ] = False
    sizes: Annotated[
        tuple[Any, ...] | None,
        Option(
            "sides of squares that are scanned for, cm; also discs (disc14) and cracks (30x5: length x width) "
            "(default 7,10,14,20,28)",
            "CM,...",
            read=forms,
        ),
    ] = None
    shapes: Annotated[
        tuple[str, ...],
        Option("shapes whose probability of detection is reported: square, disc, crack", "A,..."),
    ] = ("square",)
    looks: Annotated[
        int,
        Option(
            "number of looks at the scan, evenly spaced; false calls count over all looks", low=1, high=100
        ),
    ] = 1
    least_cm: Annotated[float, Option("side of the smallest damage that must be found", "CM", low=0.1)] = 10.0
    contrasts: Annotated[
        tuple[float, ...], Option("contrasts of damage that must be found; 1: as in the reference", "C,...")
    ] = (1.0, 0.75, 0.5)
    prior: Annotated[
        float, Option("probability of damage before any sample (default 50%)", "P%", read=share)
    ] = 0.5
    risk: Annotated[
        float, Option("tolerated probability of damage after clearing (default 5%)", "P%", read=share)
    ] = 0.05
    level: Annotated[
        float,
        Option(
            "tolerated share of false calls: intact surfaces that are called, also of --plan (default 5%)",
            "P%",
            read=share,
        ),
    ] = 0.05
    strict: Annotated[bool, Option("the risk must be tolerated at every place, not on average")] = False
    loss: Annotated[
        float,
        Option(
            "share of messages that a robot loses, if robots stop by themselves (default none)",
            "P%",
            read=share,
        ),
    ] = 0.0
    replicates: Annotated[int, Option("intact surfaces drawn for the scan's p-value")] = 999


@dataclass(kw_only=True)
class Planned:
    """What robots and time would buy, of a scenario."""

    plan: Annotated[
        tuple[int, ...] | None,
        Option(
            "do not inspect; report what this many robots would find (simulated scenario)", "N,...", low=1
        ),
    ] = None
    minutes: Annotated[
        tuple[float, ...], Option("with --plan: ends of the inspection", "MIN,...", low=0.001)
    ] = (5.0, 10.0, 20.0)
    want_cm: Annotated[
        float | None, Option("with --plan: size to be found in 90 % of inspections", "CM", low=0.1)
    ] = None
    plates: Annotated[
        int, Option("with --plan: drawn surfaces of each size, on which a90/95 depends", low=10)
    ] = 100
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
    scenario: SimulatedSurface,
    seed: Seed = 1,
    output: Drawn,
) -> None:
    """Inspect a surface by place: where does it vibrate, and how sure is that?

    Reads a saved run, a recording, or a CSV with the columns robot, time_s, x_mm, y_mm and value (units: s, min, h; m,
    cm, mm, in); without any of them, simulates a scenario (by default preset optimised-places). With a grid of tiles,
    the answer is the probability of each tile. Without one, or with --damage: is there damage, where, what would have
    been missed, and may one stop? With --out there is a certificate on one sheet.

    examples:
      vibroswarm inspect --floor random:0.48
      vibroswarm inspect first                                     a run that was saved with --out first
      vibroswarm inspect lab --run 1                               the second session of a recording
      vibroswarm inspect plate.csv --laws reference.csv --size 1x1 --tiles 5x5
      vibroswarm inspect plate.csv --laws reference.csv --size 1x1 --least-cm 15 --risk 1% --out plate
      vibroswarm inspect --plan 3,5,8 --minutes 5,10,20 --want-cm 10       how many robots, how long? (minutes)
    """
    from vibroswarm.documents.inspection import CERTIFICATE, write_certificate

    refuse(
        planned.plan is not None and source is not None,
        "--plan",
        "plans with a scenario; leave out the result or file",
    )
    _refuse_unread(planned, scenario, evidence, damage)
    claim(output, "inspect", str(source), evidence, damage, planned, scenario, seed)
    if planned.plan is not None:
        deliver(_plan_document(planned, damage, scenario, seed), output)
        return
    found = _inspected(source, evidence, damage, scenario, seed)
    has_certificate = found.assessment is not None
    certificate = (lambda folder: write_certificate(folder / CERTIFICATE, found)) if has_certificate else None
    tables = {
        "samples": found.samples.frame, "map": found.maps, "raster": found.rasters, "scores": found.scores,
    }  # fmt: skip
    written = {name: table for name, table in tables.items() if not table.is_empty()}
    deliver(found, output, written, certificate)


def _refuse_unread(planned: Planned, scenario: ScenarioOptions, *inspected: Evidence | Damage) -> None:
    """Refuse options of a plan without one, and what a plan does not read: of an inspection all but --level."""
    is_plan = planned.plan is not None
    for name in ("robots", "floor"):
        is_given = is_plan and getattr(scenario, name) is not None
        refuse(
            is_given, f"--{name}", "--plan gives the numbers of robots, and draws its surfaces; leave it out"
        )
    words = (
        "is not read by --plan; leave it out"
        if is_plan
        else "needs --plan, which asks what robots would find"
    )
    for options in inspected if is_plan else (planned,):
        for name, value in vars(options).items():
            is_given = name != "level" and value != getattr(type(options), name)
            refuse(is_given, f"--{name.replace('_', '-')}", words)


def _plan_document(planned: Planned, damage: Damage, scenario: ScenarioOptions, seed: int) -> Document:
    """Plan inspections of the scenario that the options name."""
    from vibroswarm.documents.damage import plan_document
    from vibroswarm.inspection.missed import SIDES_M, plan
    from vibroswarm.inspection.sources import ESTIMATED, TRUE_PLACES
    from vibroswarm.localisation.locate import is_estimated

    assert planned.plan is not None
    made = scenario_from(_with_default(scenario))
    damaged = max(planned.runs // 2, 1)  # inspections in which `plan` draws damage
    each = max(1, round(planned.plates / damaged))
    with progress_bar("plan") as progress:
        table = plan(
            made, planned.plan, [60.0 * end for end in planned.minutes], runs=planned.runs, seed=seed,
            each=each, level=damage.level, progress=progress,
        )  # fmt: skip
    want_m = None if planned.want_cm is None else planned.want_cm / 100.0
    plates, places = each * damaged * len(SIDES_M), ESTIMATED if is_estimated(made) else TRUE_PLACES
    source = {"scenario": made.hash, "seed": str(seed)}
    return plan_document(table, want_m, planned.runs, plates, source, places)


def _with_default(scenario: ScenarioOptions) -> ScenarioOptions:
    is_named = scenario.preset is not None or scenario.scenario is not None
    return scenario if is_named else replace(scenario, preset=DEFAULT)


def _inspected(
    source: Path | None, evidence: Evidence, damage: Damage, scenario: ScenarioOptions, seed: int
) -> Inspection:
    """Inspect what the options name."""
    from vibroswarm.inspection.inspection import inspect as inspect_source

    known: dict[str, Any] = {
        "run": evidence.run, "laws": evidence.laws, "bits": evidence.bits, "seed": seed, **_asked(damage),
        "spread_m": evidence.spread_mm / 1000.0,
        "spreads": (evidence.tile_spread, evidence.robot_spread),
    }  # fmt: skip
    is_csv = source is not None and source.suffix.lower() == ".csv"
    refuse(evidence.size is not None and not is_csv, "--size", "describes a CSV; give one")
    inspected: Any = source
    if source is None:
        inspected = scenario_from(_with_default(scenario))
        say_compiling()
    else:
        _refuse_of_simulation(source, scenario, is_csv=is_csv)
    if is_csv:
        known |= {"size_m": evidence.size, "floor": _floor_of(scenario, evidence.size)}
    with progress_bar("inspecting") as progress:
        return inspect_source(inspected, progress=progress, **known)


def _refuse_of_simulation(source: Path, scenario: ScenarioOptions, *, is_csv: bool) -> None:
    """Refuse options of a simulation beside a result or file, but those that describe the floor of a CSV."""
    of_file = ("floor", "tiles", "image_threshold")  # what a CSV may be told
    given = [value for name, value in keywords_of(scenario).items() if name not in of_file]
    refuse(any(given), str(source), "is inspected as it is; leave the options of a simulation out")
    has_floor = scenario.floor or scenario.tiles
    refuse(not is_csv and has_floor, str(source), "has its own floor; leave --floor and --tiles out")


def _asked(damage: Damage) -> dict[str, Any]:
    """Return the question about damage as keywords of ``inspect``; the question is None if it was not asked."""
    from vibroswarm.inspection.damage import SHAPES
    from vibroswarm.inspection.patches import SIZES_M
    from vibroswarm.inspection.stopping import Question

    question = Question(
        least_m=damage.least_cm / 100.0,
        contrasts=damage.contrasts,
        prior=damage.prior,
        risk=damage.risk,
        level=damage.level,
        strict=damage.strict,
        loss=damage.loss,
    )
    for shape in damage.shapes:
        check_choice(shape, "--shapes", SHAPES)
    return {
        "question": None if damage == Damage() else question,
        "sides_m": damage.sizes or SIZES_M,
        "replicates": damage.replicates,
        "looks": damage.looks,
        "shapes": damage.shapes,
    }


def _floor_of(
    scenario: ScenarioOptions, size_m: tuple[float, float] | None
) -> Floor | tuple[int, int] | None:
    """Return the floor of --floor, which says what vibrates; the rows and columns of --tiles; or None."""
    from vibroswarm.floors.io import parse_tiles

    if scenario.floor is not None and size_m is not None:
        sized = [f"arena.width_m={size_m[0]!r}", f"arena.height_m={size_m[1]!r}"]
        return scenario_from(replace(scenario, settings=sized)).floor_for(0, 0)
    return None if scenario.tiles is None else parse_tiles(scenario.tiles)
