"""The document of one run, or of the runs of a result: who decided what, when, how sure; and the folder of a run."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Final

import numpy as np
import polars as pl

from vibroswarm.core.atomic_io import whole_folder
from vibroswarm.core.numbers import count, first_of, number, stated_percent, verb, whole
from vibroswarm.documents.cell_figures import WIDEST_MAP, answers_table, tile_lines
from vibroswarm.documents.knowledge import told
from vibroswarm.inference.reports import ESTIMATE
from vibroswarm.observation.decision_boundary import expected_classes_on
from vibroswarm.plots.picture import save_figure
from vibroswarm.plots.reports import draw_run_reports
from vibroswarm.plots.run import draw_run, maps_figure, write_run_picture
from vibroswarm.result import Result
from vibroswarm.run_page.write import why_no_page, write_run_page
from vibroswarm.scenario.change_fields import change_words
from vibroswarm.scenario.fault_draws import fault_words
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.show.document import Column, Document, Figure, Part, Table, Text
from vibroswarm.statistics.answers_over_time import answers_in
from vibroswarm.statistics.decidability import decidability
from vibroswarm.statistics.figures import ESTIMATES, run_figures
from vibroswarm.statistics.map_figures import floor_maps, keeps_floor_map
from vibroswarm.statistics.reports_over_time import report_headings, reports_over_time
from vibroswarm.statistics.robot_knowledge import counted, gate_unreached
from vibroswarm.statistics.sampling import blocked_words
from vibroswarm.statistics.verdict import (
    OPINION_NOTE,
    Verdict,
    asked_number,
    confidence,
    decision_words,
    has_own_estimate,
    headline,
    holds_opinions,
    mean_over_time,
    strategy_name,
    verdict,
)

MOST_ROBOTS: Final = 20
"""Largest swarm, in robots, whose robots have a row each unless everything is asked for."""


def result_document(result: Result) -> Document:
    """Return the document of a result: of its run, or of all its runs if there are several or none."""
    numbers = result.runs["run"].to_list()
    return run_document(result, numbers[0]) if len(numbers) == 1 else runs_document(result)


def run_document(result: Result, run: int) -> Document:
    """Return the document of one run of a result.

    Raises:
        InputError: there is no such run.
    """
    found, scenario = verdict(result, run), result.scenario
    answers = _answers_over_time(result, run)
    decidable = decidability(scenario, floor=result.floor(run).at(found.end_s))
    opinions = holds_opinions(scenario)
    posterior = "opinion" if opinions else "share of ones" if _counts(found, scenario) else "estimate"
    scores_own = scenario.task.entry is not None and scenario.task.entry.scored is not None
    if posterior == "estimate" and scenario.sensor.kinds > 2 and not (found.estimated or scores_own):
        posterior = "share of kind 1"  # which the task, such as the most common kind, does not ask for
    return Document(
        title=f"Run {run}: {strategy_name(scenario.strategy.name)}",
        answer=(
            *failure_sentences(result),
            headline(found),
            confidence(found),
            _gate_unreached(result, run, found),
            _when_given(found, answers),
        ),
        knew=told([scenario]),
        warnings=(decidable.says if decidable.is_warning else "", _blocked(result.robots.filter(run=run))),
        parts=(
            Text(_what_ran(result, found, run)),
            *map(Text, _readings(result, run, found)),
            Text(fault_sentence(result, run)),
            Text(OPINION_NOTE if opinions else ""),
            *robot_tables(found, posterior),
            *answers_table(answers),
            *_reports(result, run),
            *_map(result, run),
            *_reports_over_time(result, run),
            Figure("run", lambda style: draw_run(result, run, style=style)),
        ),
        made_by=_made_by(result),
        data=_verdict_data(found) | _faults_and_failures(result, run),
    )


def runs_document(result: Result) -> Document:
    """Return the document of several runs: how their swarms decided, and a row for each run."""
    outcome, runs = _estimates(result) if asked_number(result.scenario) else _decisions(result)
    floor = result.floor(int(runs["run"][0])).name
    columns = {
        "consensus_time_s": Column("at", "s", decimals=1),
        "right": Column("robots right"),
        "estimate_error": Column("mean error"),
        "estimate_coverage": Column("90 % intervals that hold it", share=True),
        "estimate_crps": Column("CRPS"),
    }
    return Document(
        title=f"{count(runs.height, 'run')} of {strategy_name(result.scenario.strategy.name)}",
        answer=(*failure_sentences(result), f"{count(runs.height, 'run')}: {outcome}."),
        knew=told([result.scenario]),
        warnings=(_blocked(result.robots),),
        parts=(
            Text(f"{_swarm(result)}, on '{floor}', {_origin(result)}."),
            Table(runs, columns, name="runs"),
        ),
        made_by=_made_by(result),
    )


def _blocked(robots: pl.DataFrame) -> str:
    words = blocked_words(robots["blocked_share"].mean())  # type: ignore[arg-type]
    return f"{words[:1].upper()}{words[1:]}"


def _decisions(result: Result) -> tuple[str, pl.DataFrame]:
    """Return how many swarms decided how, in words, and a table with a row for each run."""
    outcomes = Counter((outcome or "not logged").replace("_", " ") for outcome in result.runs["consensus"])
    counts = ", ".join(f"{n} {outcome}" for outcome, n in outcomes.most_common())
    return counts, result.runs.select("run", "consensus", "consensus_time_s", "right", "wrong", "undecided")


def _estimates(result: Result) -> tuple[str, pl.DataFrame]:
    """Return the mean error of the robots' estimates in words, and a table with a row for each run."""
    figures = run_figures(result.robots, result.runs, result.scenario.run.t_end_s).select("run", *ESTIMATES)
    error = figures["estimate_error"].mean()
    asked = asked_number(result.scenario)
    words = "no" if error is None else f"mean error {number(error)} of the"  # type: ignore[arg-type]
    return f"{words} estimates of the {asked}", figures


