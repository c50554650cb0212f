"""``vibroswarm calibrate``: compare recordings with simulations, and fit a simulation to them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from vibroswarm.cli.command_line import Option, refuse
from vibroswarm.cli.deliver import claim, deliver, print_report, print_saved_file
from vibroswarm.cli.options import Drawn, Force, Json, OutFile
from vibroswarm.cli.scenario_options import scenario_named
from vibroswarm.cli.terminal import progress_bar, say
from vibroswarm.core.atomic_io import check_free, write_file

Recordings = Annotated[Path, Option("folders of recordings (lab import)", "REAL")]


def compare(
    real: Annotated[Path, Option("folder of a recording", "REAL")],
    simulated: Annotated[Path, Option("folder of a simulation, or of its imported log", "SIM")],
    /,
    *,
    output: Drawn,
) -> None:
    """Compare the samples of a recording with a simulation of the same floor and settings; each run is a session.

    The paper's six similarities with their null values, and measures that discriminate.

    examples:
      vibroswarm calibrate compare lab simulated --json
    """
    from vibroswarm.calibrate.compare import compare
    from vibroswarm.recordings.recording import read_result

    claim(output, "calibrate compare", str(real), str(simulated))
    results = read_result(real), read_result(simulated)
    deliver(compare(*results), output, sources=results)


CANDIDATES = 4000
"""Default of ``--candidates``: that of ``fit_avoidance``, which takes long to import."""


def fit(
    *folders: Recordings,
    out: OutFile = None,
    force: Force = False,
    base: Annotated[str, Option("preset or scenario file with the robots' settings")] = "paper-empirical",
    settings: Annotated[
        Sequence[str], Option("set a field of the base; may be repeated", "FIELD=VALUE", name="--set")
    ] = (),
    folds: Annotated[bool, Option("hold out each session in turn and validate the fit on it")] = False,
    candidates: Annotated[int, Option("runs for fitting avoidance", low=200, high=200_000)] = CANDIDATES,
    json: Json = False,
) -> None:
    """Fit the robots (speeds, veer, avoidance, sensing, losses) to recordings.

    Their programmed settings (sample interval, leg times, decisions) come from --base.

    examples:
      vibroswarm calibrate fit lab --out mine.toml
      vibroswarm calibrate fit lab --folds
    """
    from vibroswarm.calibrate.dataset import dataset_of
    from vibroswarm.calibrate.fit import contradictions
    from vibroswarm.calibrate.fit import fit as fitted_to
    from vibroswarm.calibrate.fit import folds as validated
    from vibroswarm.recordings.recording import read_result

    refuse(out is None and force, "--force", "has no effect without --out FILE")
    if out is not None and not force:
        check_free(out)  # now, since the fit takes long
    scenario = scenario_named(base, settings)
    results = [read_result(folder) for folder in folders]
    for sentence in contradictions(results, scenario):
        say(f"Warning: {sentence}")
    dataset = dataset_of(results)
    with progress_bar("fit") as progress:
        fitted = fitted_to(dataset, scenario, candidates=candidates, progress=progress)
    judged = []
    if folds:
        with progress_bar("folds") as progress:
            judged = validated(dataset, scenario, candidates=candidates, progress=progress)
    if out is not None:
        write_file(out, fitted.scenario.to_toml(), replace=force)
    print_report(fitted, as_json=json, judged=judged)
    print_saved_file(out, as_json=json)
