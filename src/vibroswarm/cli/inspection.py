"""``vibroswarm inspect``: where a surface vibrates, how sure that is, and what would have been missed."""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

from vibroswarm.cli.command_line import Option, number
from vibroswarm.cli.options import Drawn, ScenarioOptions, Seed
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    from vibroswarm.floors.floor import Floor
    from vibroswarm.inspection.inspection import Inspection

DEFAULT: Final = "optimised-places"
"""Preset that is simulated by default: its robots walk to be mapped, and estimate their places."""


def size(text: str) -> tuple[float, float]:
    """Return width and height from a text such as ``1.2x0.8``.

    Raises:
        argparse.ArgumentTypeError: it is not two lengths.
    """
    parts = text.lower().split("x")
    if len(parts) != 2:
        raise argparse.ArgumentTypeError(f"'{text}' is not of the form WxH, such as 1.2x0.8")
    return number(parts[0], float, low=1e-3), number(parts[1], float, low=1e-3)


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
    bits: Annotated[bool, Option("use readings of 0 and 1 in the place of energies")] = False
    size: Annotated[
        tuple[float, ...] | None, Option("of a CSV: width and height of the surface, m", "WxH", read=size)
    ] = None
    spread_mm: Annotated[float, Option("of a CSV: standard deviation of its places", "MM", low=0)] = 0.0


def centimetres(text: str) -> tuple[float, ...]:
    """Return lengths in m from lengths in cm, such as ``5,10,20``."""
    return tuple(number(part, float, low=0.1, high=1e5) / 100.0 for part in text.split(","))


@dataclass(kw_only=True)
class Damage:
    """What damage must be found, and how surely."""

    damage: Annotated[
        bool, Option("ask for damage that is not bound to the grid (always asked without one)")
    ] = False
    sizes: Annotated[
        tuple[float, ...] | None,
        Option(
            "sides of squares that are scanned for, cm (default 7,10,14,20,28)", "CM,...", read=centimetres
        ),
    ] = None
    least_cm: Annotated[float, Option("side of the smallest damage that must be found", "CM", low=0.1)] = 10.0
    contrasts: Annotated[
        tuple[float, ...], Option("contrasts of damage that must be found; 1: as in the reference", "C,...")
    ] = (1.0, 0.75, 0.5)
    prior: Annotated[str, Option("probability of damage before any sample", "P%")] = "50%"
    risk: Annotated[str, Option("tolerated probability of damage after clearing", "P%")] = "5%"
    strict: Annotated[bool, Option("the risk must be tolerated at every place, not on average")] = False
    replicates: Annotated[int, Option("intact surfaces drawn for the scan's p-value")] = 999


def inspect(
    source: Annotated[
        Path | None, Option("result or recording (folder), or CSV of places and values", "FROM")
    ] = None,
    /,
    *,
    evidence: Evidence,
    damage: Damage,
    scenario: ScenarioOptions,
    seed: Seed = 1,
    output: Drawn,
) -> None:
    """Inspect a surface by place: where does it vibrate, and how sure is that?

    Reads a saved run, a recording, or a CSV with the columns robot, time_s, x_mm, y_mm and value (units: s, min, h; m,
    cm, mm, in); without any of them, a scenario is simulated (by default that of preset optimised-places). Only the
    samples count, not what the robots decided. With a grid of tiles, the answer is the probability of each tile.
    Without one, or with --damage, patches of any place are scanned for: is there damage, where, what would have been
    missed, and may one stop? With --out there is a certificate, one page that prints on one sheet.

    examples:
      vibroswarm inspect --floor random:0.48
      vibroswarm inspect first                                     a run that was saved with --out first
      vibroswarm inspect lab --run 1                               the second session of a recording
      vibroswarm inspect plate.csv --laws reference.csv --size 1x1 --tiles 5x5
      vibroswarm inspect plate.csv --laws reference.csv --size 1x1 --least-cm 15 --risk 1% --out plate
    """
    from vibroswarm.cli.deliver import deliver
    from vibroswarm.cli.out_folder import claim
    from vibroswarm.documents.damage import CERTIFICATE, write_certificate
    from vibroswarm.documents.inspection import inspection_document
    from vibroswarm.documents.saved import hash_of, refuse_other
    from vibroswarm.study.summary import write_table

    work = hash_of(str(source), evidence, damage, scenario, seed)
    claim(output, lambda folder: refuse_other(folder, "inspect", work))
    found = _inspected(source, evidence, damage, scenario, seed)
    if output.out is not None:
        for name, table in (("samples", found.samples.frame), ("map", found.maps), ("scores", found.scores)):
            if not table.is_empty():
                write_table(table, output.out / name)
        if found.assessment is not None:
            write_certificate(output.out / CERTIFICATE, found)
    deliver(inspection_document(found), output, "inspect", work)


