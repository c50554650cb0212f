"""The report of a result: of one run, who decided what, when, how sure; of several, how their swarms decided."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict
from functools import partial
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.core.numbers import count, every, number, stated, stated_percent
from vibroswarm.inference.reports import ESTIMATE
from vibroswarm.observation.decision_boundary import expected_classes_on
from vibroswarm.plots.picture import Picture
from vibroswarm.plots.reports import draw_run_reports
from vibroswarm.plots.run import draw_run, maps_figure
from vibroswarm.report.knowledge import known_beyond, setting
from vibroswarm.report.report import Figure, Report, Table, report
from vibroswarm.result import Result
from vibroswarm.scenario.fault_draws import fault_words
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.statistics.decidability import decidability
from vibroswarm.statistics.figures import run_figures
from vibroswarm.statistics.map_figures import floor_maps
from vibroswarm.statistics.over_time import answers_in, report_headings, reports_over_time
from vibroswarm.statistics.sampling import blocked_words
from vibroswarm.statistics.verdict import (
    COUNTED,
    Verdict,
    answers_of,
    decision_words,
    gate_unreached,
    holds_opinions,
    mean_over_time,
    verdict,
)
from vibroswarm.strategies.place_map import WITH_MAP

MOST_ROBOTS: Final = 20
"""Most robots with a row each in a terminal."""
WIDEST_MAP: Final = 16
"""Most columns of tiles of a map in a terminal."""
OUTCOMES: Final = {
    "right": "right",
    "wrong": "wrong",
    "split": "split",
    "incomplete": "undecided",
    "truth_undefined": "no answer is right",
    None: "not logged",
}
"""Words for how a swarm ended."""


@report.register
def of_result(result: Result, run: int | None = None) -> Report:
    """Return what one run of a result says; of several runs, unless one is named, how they ended."""
    if run is None and result.runs.height != 1:
        return _of_runs(result)
    number_of_run = int(result.runs["run"][0]) if run is None else run
    swarm, scenario = verdict(result, number_of_run), result.scenario
    parts: dict[str, Table | Figure] = {
        **dict(_robot_tables(result, swarm, number_of_run)),
        "readings": _readings(result, swarm, number_of_run),
        "floor": Figure(partial(draw_run, result, number_of_run), "Floor, paths and samples"),
        **dict(_reported(result, number_of_run)),
        **dict(_maps(result, number_of_run)),
        "verdict": _verdict_table(swarm),
    }
    return Report(
        title=f"{count(scenario.swarm.robots, 'robot')} on {result.floor(number_of_run).name}",
        answer=(_outcome(swarm, scenario),),
        parts={name: part for name, part in parts.items() if isinstance(part, Figure) or part.frame.height},
        setting=f"{setting(scenario)}; run {number_of_run}{_origin(result)}",
        warnings=tuple(_warnings(result, swarm, number_of_run)),
        made_by=_made_by(result),
    )


def _of_runs(result: Result) -> Report:
    if result.scenario.task.asks_number:
        frame = run_figures(result.robots, result.runs, result.scenario.run.t_end_s).select(
            "run", "^estimate_.*$"
        )
        answer = f"{count(frame.height, 'run')}: mean error of the estimates {number(frame['estimate_error'].mean())}."  # type: ignore[arg-type]
    else:
        outcome = pl.col("consensus").cast(pl.String).replace_strict(OUTCOMES, return_dtype=pl.String)
        frame = result.runs.select("run", outcome, "consensus_time_s", "right", "wrong", "undecided")
        ended = Counter(frame["consensus"].to_list())
        answer = (
            f"{count(frame.height, 'run')}: {', '.join(f'{n} {word}' for word, n in ended.most_common())}."
        )
    return Report(
        title=f"{count(frame.height, 'run')} of {result.scenario.strategy.name}",
        answer=(answer,),
        parts={"each_run": Table(frame, "Runs", titles={"consensus": "outcome"})},
        setting=f"{setting(result.scenario)}{_origin(result)}",
        warnings=tuple(_failures(result)),
        made_by=_made_by(result),
    )


def _outcome(swarm: Verdict, scenario: Scenario) -> str:
    if swarm.estimated:
        true = f"the {swarm.estimated} is {number(swarm.fill_ratio, digits=4)}"
        if swarm.estimate_error is None:
            return f"No robot has an estimate; {true}."
        return f"Mean error of the estimates {number(swarm.estimate_error)}; {true}."
    word = OUTCOMES[swarm.consensus].capitalize()
    if swarm.decision is not None:
        at = "" if swarm.consensus_time_s is None else f" by {number(swarm.consensus_time_s, 1)} s"
        answer = decision_words(swarm.decision, swarm.answers)
        return f"{word}: {every(len(swarm.robots), 'robot')} decided '{answer}'{at}."
    sides = Counter(decision_words(robot.decision, swarm.answers) for robot in swarm.robots)
    counts = ", ".join(
        f"{robots} {answer if answer == 'undecided' else repr(answer)}"
        for answer, robots in sides.most_common()
    )
    truth = "" if swarm.truth is None else f"; true is '{answers_of(scenario)[swarm.truth]}'"
    return f"{word} after {stated(swarm.end_s)} s: {counts}{truth}."


def _robot_tables(result: Result, swarm: Verdict, run: int) -> Iterator[tuple[str, Table]]:
    scenario = result.scenario
    opinion = holds_opinions(scenario)
    is_large = len(swarm.robots) > MOST_ROBOTS
    own = "estimate" if scenario.strategy.entry.has_own_estimate else "share of ones"
    estimate = "opinion" if opinion else own
    titles = {"posterior": estimate, "own_samples": "own", "messages_heard": "heard"}
    caption = "Confidence: belief in the own decision when it was made."
    if opinion:
        caption += " Opinion: robots counted conclusions of others as if they were readings."
    if known := known_beyond([scenario])[0]:
        caption += f" Robots know {known}."
    frame = _with_faults(result, _robots(swarm), run)
    if is_large and "decision" in frame.columns:
        yield "decisions", Table(_by_decision(frame), "Decisions", "Means over robots.", {"robot": "robots"})
    yield "each_robot", Table(frame, "Robots", caption, titles, folded=is_large)


def _robots(swarm: Verdict) -> pl.DataFrame:
    rows: list[dict[str, Any]] = [
        {
            "robot": robot.robot,
            "decision": decision_words(robot.decision, swarm.answers),
            "decided_s": robot.decision_time_s,
            "confidence_share": robot.belief_in_decision,
            "posterior": robot.estimate,
            "posterior_low": robot.interval[0] if robot.interval else None,
            "posterior_high": robot.interval[1] if robot.interval else None,
            "own_samples": robot.samples,
            "messages_heard": robot.received,
        }
        for robot in swarm.robots
    ]
    frame = pl.DataFrame(rows, infer_schema_length=None)
    if swarm.estimated:
        frame = frame.drop("decision", "decided_s", "confidence_share")
    return frame.select(column.name for column in frame if column.null_count() < frame.height)


def _with_faults(result: Result, frame: pl.DataFrame, run: int) -> pl.DataFrame:
    if result.faults is None or not (faults := result.faults.filter(run=run)).height:
        return frame
    faulty = pl.DataFrame(
        {"robot": faults["robot"], "fault": [fault_words(kind) for kind in faults["fault"]]}
    ).cast({"robot": frame.schema["robot"]})
    texts = faulty.group_by("robot").agg(pl.col("fault").str.join(", "))
    return frame.join(texts, on="robot", how="left", maintain_order="left")


def _by_decision(robots: pl.DataFrame) -> pl.DataFrame:
    numbers = [name for name in ("decided_s", "confidence_share", "posterior") if name in robots.columns]
    return robots.group_by("decision", maintain_order=True).agg(
        pl.len().alias("robot"), *(pl.col(name).mean() for name in numbers)
    )


def _readings(result: Result, swarm: Verdict, run: int) -> Table:
    sensor, arena = result.scenario.sensor, result.scenario.arena
    read = result.observations.filter(run=run)["observation"].to_numpy()
    shares = np.bincount(read, minlength=sensor.readings) / max(read.size, 1)
    size = (arena.width_m, arena.height_m)
    expected = mean_over_time(
        result.floor(run), swarm.end_s, lambda floor: expected_classes_on(sensor, floor, size)
    )
    frame = pl.DataFrame({"reading": range(len(shares)), "read_share": shares, "expected_share": expected})
    boundary = stated_percent(round(swarm.readings_boundary, 4))
    caption = f"Expected: on this floor, with the sensor's errors. Robots compare the share of ones with {boundary}."
    return Table(frame if read.size else frame.clear(), "Readings", caption if len(shares) == 2 else "")


def _reported(result: Result, run: int) -> Iterator[tuple[str, Table | Figure]]:
    reports = reports_over_time(result, run)
    last = (
        reports.filter(~pl.col("name").is_in(ESTIMATE)).group_by("robot", "name", maintain_order=True).last()
    )
    if last.height:
        frame = last.pivot("name", index="robot", values="value")
        titles = report_headings(result, frame.columns[1:])
        yield "last_reports", Table(frame, "What robots reported last", titles=titles)
    if reports.height:
        yield "reports_over_time", Figure(partial(draw_run_reports, result, run), "Reports over time")


def _maps(result: Result, run: int) -> Iterator[tuple[str, Table | Figure]]:
    if result.scenario.change.is_given:
        yield "answers", Table(answers_in(result).filter(run=run).drop("run"), "Answers over time")
    if result.scenario.strategy.name not in WITH_MAP:
        return
    maps = floor_maps(result).filter(run=run)
    pooled = maps.filter(pl.col("robot").is_null()).sort("row", "column")
    percent = pooled.select("row", "column", percent=(100 * pl.col("vibrating")).round().cast(pl.Int64))
    right = ((pooled["vibrating"] > 0.5) == (pooled["vibrates"] == 1)).sum()
    caption = f"Belief that a tile vibrates, %, from all samples; right in {right} of {count(pooled.height, 'tile')}."
    tiles = percent.with_columns(pl.col("column").cast(pl.String)).pivot(
        "column", index="row", values="percent"
    )
    is_wide = tiles.width > WIDEST_MAP + 1
    yield "map", Table(tiles, "Map of the floor", caption, folded=is_wide)
    yield "maps", Figure(partial(_draw_maps, result, maps, run), "Maps of the robots")


def _draw_maps(result: Result, maps: pl.DataFrame, run: int) -> Picture:
    figure = maps_figure(maps, run, tile_m=result.floor(run).geometry[2:4])
    return Picture(
        figure, maps, "Colour: belief that a tile vibrates; a cross: it is believed to be what it is not."
    )


def _verdict_table(swarm: Verdict) -> Table:
    values = {
        name: ", ".join(value) if isinstance(value, tuple) else value
        for name, value in asdict(swarm).items()
        if name != "robots"
    }
    return Table(pl.DataFrame([values], infer_schema_length=None), "All numbers of the run", folded=True)


def _warnings(result: Result, swarm: Verdict, run: int) -> Iterator[str]:
    yield from _failures(result)
    floor = result.floor(run).at(swarm.end_s)
    decidable = decidability(result.scenario, floor=floor)
    if decidable.is_warning:
        yield decidable.says
    robots = result.robots.filter(run=run)
    if blocked := blocked_words(robots["blocked_share"].mean()):  # type: ignore[arg-type]
        yield blocked
    if result.seed is not None and swarm.undecided == len(swarm.robots):
        counted = pl.sum_horizontal(COUNTED[result.scenario.decision.gate][1])
        most = robots.select(counted.max()).item()
        yield from filter(None, [gate_unreached(result.scenario, most)])
    if result.scenario.change.is_given and swarm.consensus == "right":
        right = answers_in(result).filter(run=run)["right_at_decision"].item()
        if right is not None and right < 1.0:
            share = stated_percent(round(right, 3))
            yield f"Right by the floor at the end; when given, {share} of the answers were right."


def _failures(result: Result) -> Iterator[str]:
    failures = [] if result.failures is None else result.failures.to_dicts()
    for failure in failures:
        at = number(failure["time_s"], digits=4)
        yield f"Run {failure['run']} failed at {at} s ({failure['reason']}); its robots have stood still since."


def _origin(result: Result) -> str:
    return ", as recorded" if result.seed is None else f", seed {result.seed}"


def _made_by(result: Result) -> dict[str, str]:
    return {
        "scenario": result.scenario.hash,
        "seed": "recorded" if result.seed is None else str(result.seed),
        "source of motion": result.source,
        **result.versions,
    }
