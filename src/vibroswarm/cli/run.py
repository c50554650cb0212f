"""``vibroswarm run``: one inspection, from a floor to a verdict."""

from __future__ import annotations

from vibroswarm.cli.deliver import claim, deliver
from vibroswarm.cli.options import Drawn, Simulated
from vibroswarm.cli.scenario_options import scenario_from
from vibroswarm.cli.terminal import progress_bar, say_compiling


def run(*, scenario: Simulated, output: Drawn) -> None:
    """Run one inspection: a swarm on a floor, from start to verdict.

    examples:
      vibroswarm run                                        the paper's setting, no feedback
      vibroswarm run --strategy soft --seed 2 --out first   save tables and page in 'first'
      vibroswarm run --floor diagonal:0.46 --robots 8
      vibroswarm run --floor random:0.08 --set decision.decision_boundary=0.03 --set decision.boundary_of=tiles
    """
    from vibroswarm.run_page.write import why_no_page, write_run_page
    from vibroswarm.simulation import simulate
    from vibroswarm.study.options import chosen

    wanted, out = scenario_from(scenario), output.out
    motion = chosen("motion", scenario.motion or "event")
    seed = 1 if scenario.seed is None else scenario.seed
    claim(output, "run", wanted.hash, seed, motion)
    say_compiling()
    with progress_bar("simulating") as progress:
        # Only the page needs the poses between samples.
        result = simulate(wanted, seed, runs=1, motion=motion, poses=out is not None, progress=progress)
    has_page = why_no_page(result) is None
    if out is not None:
        result.write_into(out)
        if has_page:
            write_run_page(result, out / "run.html")
    deliver(result, output, page="run.html" if has_page else "report.html", is_result=True)