def _verdict_data(found: Verdict) -> dict[str, pl.DataFrame]:
    """Return the values of a verdict: those of the swarm in one row, and those of robots."""
    values = found.as_dict()
    robots = values.pop("robots")
    return {
        "verdict": pl.DataFrame([values], infer_schema_length=None),
        "robots": pl.DataFrame(robots, infer_schema_length=None),
    }


def _faults_and_failures(result: Result, run: int) -> dict[str, pl.DataFrame]:
    tables = {"faults": result.faults, "failures": result.failures}
    return {name: frame.filter(run=run) for name, frame in tables.items() if frame is not None}


def _what_ran(result: Result, found: Verdict, run: int) -> str:
    floor = result.floor(run).at(found.end_s)
    counts = np.bincount(floor.tiles.ravel(), minlength=result.scenario.sensor.kinds).tolist()
    arena = result.scenario.arena
    fill = f"fill ratio {number(floor.fill_ratio_within(arena.width_m, arena.height_m), digits=4)}"
    tiles = f"{whole(counts[1])} of {count(floor.tiles.size, 'tile')} {verb(counts[1], 'vibrate')}, {fill}"
    if len(counts) > 2:
        tiles = ", ".join(f"{count(n, 'tile')} of kind {kind}" for kind, n in enumerate(counts))
    if floor.has_contrasts:
        tiles = f"{count(floor.tiles.size, 'tile')} with values, {fill}"
    elif result.scenario.floor.has_surface:
        tiles = f"{count(len(floor.patches), 'patch', 'patches')} on still tiles, {fill}"
    changes = change_words(result.scenario.change)
    at_end = " at the end" if changes else ""
    return f"{_swarm(result)}, on '{floor.name}' ({tiles}{at_end}), {_origin(result)}. {changes}".rstrip()


def _swarm(result: Result) -> str:
    scenario = result.scenario
    return f"{count(scenario.swarm.robots, 'robot')}, {strategy_name(scenario.strategy.name)}"


def _origin(result: Result) -> str:
    return "as recorded" if result.seed is None else f"seed {result.seed}"


def _made_by(result: Result) -> dict[str, str]:
    return {
        "scenario": result.scenario.hash,
        "seed": "recorded" if result.seed is None else str(result.seed),
        "source of motion": result.source,
        **result.versions,
    }


def _readings(result: Result, run: int, found: Verdict) -> list[str]:
    """Return sentences on the shares of the classes that robots read, and with what they compare them."""
    sensor, arena = result.scenario.sensor, result.scenario.arena
    if max(sensor.kinds, sensor.readings) > 2:
        read = result.observations.filter(run=run)["observation"].to_numpy()
        counts = np.bincount(read, minlength=sensor.readings)
        size = (arena.width_m, arena.height_m)
        expected = mean_over_time(
            result.floor(run), found.end_s, lambda floor: expected_classes_on(sensor, floor, size)
        )
        shares = [
            f"{kind}: {stated_percent(round(n / max(read.size, 1), 4))} ({stated_percent(round(share, 4))})"
            for kind, (n, share) in enumerate(zip(counts.tolist(), expected.tolist(), strict=True))
        ]
        return [f"Samples read as kind {', '.join(shares)}; in brackets: expected for this floor and sensor."]
    sentences = []
    # Shares are rounded to 4 decimals, so that percentages have at most two.
    if found.share_of_ones_read is not None:
        sentences.append(
            f"Samples read as vibrating: {stated_percent(round(found.share_of_ones_read, 4))} (expected on this floor, "
            f"with the sensor's errors: {stated_percent(round(found.share_of_ones_expected, 4))})."
        )
    if found.readings_boundary != found.decision_boundary:  # robots allow for the sensor's errors
        sentences.append(
            f"Robots compare the share of ones with {stated_percent(round(found.readings_boundary, 4))}, expected on a "
            f"floor with {stated_percent(found.decision_boundary)} vibrating tiles."
        )
    return sentences


