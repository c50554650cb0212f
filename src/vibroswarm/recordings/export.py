"""Write results as logs in formats that ``log_readers`` reads (rugbot, webots), or as plain CSV tables.

All that a log contains of a simulated result is read back equal.

| format | contains | does not contain |
|---|---|---|
| rugbot | positions every 0.22 s to 0.1 micrometre (arena 1 m x 1 m), energy to 0.001, posterior, decision, counters to the ms; None where the result has no value | bits read and sent, headings, times of samples (those of the next 0.22 s), times of driving and turning |
| webots | samples after 5 s: time, position, energy to 1e-6, bit sent, posterior, counters; settings that are whole numbers | paths, headings, sessions without bits sent, strategies other than none, positive and soft |
| csv | every table of the result, one file per table | the additional tables of a recording (rows, tracks) |
"""  # noqa: E501

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.core.atomic_io import check_free, make_folder, whole_file, write_text
from vibroswarm.core.numbers import number
from vibroswarm.core.tables import csv_bytes
from vibroswarm.errors import InputError, check_flags, path_of, whole_number_of
from vibroswarm.motion.pose import pose
from vibroswarm.recordings.log_readers import FEEDBACK
from vibroswarm.recordings.recording import Recording
from vibroswarm.result import TABLES, Result

CAMERA_S: Final = 0.22
"""Duration of one loop of the camera, which logs the position of every robot."""
WRAP_MS: Final = 65536
"""Value at which the robots' counters start again from 0."""
MARKERS: Final = (10, 11, 6, 39, 14)
"""Markers of the study's robots, by number."""
_NOTHING: Final = ",None" * 9
"""The cells after the position in a tracking row."""


def write_rugbot(result: Result, path: str | Path, run: int = 0, *, replace: bool = False) -> None:
    """Write one run as a CSV file in the format of the study's robots.

    In that format a camera finds all robots in each of its loops (every 0.22 s). For each loop the file has a tracking
    row for every robot, and a row for each sample taken since the loop before, with the time of this loop and the place
    of the sample. (The study's robots hardly left it by then: half of the rows are within 0.6 mm of where they stood.)
    Decisions among more than two kinds of tile are left out, since 2 stands for undecided. Robots of a recording keep
    their numbers; those of a simulation are numbered from 1.

    Args:
        run: number of the run. replace: whether an existing file may be replaced.
    Raises:
        InputError: no such run, no segments, no energies, an arena that is not 1 m x 1 m, or ``path`` cannot be
            written.
        RunError: the disk is full or failed.
    """
    if result.scenario.arena.size_m != (1.0, 1.0):
        raise InputError("stores positions relative to the arena, which must be 1 m x 1 m", field="rugbot")
    if result.segments is None:
        raise InputError("needs paths; simulate with segments=True", field="rugbot")
    samples = _samples(result, run)
    if samples["energy"].null_count():
        raise InputError("needs energies, which this result lacks", field="rugbot")
    _check_energies(samples, "rugbot")
    if (samples["decision"] > 1).any() or (samples["observation"] > 1).any():
        # Of several kinds: the format cannot tell kind 2 from undecided.
        samples = samples.with_columns(decision=pl.lit(None, dtype=samples.schema["decision"]))
    ends = result.ends.filter(pl.col("run") == run)
    names = result.names if isinstance(result, Recording) else range(1, result.scenario.swarm.robots + 1)
    loops_s = np.arange(0.0, float(ends["end_s"].max() or 0.0), CAMERA_S)  # type: ignore[arg-type]
    # Positions of each robot at each loop, (loops, 2). Those beyond the right or upper wall (1 m) are moved onto it;
    # those beyond the other two walls stay, since -10 m is no wall but a bound below all positions.
    tracked = {
        robot: np.clip(pose(result.segments, run, robot, loops_s), -10.0, 1.0)[:, :2]
        for robot in ends["robot"].to_list()
    }
    lines: list[str] = []
    # A sample is written in the first loop after it, or in the last loop.
    with_loop = samples.with_columns(
        loop=pl.Series(np.minimum(np.searchsorted(loops_s, samples["time_s"].to_numpy()), loops_s.size - 1))
    )
    twice = with_loop.filter(with_loop.select("robot", "loop").is_duplicated())
    if twice.height:
        raise InputError(
            f"holds one sample of a robot per {CAMERA_S} s, and robot {twice['robot'][0]} took two near "
            f"{number(twice['time_s'][0], 1)} s; write webots or csv",
            field="rugbot",
        )
    by_loop = {int(k[0]): frame.to_dicts() for k, frame in with_loop.group_by("loop", maintain_order=True)}
    for loop, time_s in enumerate(loops_s.tolist()):
        lines += [f"{_place(time_s, robot, names, at[loop])}{_NOTHING}" for robot, at in tracked.items()]
        lines += [
            _place(time_s, row["robot"], names, (min(row["x_m"], 1.0), min(row["y_m"], 1.0)))
            + _sample_cells(row)
            for row in by_loop.get(loop, [])
        ]
    head = (
        ",Timestamp,ROV Number,Marker ID,X Meter,Y Meter,Energy,Alpha,Beta,Belief,d_f,"
        "Swarm Send,Swarm Recv,Collision Time,Sense Time"
    )
    body = "\n".join(f"{number},{line}" for number, line in enumerate(lines))
    write_text(path, f"{head}\n{body}\n", replace=replace)


