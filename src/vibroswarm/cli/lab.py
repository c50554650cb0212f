"""``vibroswarm lab``: recordings of real robots, imported, replayed, measured and exported."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Literal, cast, get_args

from vibroswarm.cli.command_line import Option, refuse
from vibroswarm.cli.deliver import claim, deliver, print_report, print_saved_file
from vibroswarm.cli.inspection import size
from vibroswarm.cli.options import Drawn, Force, Json, OutFile, Required, ScenarioOptions
from vibroswarm.cli.scenario_options import keywords_of, scenario_from
from vibroswarm.cli.terminal import say
from vibroswarm.core.atomic_io import check_free, write_file
from vibroswarm.errors import check_choice, named

if TYPE_CHECKING:
    from vibroswarm.recordings.read import Log
    from vibroswarm.scenario.scenario import Scenario

Folder = Annotated[Path, Option("folder of a recording (lab import)", "DIR")]


def import_logs(
    *logs: Annotated[
        Path, Option("one log per session, or folder of 'lab track', or of a log for each robot", "LOG")
    ],
    columns: Annotated[Path | None, Option("read any CSV with this column map (TOML)", "MAP")] = None,
    acceleration: Annotated[
        list[Path] | None,
        Option(
            "recorded acceleration, one CSV per session (robot,time_s,ax,ay,az), from which energies are computed"
        ),
    ] = None,
    any_floor: Annotated[bool, Option("continue if the floor does not fit the logs")] = False,
    scenario: ScenarioOptions,
    output: Required,
) -> None:
    """Read logs of sessions (one file each) of the same robots on one floor, into a folder that is read as a result.

    Threshold and sample interval are inferred from the logs unless options set them; state how robots decide.

    examples:
      vibroswarm lab import day1.csv day2.csv --floor world.txt --tiles 5x5 --out lab
      vibroswarm lab import camera.csv --columns columns.toml --floor world.txt --tiles 5x5 --out lab
      vibroswarm lab import tracked-1 tracked-2 --floor world.txt --tiles 5x5 --out lab
    """
    from vibroswarm.recordings.assemble_recording import recording_of
    from vibroswarm.report.recording import of_import, write_pages
    from vibroswarm.study.options import check_one_floor, stated_fields

    made = scenario_from(scenario)
    check_one_floor(made, **keywords_of(scenario))
    stated = stated_fields(**keywords_of(scenario))
    read, computed, files = _logs_of(logs, columns, acceleration, made)
    claim(output, "lab import", made.hash, stated, any_floor, files)
    floor = made.floor_for(0, 0)  # seed and run do not matter: the floor is not random
    with named("--floor", of="floor"):
        recording = recording_of(read, floor, made, stated, any_floor=any_floor)
    recording.write_into(output.out)
    pages = write_pages(recording, output.out)
    deliver(of_import(recording, computed), output, page=pages[0], is_result=True)


def _logs_of(
    paths: Sequence[Path],
    columns: Path | None,
    acceleration: Sequence[Path] | None,
    scenario: Scenario,
) -> tuple[list[Log], list[str], list[bytes]]:
    from vibroswarm.core.read_tables import files_of
    from vibroswarm.lab.acceleration import with_energies
    from vibroswarm.recordings.read import CAMERA_LOG, read_log

    logs, computed = with_energies([read_log(path, columns) for path in paths], scenario, acceleration)
    files = [file for path in paths for file in files_of(path, CAMERA_LOG)]
    more = [file for path in acceleration or () for file in files_of(path)]
    read = [*files, *([columns] if columns is not None else []), *more]
    contents = [path.read_bytes() for path in read]
    first: dict[bytes, Path] = {}
    for file, content in zip(files, contents, strict=False):  # of the logs, which come first
        if content in first:
            say(f"Warning: '{file}' is '{first[content]}' again; as two sessions they count as independent.")
        first.setdefault(content, file)
    return logs, computed, contents


def export(
    folder: Annotated[Path, Option("folder of a result or recording", "DIR")],
    /,
    *,
    out: Annotated[Path, Option("folder", "DIR")],
    force: Force = False,
) -> None:
    """Write the tables of a result (run --out) or recording as CSV."""
    from vibroswarm.recordings.recording import read_result, write_csv

    write_csv(read_result(folder), out, replace=force)
    print_saved_file(out)


def replay(
    folder: Folder,
    /,
    *,
    strategy: Annotated[tuple[str, ...], Option("strategies to replay", "A,B")] = (
        "none",
        "positive",
        "soft",
    ),
    settings: Annotated[
        Sequence[str],
        Option(
            "set a field of [sensor], [strategy] or [decision], such as decision.gate=own; may be repeated",
            "FIELD=VALUE",
            name="--set",
        ),
    ] = (),
    laws: Annotated[
        str | None,
        Option(
            "law of the sensor that robots know, of other sessions: file of lab threshold --law, or as inspect --laws",
            "FROM",
        ),
    ] = None,
    draws: Annotated[int, Option("draws of the lost packets", low=1)] = 200,
    seed: Annotated[int, Option("seed of the draws", "S", low=0)] = 1,
    json: Json = False,
) -> None:
    """Replay strategies on the energies of a recording: what each would have decided on these observations.

    Packets are lost at random, with the share that its log counts. If it counts none, all are heard, or those that the
    network of 'lab import --network' delivers. Strategies that read places get those of the recording, as if robots
    knew them.

    examples:
      vibroswarm lab replay lab --strategy none,positive,soft --set sensor.rms_threshold=1.4
      vibroswarm lab replay day2 --strategy places --laws day1.toml --set strategy.places.edge_reach_m=0.01
    """
    from vibroswarm.inspection.laws import law_named, with_law
    from vibroswarm.lab.replay import replay_strategies
    from vibroswarm.recordings.recording import Recording
    from vibroswarm.scenario.scenario import parse_settings
    from vibroswarm.study.options import chosen

    for name in strategy:
        chosen("strategy", name)  # refuses an unknown name
    recording = Recording.read(folder)
    scenario, warnings = recording.scenario, tuple[str, ...]()
    if laws is not None:
        recording, warnings = with_law(recording, law_named(laws, draws=0))
        scenario = recording.scenario
    scenario = scenario.with_values(parse_settings(settings))
    replays = replay_strategies(recording, scenario, strategy, draws, seed)
    print_report(replace(replays, warnings=warnings), as_json=json)


def threshold(
    folder: Folder,
    /,
    *,
    at: Annotated[float | None, Option("also report on this threshold", "THETA", low=0)] = None,
    out: OutFile = None,
    law: Annotated[
        Path | None,
        Option(
            "fit the law of the sensor and its error, and write it as a scenario (TOML): for inspect --laws and run "
            "--scenario (takes a minute)",
        ),
    ] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Recommend a threshold theta_E from recordings on a known floor, and say whether the floor is decidable with it.

    It is that of equal error; its errors stand beside those of the threshold in use. With
    several sessions, each is also judged by the threshold of the others. The scenarios of --out and --law have the
    threshold of --at, else that of equal error.

    examples:
      vibroswarm lab threshold lab --law law.toml       then: vibroswarm inspect other --laws law.toml
    """
    from vibroswarm.inspection.laws import law_of_recordings, law_table, write_law
    from vibroswarm.recordings.recording import Recording
    from vibroswarm.recordings.threshold import recommend

    refuse(law and law == out, "--law", "is also the file of --out; the law's scenario has the threshold too")
    for path in (out, law):
        if path is not None and not force:
            check_free(path)
    recording = Recording.read(folder)
    found = recommend(recording, at)
    written = round(found.chosen.value, found.chosen.decimals)
    scenario = recording.scenario.with_values({"sensor.rms_threshold": written})
    if law is not None:
        fitted = law_of_recordings([recording])
        write_law(fitted, scenario, law, replace=force)
        found = replace(found, law=law_table(fitted))
    if out is not None:
        write_file(out, scenario.to_toml(), replace=force)
    print_report(found, as_json=json)
    print_saved_file(out, f"sensor.rms_threshold = {written}: {found.chosen.rule}", as_json=json)
    print_saved_file(
        law,
        f"law of the sensor with its error; vibroswarm inspect ... --laws {quote(str(law))}",
        as_json=json,
    )


