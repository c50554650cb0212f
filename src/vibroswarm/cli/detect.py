"""``vibroswarm detect``: the robots and time needed for few misses and false alarms."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from vibroswarm.cli.command_line import Option
from vibroswarm.cli.deliver import deliver
from vibroswarm.cli.option_values import share
from vibroswarm.cli.options import Drawn, Parts, Seed, SwarmOptions, Tiles
from vibroswarm.cli.scenario_options import keywords_of
from vibroswarm.cli.studies import run_parts
from vibroswarm.errors import named


@dataclass(kw_only=True)
class Inspected(SwarmOptions):
    """A scenario of random floors, and its seed."""

    tiles: Tiles = None
    seed: Seed = 1


def detect(
    *,
    more_than: Annotated[
        float | None,
        Option(
            "the question: does more than this share of the tiles vibrate? (default: the scenario's)",
            "P%",
            read=share,
        ),
    ] = None,
    fills: Annotated[
        tuple[float, ...] | None,
        Option(
            "fill ratios of random floors (default: around the boundary)",
            "F,...",
            low=0,
            high=1,
        ),
    ] = None,
    error: Annotated[float, Option("tolerated probability of a miss (default 5%)", "P%", read=share)] = 0.05,
    false_alarms: Annotated[
        float | None,
        Option("tolerated probability of a false alarm (default: as --error)", "P%", read=share),
    ] = None,
    boundary_of: Annotated[
        Literal["tiles", "readings"] | None,
        Option(
            "tiles (default): robots allow for their sensor's errors; readings: they ignore them, as in the paper",
            "WHAT",
        ),
    ] = None,
    runs: Annotated[int, Option("runs per cell")] = 300,
    scenario: Inspected,
    execution: Parts,
    output: Drawn,
) -> None:
    """Estimate how often floors above a boundary are missed and floors below it raise a false alarm.

    Says how many robots, and how much time, make both rare enough. Without --robots, the scenario's number and two
    larger ones are tried.

    examples:
      vibroswarm detect                                             more than half? fill ratios 0.24 to 0.76
      vibroswarm detect --more-than 3% --tiles 10x10
      vibroswarm detect --robots 5,10,20 --error 10% --out out/detect
      vibroswarm detect --false-alarms 1% --boundary-of readings    robots that ignore their sensor's errors
    """
    from vibroswarm.study.detection import detection_of, detection_study
    from vibroswarm.study.options import detection_scenario

    base = detection_scenario(more_than, boundary_of, **keywords_of(scenario))
    with named("--fills", of="floor.source"):
        study = detection_study(base, scenario.robots, fills, runs, scenario.seed)
    runs_done = run_parts(study, execution, output, "detect")
    if runs_done is not None:
        detection = detection_of(runs_done, error, false_alarms)
        deliver(detection, output, detection.tables)