def _place(time_s: float, robot: int, names: Sequence[int], where: Any) -> str:
    """Write the first cells of a row: time, name, marker (100 + ``robot`` beyond the study's), x and y, m."""
    marker = MARKERS[robot] if robot < len(MARKERS) else 100 + robot
    return f"{time_s:.2f},{names[robot]},{marker:.1f},{float(where[0]):.7f},{float(where[1]):.7f}"


def _sample_cells(row: dict[str, Any]) -> str:
    """Write the further cells of a sample's row: energy, alpha, beta, belief, decision and counters.

    A value that the result does not have is written as "None".
    """
    belief, received = row["belief_below"], row["messages_received"]
    if belief is not None:
        # The robots cut the belief to three digits; the 1e-9 keeps rounding from lowering a belief that has only three.
        belief = f"{math.floor(belief * 1000 + 1e-9) / 1000:g}"
    decision = 2 if row["decision"] == -1 else row["decision"]  # None stays; the robots log 2 for undecided
    counters = [
        None if row[name] is None else round(1000 * row[name]) % WRAP_MS
        for name in ("avoid_total_s", "stop_total_s")
    ]
    return (
        f",{row['energy']:.3f},{row['alpha']},{row['beta']},{belief},{decision},"
        f"{row['sample'] % WRAP_MS},{None if received is None else received % WRAP_MS},{counters[0]},{counters[1]}"
    )


def write_webots(result: Result, path: str | Path, run: int = 0, *, replace: bool = False) -> None:
    """Write one run as a console log of the study's simulator: a line per sample after 5 s.

    As in that simulator's logs, samples of the first 5 s have no line, and at the end each robot's last line is
    repeated.

    Args:
        run: number of the run. replace: whether an existing file may be replaced.
    Raises:
        InputError: no such run, a value that the format needs is missing (such as an energy or a bit sent), a strategy
            that the format has no number for, or ``path`` cannot be written.
        RunError: the disk is full or failed.
    """
    samples = _samples(result, run)
    if result.scenario.strategy.name not in FEEDBACK:
        raise InputError(
            f"strategy '{result.scenario.strategy.name}' has no number in this format, only {', '.join(FEEDBACK)} "
            "have; write rugbot or csv",
            field="webots",
        )
    for name in (
        "energy",
        "message",
        "alpha",
        "beta",
        "messages_received",
        "belief_below",
        "decision",
        "avoid_total_s",
        "stop_total_s",
    ):
        if samples[name].null_count():
            raise InputError(f"needs '{name}', which this result lacks", field="webots")
    _check_energies(samples, "webots")
    # Decision time of each robot; None if it never decides.
    decided = {
        row["robot"]: row["decision_time_s"] for row in result.robots.filter(pl.col("run") == run).to_dicts()
    }
    logged = samples.with_columns(
        own_ones=pl.col("observation").cast(pl.Int64).cum_sum().over("robot"),
    ).filter(pl.col("time_s") > 5.0)
    lines = [_console(row, decided[row["robot"]]) for row in logged.to_dicts()]
    lines += [
        _console(row, decided[row["robot"]])
        for row in logged.group_by("robot", maintain_order=True).last().sort("robot").to_dicts()
    ]
    write_text(path, "\n".join([*_settings(result), *lines]) + "\n", replace=replace)


def _settings(result: Result) -> list[str]:
    """Return the first lines of a console log: one line with the settings as whole numbers.

    If a setting is not a whole number, the line is a note that says so.
    """
    s = result.scenario
    tau_ms = s.sample.sample_interval_ms
    numbers = (
        s.walk.walk_duration_location_ms, s.walk.walk_duration_scale_ms, tau_ms,
        s.walk.avoidance_threshold_mm, s.decision.min_observations, FEEDBACK.index(s.strategy.name),
        s.strategy.table("soft").eta,
        result.seed or 0,  # a recording has no seed
    )  # fmt: skip
    if any(number != int(number) for number in numbers):
        return ["INFO: settings are not whole numbers and are not logged"]
    settings = " ".join(str(int(number)) for number in numbers)
    # The format has further numbers, among them the number of robots, and tau once more.
    return [f"{settings} 1 {s.swarm.robots} {int(tau_ms)} 0 0 "]


