"""``vibroswarm evaluate tradeoff``: decision time against error over p_c and O_c, on shared motion.

p_c is the credible threshold: a robot decides when its belief in an answer exceeds it. O_c is the number of
observations that it must exceed to decide. The motion of each run is simulated once, and decisions are computed on it
for every pair of p_c and O_c.
"""

from __future__ import annotations

from typing import Annotated

from vibroswarm.cli.command_line import Option
from vibroswarm.cli.deliver import Destination, print_with_place, save_with_pictures
from vibroswarm.cli.options import Drawn, Simulated
from vibroswarm.cli.progress import say_compiling
from vibroswarm.cli.scenario_options import scenario_from
from vibroswarm.core.atomic_io import whole_folder
from vibroswarm.core.child_python import MOST_WORKERS
from vibroswarm.core.folders import REPORT


def tradeoff(
    *,
    thresholds: Annotated[tuple[float, ...], Option("p_c: how sure a robot must be to decide", "P,...")] = (
        0.7,
        0.8,
        0.9,
        0.95,
        0.98,
        0.99,
    ),
    observations: Annotated[tuple[int, ...], Option("O_c: how many observations it must have", "N,...")] = (
        0,
        50,
        100,
        200,
        300,
        400,
        600,
    ),
    runs: Annotated[int, Option("runs")] = 300,
    workers: Annotated[int, Option("threads", low=1, high=MOST_WORKERS)] = 2,
    scenario: Simulated,
    output: Drawn,
) -> None:
    """Decision time against error for each credible threshold and minimum of observations, by replay."""
    from vibroswarm.documents.tradeoff import tradeoff_document
    from vibroswarm.study.summary import write_table
    from vibroswarm.study.tradeoff import tradeoff as computed

    made = scenario_from(scenario)
    settings = (made.hash, scenario.seed, runs, list(thresholds), list(observations))
    destination = Destination(output, "evaluate tradeoff", *settings, at_once=False)
    say_compiling()
    found = computed(made, scenario.seed, runs, thresholds, observations, workers=workers)
    document = tradeoff_document(found)
    if output.out is not None:
        # replace=True even without --force: `claim` has accepted the folder.
        with whole_folder(output.out, replace=True) as part:
            files = write_table(found.curve, part / "tradeoff")
            (part / "scenario.toml").write_text(made.to_toml(), encoding="utf-8")
            save_with_pictures(document, output, part, destination.command, destination.work, files)
    print_with_place(document, output, REPORT)