def _inspected(
    source: Path | None, evidence: Evidence, damage: Damage, scenario: ScenarioOptions, seed: int
) -> Inspection:
    """Inspect what the options name."""
    from vibroswarm.cli.progress import say_compiling
    from vibroswarm.cli.scenario_options import scenario_from
    from vibroswarm.inspection.inspection import inspect as inspect_source

    known: dict[str, Any] = {
        "run": evidence.run, "laws": evidence.laws, "bits": evidence.bits, "seed": seed, **_asked(damage),
    }  # fmt: skip
    if source is None:
        _refuse(evidence.size is not None, "--size", "describes a CSV; give one")
        if scenario.preset is None and scenario.scenario is None:
            scenario = replace(scenario, preset=DEFAULT)
        made = scenario_from(scenario)
        say_compiling(scenario=made)
        return inspect_source(made, **known)
    given = scenario.preset or scenario.scenario or scenario.settings or scenario.strategy or scenario.robots
    _refuse(bool(given), str(source), "is inspected as it is; leave the options of a simulation out")
    if source.suffix != ".csv":
        _refuse(
            bool(scenario.floor or scenario.tiles),
            str(source),
            "has its own floor; leave --floor and --tiles out",
        )
        return inspect_source(source, **known)
    width, height = evidence.size or (None, None)
    size_m = None if width is None or height is None else (width, height)
    floor = _floor_of(scenario, size_m)
    return inspect_source(source, size_m=size_m, spread_m=evidence.spread_mm / 1000.0, floor=floor, **known)


def _asked(damage: Damage) -> dict[str, Any]:
    """Return the question about damage as keywords of ``inspect``; the question is None if it was not asked."""
    from vibroswarm.errors import share_from
    from vibroswarm.inspection.patches import SIZES_M
    from vibroswarm.inspection.scan import Question

    question = Question(
        least_m=damage.least_cm / 100.0,
        contrasts=damage.contrasts,
        prior=share_from(damage.prior, "--prior"),
        risk=share_from(damage.risk, "--risk"),
        strict=damage.strict,
    )
    is_asked = damage.damage or damage.strict or damage.sizes is not None or question != Question()
    return {
        "question": question if is_asked else None,
        "sides_m": damage.sizes or SIZES_M,
        "replicates": damage.replicates,
    }


def _refuse(wrong: bool, field: str, words: str) -> None:
    if wrong:
        raise InputError(words, field=field)


def _floor_of(
    scenario: ScenarioOptions, size_m: tuple[float, float] | None
) -> Floor | tuple[int, int] | None:
    """Return the floor of --floor, which says what vibrates; the rows and columns of --tiles; or None."""
    from vibroswarm.cli.scenario_options import scenario_from
    from vibroswarm.floors.grid_text import parse_tiles

    if scenario.floor is not None and size_m is not None:
        sized = [f"arena.width_m={size_m[0]!r}", f"arena.height_m={size_m[1]!r}"]
        return scenario_from(replace(scenario, settings=sized)).floor_for(0, 0)
    return None if scenario.tiles is None else parse_tiles(scenario.tiles)