def _console(row: dict[str, Any], decided_s: float | None) -> str:
    """Write a sample as a line of a console log.

    The cells are a constant, time (s), robot, energy, bit sent, belief, alpha, beta, number of the sample, messages
    received, mean of the posterior, mean of a posterior from own samples alone, x, 1 - y (the simulator's axis points
    down), times spent walking, avoiding and standing (ms), decision time (whole s; 0: none yet), decision.

    Args:
        decided_s: decision time of the robot; None: it never decides.
    """
    # The posterior from own samples alone: prior Beta(1, 1), and sample + 1 bits so far, of which own_ones are 1.
    own_mean = (1 + row["own_ones"]) / (row["sample"] + 3)
    counts = row["alpha"] + row["beta"]
    decided = decided_s is not None and row["time_s"] >= decided_s
    # ``walk_total_s`` is None in a recording, whose times of driving and turning are not known.
    walking_s = row["walk_total_s"] or 0.0
    return (
        f"1,{row['time_s']:.6f},{row['robot']},{row['energy']:.6f},{row['message']},{row['belief_below']:.6f},"
        f"{row['alpha']},{row['beta']},{row['sample']},{row['messages_received']},{row['alpha'] / counts:.6f},"
        f"{own_mean:.6f},{row['x_m']:.6f},{1.0 - row['y_m']:.6f},"
        f"{round(1000 * walking_s)},{round(1000 * row['avoid_total_s'])},{round(1000 * row['stop_total_s'])},"
        f"{int(decided_s) if decided and decided_s is not None else 0},{row['decision']}"
    )


def write_csv(result: Result, folder: str | Path, run: int = 0, *, replace: bool = False) -> None:
    """Write every table of a result, with all runs, as a CSV file in a folder.

    The tables are those of ``result.TABLES``, so the additional tables of a recording are not written.

    Args:
        run: has no effect; all writers have this argument. replace: whether existing files may be replaced.
    Raises:
        InputError: ``folder`` is a file or cannot be created, or no file in it; or one of the files exists and
            ``replace`` is false (in this case no file is written).
        RunError: the disk is full or failed.
    """
    folder = path_of(folder, "folder")
    check_flags(replace=replace)
    if folder.exists() and not folder.is_dir():
        raise InputError(f"'{folder}' is a file; give the name of a folder", field="--out")
    make_folder(folder)
    frames = {f"{name}.csv": getattr(result, name) for name in TABLES if getattr(result, name) is not None}
    if not replace:
        for name in frames:
            check_free(folder / name)  # all of them before the first is written
    for name, frame in frames.items():
        with whole_file(folder / name, replace=replace) as part:
            part.write_bytes(csv_bytes(frame))  # no table of a result has nested values


def _check_energies(samples: pl.DataFrame, format_name: str) -> None:
    """Refuse energies below 0, which readers of logs refuse: a Gamma law with a location below 0 may draw them."""
    below = samples.filter(pl.col("energy") < 0)
    if below.height:
        robot, sample, energy = below.select("robot", "sample", "energy").row(0)
        raise InputError(
            f"has no energies below 0, and that of robot {robot}, sample {sample}, is {number(energy, 3)}; write csv, "
            "or another run (--session)",
            field=format_name,
        )


def _samples(result: Result, run: int) -> pl.DataFrame:
    """Return the samples of a run: the columns of motion, observations and inference, and three total times.

    The total times are those that the robot has spent so far, s: avoid_total_s, stop_total_s, and walk_total_s
    (driving, turning and avoiding). They are sums of the times in the table of motion, also for a recording, although
    it has the logged totals in ``rows``.

    Raises:
        InputError: there is no such run.
    """
    run = whole_number_of(run, "run", 0, 2**32 - 1)
    if result.runs.filter(pl.col("run") == run).is_empty():
        raise InputError(f"there is no run {run} in this result", field="run")
    key = ["run", "robot", "sample"]
    table = result.motion.filter(pl.col("run") == run)
    for other in (result.observations, result.inference):
        table = table.join(other, on=key, how="left", maintain_order="left")
    spent = {
        f"{name}_total_s": pl.col(f"{name}_s").cast(pl.Float64).cum_sum().over("robot")
        for name in ("avoid", "stop")
    }
    walked = sum((pl.col(f"{name}_s").cast(pl.Float64) for name in ("drive", "turn", "avoid")), pl.lit(0.0))
    return table.with_columns(**spent, walk_total_s=walked.cum_sum().over("robot"))


WRITERS: Final[dict[str, Callable[..., None]]] = {
    "rugbot": write_rugbot,
    "webots": write_webots,
    "csv": write_csv,
}