def fault_sentence(result: Result, run: int) -> str:
    """Return which robots had which faults in a run; empty if robots cannot fail."""
    if result.faults is None:
        return ""
    of_run = result.faults.filter(run=run)
    robots = result.scenario.swarm.robots
    if of_run.is_empty():
        return f"Faults: none of {count(robots, 'robot')} failed."
    each = [
        f"robot {row['robot']} {fault_words(row['fault'])}"
        + ("" if row["from_s"] == 0 else f" from {number(row['from_s'], digits=4)} s")
        for row in of_run.to_dicts()
    ]
    return f"Faults: {of_run['robot'].n_unique()} of {count(robots, 'robot')} failed: {'; '.join(each)}."


def failure_sentences(result: Result) -> list[str]:
    """Return, for each run that a simulator of physics gave up, a sentence that says when and why."""
    if result.failures is None:
        return []
    return [
        f"RUN FAILED at {number(row['time_s'], digits=4)} s: {row['reason']}. Its robots have stood still "
        "since; what follows is not a result."
        for row in result.failures.to_dicts()
    ]


def _counts(found: Verdict, scenario: Scenario) -> bool:
    """Return whether robots estimate by a posterior of counts, or of two kinds not at all."""
    has_none = scenario.sensor.kinds == 2 and found.robots[0].estimate is None
    return has_none or (not has_own_estimate(scenario) and any(one.alpha is not None for one in found.robots))


def _answers_over_time(result: Result, run: int) -> pl.DataFrame:
    """Return how right the answers of a run were over time, in one row; without columns if its floor stays."""
    if not result.scenario.change.is_given:
        return pl.DataFrame()
    return answers_in(result).filter(run=run).drop("run")


def _when_given(found: Verdict, judged: pl.DataFrame) -> str:
    """Return a sentence on answers that were wrong when they were given, if what they became by the end hides that."""
    right = None if judged.is_empty() else judged["right_at_decision"].item()
    if right in (None, 1.0) or found.consensus != "right":
        return ""
    return f"Right by the floor at the end; when given, {stated_percent(round(right, 3))} of the answers were right."


def _gate_unreached(result: Result, run: int, found: Verdict) -> str:
    """Return a sentence on the gate of a simulated run if no robot had enough observations to decide by its end."""
    if result.seed is None or found.undecided < len(found.robots):
        return ""
    robots = result.robots.filter(run=run)
    return gate_unreached(result.scenario, robots.select(counted(result.scenario.decision.gate)).item())


MOST_REPORTED: Final = 12
"""Most values of each robot in the table of what they reported, the first ones."""


def _reports(result: Result, run: int) -> list[Part]:
    """Return a table of what each robot reported last, beside its estimate; none if that is nothing."""
    told = reports_over_time(result, run).filter(~pl.col("name").is_in(ESTIMATE))
    if told.is_empty():
        return []
    last = (
        told.group_by("robot", "name", maintain_order=True)
        .last()
        .pivot("name", index="robot", values="value")
    )
    headings = report_headings(result, last.columns[1:])
    columns = {name: Column(heading) for name, heading in headings.items()}
    some = first_of(MOST_REPORTED, last.width - 1, "value")
    caption = f"What robots reported last (after each sample: table reports){f': {some}' if some else ''}."
    return [Table(last.select(last.columns[: MOST_REPORTED + 1]), columns, caption=caption, name="reports")]


def _reports_over_time(result: Result, run: int) -> list[Part]:
    """Return the figure of what robots reported after their samples; none if they report nothing but arrays."""
    if reports_over_time(result, run).is_empty():
        return []
    return [Figure("reports", lambda style: draw_run_reports(result, run, style=style), "Reports over time")]


