"""``vibroswarm run``: one inspection, from a floor to a verdict."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from vibroswarm.cli.command_line import Option
from vibroswarm.cli.deliver import print_paragraph, print_with_place
from vibroswarm.cli.option_values import refuse
from vibroswarm.cli.options import Paged, Simulated
from vibroswarm.cli.out_folder import claim
from vibroswarm.cli.progress import progress_bar, say_compiling
from vibroswarm.cli.scenario_options import scenario_from

if TYPE_CHECKING:
    from vibroswarm.result import Result
    from vibroswarm.scenario.scenario import Scenario


def run(
    *,
    pictures: Annotated[
        bool, Option("also draw run.png, and maps.png and reports.png of robots that have some")
    ] = False,
    scenario: Simulated,
    output: Paged,
) -> None:
    """Run one inspection: a swarm on a floor, from start to verdict.

    examples:
      vibroswarm run                                        the paper's setting, no feedback
      vibroswarm run --strategy soft --seed 2 --out first   save tables and page in 'first'
      vibroswarm run --floor diagonal:0.46 --robots 8
      vibroswarm run --floor random:0.08 --set decision.decision_boundary=0.03 --set decision.boundary_of=tiles
    """
    from vibroswarm.documents.run import write_run_folder
    from vibroswarm.documents.saved import refuse_other_run
    from vibroswarm.result import code_files
    from vibroswarm.run_page.write import why_no_page
    from vibroswarm.study.options import chosen

    made, out = scenario_from(scenario), output.out
    refuse(pictures and out is None, "--pictures", "needs --out DIR, where the pictures are saved")
    motion = chosen("motion", scenario.motion)
    if out is not None:
        code_files([made], motion)  # refuses what cannot be saved, before anything is simulated
    # The older folder stays until the new one is complete and replaces it.
    claim(output, lambda folder: refuse_other_run(folder, made, scenario.seed, motion), at_once=False)
    # Only the page needs the poses between samples.
    result = _simulate(made, scenario.seed, motion, poses=out is not None)
    if out is not None:
        write_run_folder(result, out, pictures=pictures)
    why_not = why_no_page(result)
    print_with_place(result, output, "run.html" if why_not is None else None)
    if out is not None and why_not is not None and not output.json:
        print_paragraph(f"No page: {why_not}")


def _simulate(scenario: Scenario, seed: int, motion: str, poses: bool) -> Result:
    from vibroswarm.simulation import simulate

    say_compiling()
    with progress_bar("simulating") as progress:
        return simulate(scenario, seed, runs=1, motion=motion, poses=poses, progress=progress)
