"""``vibroswarm calibrate``: compare recordings with simulations, and fit a simulation to them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from vibroswarm.cli.command_line import Option
from vibroswarm.cli.deliver import print_report, print_saved_file
from vibroswarm.cli.option_values import refuse
from vibroswarm.cli.options import Force, Json, OutFile
from vibroswarm.cli.progress import progress_bar
from vibroswarm.cli.scenario_options import scenario_named
from vibroswarm.cli.terminal import say
from vibroswarm.core.atomic_io import check_free, write_file
from vibroswarm.errors import named

Recordings = Annotated[Path, Option("folders of recordings (lab import)", "REAL")]


def compare(
    real: Annotated[Path, Option("folder of a recording", "REAL")],
    /,
    *simulated: Annotated[
        Path, Option("folder of a simulation, or of its imported log; several are shown side by side", "SIM")
    ],
    picture: Annotated[Path | None, Option("draw both side by side (.png, .svg, .pdf)")] = None,
    pictures: Annotated[
        Path | None, Option("draw one file per feature into DIR, and one of all", "DIR")
    ] = None,
    no_camera: Annotated[
        bool,
        Option(
            "take simulated positions as they are, not as the camera of SIM's scenario ([camera]) would see them"
        ),
    ] = False,
    json: Json = False,
) -> None:
    """Compare the samples of a recording with simulations of the same floor and settings; each run is a session.

    The paper's six similarities with their null values, and measures that discriminate.

    examples:
      vibroswarm calibrate compare lab simulated --json
      vibroswarm calibrate compare lab by-event-engine by-mujoco   # which simplification matters
    """
    from vibroswarm.calibrate.camera import RIGHT
    from vibroswarm.calibrate.real_vs_simulated import (
        compare,
        compare_several,
        write_comparison_picture,
        write_comparison_pictures,
    )
    from vibroswarm.documents.calibration import comparison_document, comparisons_document
    from vibroswarm.floors.io import check_suffix
    from vibroswarm.plots.picture import SUFFIXES
    from vibroswarm.recordings.recording import read_result

    # RIGHT is a camera without error. With None, ``compare`` uses the camera of SIM's scenario, or RIGHT if the
    # positions need no change, as those of two recordings (``camera_between``).
    camera = RIGHT if no_camera else None
    _refuse_twice(simulated, "SIM")
    if picture is not None:
        with named("--picture", of="--out"):
            check_suffix(picture, SUFFIXES)  # before the comparison, which takes seconds
    if len(simulated) > 1:
        for option, given in (("--picture", picture), ("--pictures", pictures)):
            refuse(given, option, "is for one simulation; give one SIM")
        results = {str(folder): read_result(folder) for folder in simulated}
        several = compare_several(read_result(real), results, camera=camera, name=str(real))
        print_report(comparisons_document(several), as_json=json)
        return
    recorded, simulation = read_result(real), read_result(simulated[0])
    comparison = compare(recorded, simulation, camera=camera)
    if picture is not None:
        write_comparison_picture(recorded, simulation, comparison, picture)
    if pictures is not None:
        refuse(pictures.is_file(), str(pictures), "is a file; give the name of a folder")
        write_comparison_pictures(recorded, simulation, comparison, pictures)
    print_report(comparison_document(comparison), as_json=json)


def _refuse_twice(folders: Sequence[Path], field: str) -> None:
    refuse(len({str(folder) for folder in folders}) < len(folders), field, "names a folder twice")


def figures(
    *folders: Annotated[Path, Option("folders of recordings or simulations", "DIR")],
    at: Annotated[
        float | None, Option("threshold for error rates (default: that of the first DIR)", "THETA")
    ] = None,
    json: Json = False,
) -> None:
    """Figures of one or more results (each run is a session) with 95 % intervals over sessions."""
    from vibroswarm.calibrate.session_statistics import figures_of
    from vibroswarm.documents.calibration import figures_document
    from vibroswarm.recordings.recording import read_result

    _refuse_twice(folders, "DIR")
    results = {str(folder): read_result(folder) for folder in folders}
    # One threshold for all results, because error rates depend on it.
    at = next(iter(results.values())).scenario.sensor.rms_threshold if at is None else at
    found = {folder: figures_of(result, at) for folder, result in results.items()}
    print_report(figures_document(found, at), as_json=json)


def bursts(
    *folders: Recordings,
    errors: Annotated[
        bool, Option("also standard errors, by leaving out one receiver at a time (minutes)")
    ] = False,
    json: Json = False,
) -> None:
    """Fit independent losses and bursts (Gilbert-Elliott, by receiver) to counts of received messages in recordings.

    Compares the gaps that both expect with those found. Takes about half a minute for an hour of five robots.

    example:
      vibroswarm calibrate bursts lab --errors
    """
    from vibroswarm.calibrate import message_loss
    from vibroswarm.recordings.recording import read_result

    windows = [one for folder in folders for one in message_loss.windows_of(read_result(folder))]
    message_loss.check_windows(windows, ", ".join(map(str, folders)), errors=errors)
    with progress_bar("fitting"):
        found = message_loss.compare_models(windows, errors=errors)
    print_report(found, as_json=json)


CANDIDATES = 4000
"""Default of ``--candidates``: that of ``fit_avoidance``, which takes long to import; a test compares them."""


def fit(
    *folders: Recordings,
    out: OutFile = None,
    force: Force = False,
    base: Annotated[str, Option("preset or scenario file with the robots' settings")] = "paper-empirical",
    settings: Annotated[
        Sequence[str], Option("set a field of the base; may be repeated", "FIELD=VALUE", name="--set")
    ] = (),
    folds: Annotated[bool, Option("hold out each session in turn and validate the fit on it")] = False,
    against: Annotated[
        Path | None, Option("with --folds: folder with sessions of another simulator", "SIM")
    ] = None,
    candidates: Annotated[int, Option("runs for fitting avoidance", low=200, high=200_000)] = CANDIDATES,
    json: Json = False,
) -> None:
    """Fit the robots (speeds, veer, avoidance, sensing, losses) to recordings.

    Their programmed settings (sample interval, leg times, decisions) come from --base.

    examples:
      vibroswarm calibrate fit lab --out mine.toml
      vibroswarm calibrate fit lab --folds --against authors
    """
    from vibroswarm.calibrate.cross_validation import folds as validated
    from vibroswarm.calibrate.dataset import dataset_of
    from vibroswarm.calibrate.fit import contradictions
    from vibroswarm.calibrate.fit import fit as fitted_to
    from vibroswarm.documents.fit import fit_document
    from vibroswarm.recordings.recording import read_result

    refuse(out is None and force, "--force", "has no effect without --out FILE")
    refuse(against is not None and not folds, "--against", "has no effect without --folds")
    if out is not None and not force:
        check_free(out)  # now, since the fit takes long
    scenario = scenario_named(base, settings)
    results = [read_result(folder) for folder in folders]
    for sentence in contradictions(results, scenario):
        say(f"Warning: {sentence}")
    dataset = dataset_of(results)
    # the sessions of another simulator, whose similarity to the held-out sessions is printed beside that of the fit
    other = None if against is None else dataset_of([read_result(against)])
    with progress_bar("fit") as progress:
        fitted = fitted_to(dataset, scenario, candidates=candidates, progress=progress)
    judged = []
    if folds:
        with progress_bar("folds") as progress:
            judged = validated(dataset, scenario, other, candidates=candidates, progress=progress)
    if out is not None:
        write_file(out, fitted.scenario.to_toml(), replace=force)
    print_report(fit_document(fitted, judged), as_json=json)
    print_saved_file(out, as_json=json)