def robot_tables(found: Verdict, posterior: str) -> list[Table]:
    """Return the table of robots; of a large swarm, before it, one with a row for each decision.

    Confidence and posterior are left out if the robots have none, and decisions if the task asks for a number.

    Args:
        posterior: heading of the posterior mean: "share of ones", or "opinion" for strategies whose robots count the
            conclusions of others as readings.
    """
    robots = pl.DataFrame(
        [
            {
                "robot": one.robot,
                # "more than 50 % vibrates" is shortened, since the headline above the table has the verb.
                "decision": decision_words(one.decision, found.answers).replace(" % vibrates", " %"),
                "decision_time_s": one.decision_time_s,
                "confidence": one.belief_in_decision,
                "posterior": one.estimate,
                "posterior_low": one.interval[0] if one.interval else None,
                "posterior_high": one.interval[1] if one.interval else None,
                "samples": one.samples,
                "received": one.received,
            }
            for one in found.robots
        ],
        schema_overrides=dict.fromkeys(
            ("decision_time_s", "confidence", "posterior", "posterior_low", "posterior_high"), pl.Float64
        )
        | {"received": pl.Int64},
        infer_schema_length=None,
    )
    if found.estimated:
        robots = robots.drop("decision", "decision_time_s", "confidence")
    elif all(one.belief is None for one in found.robots):
        robots = robots.drop("confidence")
    if robots["posterior"].null_count() == robots.height:
        robots = robots.select(pl.exclude("^posterior.*$"))
    columns = {
        "decision_time_s": Column("at", "s", decimals=1),
        "confidence": Column(share=True),
        "posterior": Column(f"{posterior} (95 %)", decimals=3),
        "samples": Column("own"),
        "received": Column("heard"),
    }
    is_large = len(found.robots) > MOST_ROBOTS
    each = Table(robots, columns, name="robots", folded=is_large)
    return [_table_by_decision(robots, posterior), each] if is_large and not found.estimated else [each]


def _table_by_decision(robots: pl.DataFrame, posterior: str) -> Table:
    columns = {
        "decision_time_s": Column("at", "s", decimals=1),
        "confidence": Column(share=True),
        "posterior": Column(posterior, decimals=3),
        "samples": Column("own", decimals=0),
        "received": Column("heard", decimals=0),
    }
    groups = robots.group_by("decision", maintain_order=True).agg(
        pl.len().alias("robots"),
        *(
            column
            for name in columns
            if name in robots.columns
            for column in (
                pl.col(name).mean(),
                pl.col(name).min().cast(pl.Float64).alias(f"{name}_low"),
                pl.col(name).max().cast(pl.Float64).alias(f"{name}_high"),
            )
        ),
    )
    return Table(groups, columns, "Robots by decision: mean, and smallest and largest.", "decisions")


def _map(result: Result, run: int) -> list[Part]:
    """Return the map of the floor that follows from the samples of all robots, if they keep maps of not too many tiles.

    A tile counts as believed to vibrate if the belief is above 0.5.
    """
    if not keeps_floor_map(result.scenario) or result.scenario.floor.columns > WIDEST_MAP:
        return []
    # One row per tile: `vibrating` is the belief that the tile vibrates, `vibrates` is 1 if it does. In the map that is
    # made from the samples of all robots, the column `robot` is null.
    pooled = floor_maps(result).filter(pl.col("robot").is_null(), run=run)
    right = ((pooled["vibrating"] > 0.5) == (pooled["vibrates"] == 1)).sum()
    words = (
        f"Map of the floor, all robots' samples: {right} of {pooled.height} tiles right. Belief that a tile vibrates, "
        "%; ! marks a tile whose believed kind is wrong:"
    )
    return [Text(words), Text(tile_lines(pooled), "code"), Table(pooled, name="map", folded=True)]


def write_run_folder(result: Result, out: Path, *, pictures: bool) -> None:
    """Write a result with its page and maps, and with ``pictures`` their pictures, into the folder ``out``.

    The folder is written completely or not at all; an older result in it is replaced. The page is written only if it
    can show the result (``why_no_page``), and maps only if the robots' strategy keeps a map of the floor.
    """
    from vibroswarm.study.summary import write_table  # loads all of studies

    with whole_folder(out, replace=True) as part:
        result.write_into(part)
        if why_no_page(result) is None:
            write_run_page(result, part / "run.html")
        maps = floor_maps(result) if keeps_floor_map(result.scenario) else None
        if maps is not None:
            write_table(maps, part / "maps")
        if pictures:
            write_run_picture(result, part / "run.png")
            if reports_over_time(result).height:
                save_figure(lambda: draw_run_reports(result, style="page").figure, part / "reports.png")
            if maps is not None:
                tile_m = result.floor(int(maps["run"][0])).geometry[2:4]
                save_figure(lambda: maps_figure(maps, tile_m=tile_m), part / "maps.png")