def spectrum(
    acceleration: Annotated[
        Path,
        Option("CSV with the columns robot, time_s, ax, ay, az (or a folder of them)", "FILE"),
    ],
    /,
    *,
    rate: Annotated[
        float | None, Option("readings per second (default: as the times say)", "HZ", low=1)
    ] = None,
    signal_ms: Annotated[float, Option("part of each stop that is used, its end", "MS", low=1)] = 500.0,
    stop_s: Annotated[
        float | None, Option("cut a recording without pauses into pieces of this length", "S", low=0.01)
    ] = None,
    unit: Annotated[Literal["m/s2", "mm/s2", "g"], Option("of the acceleration")] = "m/s2",
    axis: Annotated[
        Literal["magnitude", "x", "y", "z"] | None,
        Option(
            "what spectra are of (default: the magnitude; without gravity in the readings the strongest axis)"
        ),
    ] = None,
    by: Annotated[str, Option("groups with spectra of their own: robot, tile, time", "A,B")] = "robot",
    size: Annotated[
        tuple[float, ...], Option("width and height of the surface, m (default 1x1)", "WxH", read=size)
    ] = (1.0, 1.0),
    tiles: Annotated[str, Option("rows and columns of tiles", "RxC")] = "5x5",
    output: Drawn,
) -> None:
    """At which frequencies a surface vibrates, by robot, tile and time.

    A sample is what a robot takes it from: the last readings of each of its stops, between pauses of the recording (or
    by a column `sample`, or of pieces, --stop-s). Columns `x_m` and `y_m` say where. One axis is enough. Lines
    have 95 % intervals, and say which frequencies the rate would fold onto them.

    examples:
      vibroswarm lab spectrum acceleration.csv --by robot,time
      vibroswarm lab spectrum acceleration.csv --axis z --by tile --out spectrum
    """
    from vibroswarm.floors.io import parse_tiles
    from vibroswarm.lab.spectrum import Group, spectra_frame, spectra_of

    groups = tuple(part.strip() for part in by.split(",") if part.strip())
    for group in groups:
        check_choice(group, "--by", get_args(Group))
    claim(
        output,
        "lab spectrum",
        str(acceleration),
        rate,
        signal_ms,
        stop_s,
        unit,
        axis,
        by,
        size,
        tiles,
    )
    found = spectra_of(
        acceleration,
        rate_hz=rate,
        signal_ms=signal_ms,
        stop_s=stop_s,
        unit=unit,
        axis=axis,
        by=cast(tuple[Group, ...], groups),
        size_m=(size[0], size[1]),
        tiles=parse_tiles(tiles),
    )
    deliver(found, output, {"spectra": spectra_frame(found)})
