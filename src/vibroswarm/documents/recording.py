"""The documents of recordings: what an import read, what strategies would have decided, and which threshold is best."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import polars as pl

from vibroswarm.core.atomic_io import write_file
from vibroswarm.core.numbers import (
    Estimate,
    count,
    listed,
    number,
    percent,
    span,
    stated,
    stated_percent,
    with_limits,
)
from vibroswarm.documents.cell_figures import answers_table, estimate_of, flat_row
from vibroswarm.documents.knowledge import told
from vibroswarm.plots.run import write_run_picture
from vibroswarm.recordings.assemble_recording import count_lines
from vibroswarm.recordings.recording import Recording
from vibroswarm.recordings.replay import (
    Replayed,
    Replays,
    SessionOutcome,
    logged_outcomes,
    session_outcomes,
    shares_lost,
    with_beliefs,
)
from vibroswarm.recordings.threshold import Recommendation, Threshold
from vibroswarm.run_page.payload import payload
from vibroswarm.run_page.write import page_html
from vibroswarm.scenario.presets import preset_names
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.show.document import Column, Document, Section, Table, Text, if_any
from vibroswarm.statistics.answers_over_time import JUDGED


def import_document(recording: Recording, pages: Sequence[str], computed: Sequence[str] = ()) -> Document:
    """Return what an import read: the sessions' outcomes, the settings of the robots, and problems of the logs.

    Args:
        pages: file names of the pages of the sessions. computed: sentences on energies computed from acceleration.
    """
    unlogged = f"Beliefs are not in the logs; the pages show a replay {_heard(recording)}."
    return Document(
        title="Recording",
        answer=(f"{_outcomes(recording)} {recording.floor_words}",),
        warnings=(_presumed_threshold(recording, recording.scenario),),
        parts=(
            *map(Text, computed),
            _sessions(recording),
            _settings(recording),
            Section("What was read", (Text("\n".join(count_lines(recording)), "code"),)),
            Text("" if recording.logs_beliefs else unlogged),
        ),
        made_by={"robots": ", ".join(map(str, recording.names)), "stated": ", ".join(recording.stated)},
        data=_import_data(recording, pages, computed),
    )


def _heard(recording: Recording) -> str:
    """Say which messages robots hear where a replay is over a network."""
    by_log = {recording.sessions[run]["log"]: share for run, share in shares_lost(recording).items()}
    uncounted = [log for log, share in by_log.items() if share is None]
    network = recording.scenario.network.name
    all_heard = (
        "all robots hear all messages" if network == "ideal" else f"messages go over the network '{network}'"
    )
    if len(uncounted) == len(by_log):
        return f"in which {all_heard}"
    counted = "in which each message is lost at random, with the share that the session's log counts"
    return f"{counted}; in {listed(uncounted)} {all_heard}" if uncounted else counted


def _presumed_threshold(recording: Recording, scenario: Scenario) -> str:
    """Warn if samples are read by a threshold that nobody stated and the logs do not show.

    Args:
        scenario: with the threshold that is used, which a replay may state.
    """
    threshold = recording.scenario.sensor.rms_threshold
    if _knows_bits(recording) or scenario.sensor.rms_threshold != threshold:
        return ""
    above = percent(float((recording.rows["energy"] > threshold).mean()))  # type: ignore[arg-type]
    return (
        f"The threshold of these robots is unknown. Samples are read by the preset's, {stated(threshold)}, which "
        f"{above} of the energies exceed; beliefs and decisions on pages and in replays follow from it. Find one with "
        "'vibroswarm lab threshold', and import again with --set sensor.rms_threshold=..."
    )


def _knows_bits(recording: Recording) -> bool:
    """Return whether what samples read is logged, or follows from a threshold that is stated or that logs show."""
    threshold = recording.scenario.sensor.rms_threshold
    if recording.knows("sensor.rms_threshold") or threshold not in {
        preset(name).sensor.rms_threshold for name in preset_names()
    }:  # that of no preset is the user's, in a scenario's file
        return True
    read = (recording.rows["energy"] > threshold).cast(pl.Int64)
    return bool((read != recording.observations["observation"]).any())


def _outcomes(recording: Recording) -> str:
    """Count the outcomes of sessions: ``Consensus right in 2 and split in 1 of 3 sessions.``"""
    logged = recording.runs["consensus"].drop_nulls()
    sessions = count(recording.runs.height, "session")
    if logged.is_empty():
        some = "decision" in recording.rows.columns and recording.rows["decision"].count()
        are = "are not logged of all robots to the end" if some else "are not logged"
        return f"{sessions}; decisions {are}."
    each = (f"{outcome} in {n}" for outcome, n in Counter(logged.to_list()).most_common())
    return f"Consensus {listed(each)} of {sessions}."


def _sessions(recording: Recording) -> Table:
    logs = pl.DataFrame(
        {
            "session": range(1, recording.runs.height + 1),
            "log": [str(one["log"]) for one in recording.sessions],
        }
    )
    frame = pl.concat([logs, recording.runs.select("consensus", "consensus_time_s")], how="horizontal")
    columns = {"consensus": Column(), "consensus_time_s": Column("by", "s", decimals=1)}
    return Table(frame, columns, "Sessions.", "sessions", names=2)


def _settings(recording: Recording) -> Table:
    rows = [
        {"setting": one["name"], "value": _inferred_value(recording, one), "evidence": one["evidence"]}
        for one in recording.inferred
    ]
    timer = "sample.timer"
    evidence = "stated" if timer in recording.stated else "assumed"
    rows.append({"setting": timer, "value": recording.scenario[timer], "evidence": evidence})
    frame = pl.DataFrame(rows, schema=dict.fromkeys(("setting", "value", "evidence"), pl.String))
    return Table(frame, {"evidence": Column(prose=True)}, "Settings of the robots.", "settings")


def _inferred_value(recording: Recording, setting: Mapping[str, Any]) -> str:
    """Return a setting inferred from the logs, compared with the stated value if an option or a log states one.

    Args:
        setting: an entry of ``recording.inferred``. Its "value" is None if the logs do not determine it. Stated values
            from "low" to "high" fit the logs too; these limits are None if only the inferred value fits.
    """
    name, value = setting["name"], setting["value"]
    if value is None:
        return "inconclusive"
    text = _setting(value)
    if name not in recording.stated:
        return text
    given = recording.scenario[name]
    # 1e-9: a stated value that equals a limit fits, even if the limit was rounded
    fits = given == value or (
        setting["low"] is not None and setting["low"] - 1e-9 <= given <= setting["high"] + 1e-9
    )
    return f"{text} (stated: {given}{'' if fits else ', WHICH DOES NOT FIT'})"


def _setting(value: Any) -> str:
    return stated(value) if isinstance(value, float) else str(value)


def _import_data(
    recording: Recording, pages: Sequence[str], computed: Sequence[str]
) -> dict[str, pl.DataFrame]:
    inferred = [
        {
            **one,
            "value": None if one["value"] is None else str(one["value"]),
            "number": _number_of(one["value"]),
        }
        for one in recording.inferred
    ]
    sessions = [
        {"session": run + 1, "log": str(one["log"]), "reader": one["reader"], "page": page}
        for run, (one, page) in enumerate(zip(recording.sessions, pages, strict=True))
    ]
    wraps = [
        {"session": run + 1, "counter": name, "at": float(value)}
        for run, one in enumerate(recording.sessions)
        for name, value in one.get("wraps_at", {}).items()
    ]
    counts = [
        {"session": run + 1, "name": name, "count": float(value)}
        for run, one in enumerate(recording.sessions)
        for name, value in one["told"].items()
    ]
    outcomes = recording.runs.select("consensus", "consensus_time_s")
    return {
        "sessions": pl.concat([pl.DataFrame(sessions), outcomes], how="horizontal"),
        "counts": pl.DataFrame(counts),
        "wraps": pl.DataFrame(wraps),
        "settings": pl.DataFrame(inferred, infer_schema_length=None),
        "acceleration": pl.DataFrame({"words": list(computed)}, schema={"words": pl.String}),
    }


def _number_of(value: Any) -> float | None:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) if is_number else None


def replay_document(found: Replays) -> Document:
    """Return what strategies would have decided on a recording's observations.

    Samples that are missing in the log are restored (``put_back``). If the log counts more messages received by a robot
    before one of its samples than the other robots sent by then and it has not heard, the surplus is left out
    (``unsent``).
    """
    recording, replays, draws = found.recording, found.by_strategy, count(found.draws, "draw")
    logged = logged_outcomes(recording)
    outcomes = {name: session_outcomes(recording, replay) for name, replay in replays.items()}
    first = next(iter(replays.values()))
    rule = _decision_rule(first.scenario)
    unsent = ", ".join(f"{stated(replay.unsent)} ({name})" for name, replay in replays.items())
    restored = (
        f"Restored {count(first.put_back, 'sample')} without a row; left out {unsent} messages per draw that "
        "nobody could have sent at that time."
    )
    uncounted = (
        "The logs do not count the messages received in every row. So samples without a row are left out, and this is "
        f"a replay {_heard(recording)}."
    )
    return Document(
        title="Replay of a recording",
        answer=(
            f"As logged: {_shares(logged)}.",
            *(f"{name}: {_shares(of_one)} (mean over {draws})." for name, of_one in outcomes.items()),
        ),
        knew=told(replay.scenario for replay in replays.values()),
        warnings=(
            *found.warnings,
            "" if recording.counts_messages else uncounted,
            _presumed_threshold(recording, first.scenario),
        ),
        parts=(
            _replayed(logged, outcomes),
            *_answers_over_time(replays),
            Text(f"Rule: {', '.join(f'{name} {_setting(value)}' for name, value in rule.items())}; {draws}."),
            Text(restored if recording.counts_messages else ""),
            *(
                [Text(_WITH_PLACES.format(_heard(recording)))]
                if any(one.scenario.strategy.reads_places for one in replays.values())
                else []
            ),
        ),
        made_by={"seed": str(found.seed), "draws": str(found.draws)},
        data={
            "rule": pl.DataFrame([rule]),
            "as_logged": _outcome_rows(logged),
            "replayed": _outcome_rows([one for of_one in outcomes.values() for one in of_one]),
            "left_out": pl.DataFrame(
                [
                    {"strategy": name, "put_back": replay.put_back, "unsent": float(replay.unsent)}
                    for name, replay in replays.items()
                ]
            ),
        },
    )


def _decision_rule(scenario: Scenario) -> dict[str, Any]:
    return {
        "rms_threshold": scenario.sensor.rms_threshold,
        "credible_threshold": scenario.decision.credible_threshold,
        "min_observations": scenario.decision.min_observations,
        "gate": scenario.decision.gate,
    }


def _shares(found: Sequence[SessionOutcome]) -> str:
    """Return how many sessions end with which consensus, mean over draws: ``right in 2.9 of 3 sessions``."""
    totals: dict[str, float] = {}
    for outcome in found:
        for name, share in outcome.consensus.items():
            totals[name] = totals.get(name, 0.0) + share
    if not totals:
        return "decisions are not logged"
    each = (f"{name} in {number(total, digits=3)}" for name, total in totals.items())
    return f"{listed(each)} of {count(len(found), 'session')}"


def _replayed(logged: Sequence[SessionOutcome], outcomes: Mapping[str, Sequence[SessionOutcome]]) -> Table:
    rows = []
    for session, as_logged in enumerate(logged):
        rows.append(_row("as logged", as_logged, is_logged=True))
        rows += [_row(name, found[session], is_logged=False) for name, found in outcomes.items()]
    columns = {
        "consensus": Column(),
        "time": Column("decision time", "s"),
        "undecided": Column(share=True),
        "belief": Column("belief in the truth", decimals=3),
    }
    caption = "In brackets: 5 % and 95 % quantiles over draws of the lost packets."
    return Table(pl.DataFrame(rows, infer_schema_length=None), columns, caption, "replayed", names=2)


def _answers_over_time(replays: Mapping[str, Replayed]) -> list[Table]:
    """Return a table of how right answers were over time, if the floor changes: means over draws of the packets."""
    rows = [
        replay.answers.group_by(session=pl.col("run") + 1, maintain_order=True)
        .agg(pl.col(*JUDGED).mean())
        .insert_column(1, pl.lit(name).alias("strategy"))
        for name, replay in replays.items()
        if replay.answers is not None
    ]
    judged = pl.concat(rows).sort("session", maintain_order=True) if rows else pl.DataFrame()
    return answers_table(judged, names=2, more="; means over draws")


def _row(name: str, found: SessionOutcome, *, is_logged: bool) -> dict[str, Any]:
    """Return the row of one session and strategy; the logged outcome has no shares and no quantiles over draws."""
    outcomes = (
        outcome if is_logged else f"{outcome} {percent(share, None)}"
        for outcome, share in found.consensus.items()
    )
    time = None
    if found.decision_time_s is not None:
        ends = (found.decision_time_low_s, found.decision_time_high_s)
        low, high = (math.nan, math.nan) if is_logged or None in ends else ends
        time = with_limits(Estimate(found.decision_time_s, low or math.nan, high or math.nan), decimals=0)
    return {
        "session": found.session,
        "strategy": name,
        "consensus": ", ".join(outcomes) or None,
        "time": time,
        "undecided": found.undecided,
        "belief": found.belief_in_truth,
    }


def _outcome_rows(found: Sequence[SessionOutcome]) -> pl.DataFrame:
    """Return a row for each session and strategy, with the shares of draws by consensus in columns of their own."""
    return pl.DataFrame([flat_row(asdict(one), "consensus") for one in found], infer_schema_length=None)


def threshold_document(found: Recommendation) -> Document:
    """Return which threshold to use, others by several rules, and whether the floor can be decided with them."""
    chosen, in_use, unseen = found.chosen, found.in_use, found.unseen
    every = (*found.thresholds, in_use)
    (still, vibrating), (still_in_use, vibrating_in_use) = (
        (percent(one.all_samples.false_positive), percent(one.all_samples.false_negative))
        for one in (chosen, in_use)
    )
    return Document(
        title="Threshold of the sensor",
        answer=(
            f"Use theta_E = {_value(chosen)} ({chosen.rule}): {still} of the samples on still tiles read as vibrating, "
            f"{vibrating} of those on vibrating tiles as still; at the {number(in_use.value, in_use.decimals)} "
            f"{in_use.rule} {still_in_use} and {vibrating_in_use}.",
            _can_be_decided(chosen),
            _why_in_use_decides(chosen, in_use),
        ),
        warnings=(
            "" if chosen.tells_kinds_apart else _TELLS_NOTHING,
            _SELF_JUDGED if unseen is not None and unseen.is_empty() else "",
        ),
        parts=(
            _thresholds(every, found.margin_m),
            *if_any(unseen, lambda unseen: [_unseen(unseen, chosen.decimals)]),
            _profile(found.profile, found.thresholds[0]),
            *if_any(found.law, lambda law: [_law(law)]),
        ),
        data={
            "thresholds": pl.DataFrame(
                [flat_row(one.as_dict(), *_NESTED) for one in every], infer_schema_length=None
            ),
            "edge_profile": found.profile,
        },
    )


def _why_in_use_decides(chosen: Threshold, in_use: Threshold) -> str:
    """Return why the threshold in use decides this floor where the chosen one does not, and at what price.

    Robots take a floor for the wrong side if it lies between the boundary and the share of vibrating tiles at which the
    share of ones is the boundary; on any floor on one side of the boundary, if no floor has that share of ones.
    """
    decides, errors = in_use.decidable, in_use.all_samples
    right = (
        1.0 - errors.false_positive - errors.false_negative
    )  # slope of the share of ones over the fill ratio
    if decides.verdict != "decidable" or chosen.decidable.verdict == "decidable" or right <= 0.0:
        return ""
    boundary = decides.boundary
    balanced = min(max((decides.tested - errors.false_positive) / right, 0.0), 1.0)
    if abs(balanced - boundary) < 0.005:
        return ""
    fewer, below = ("fewer", "below") if balanced > boundary else ("more", "above")
    asked = stated_percent(boundary)
    ends = ((balanced, percent(balanced, None, digits=2)), (boundary, asked))
    (_, low), (_, high) = sorted(ends)
    return (
        f"The {number(in_use.value, in_use.decimals)} {in_use.rule} decides this floor only because it reads {fewer} "
        "samples as vibrating on any floor: "
        f"one with {low} to {high} vibrating tiles would be taken for {below} {asked}."
    )


_WITH_PLACES: Final = (
    "Strategies that read places: as if robots knew where the camera saw them, and in a replay {}, since logs do not "
    "say who heard what; samples without a row are left out."
)
_TELLS_NOTHING: Final = (
    "At this threshold samples on vibrating tiles do not read as vibrating more often than those on still tiles: "
    "energies do not tell them apart, and what robots would decide says nothing about the floor. Is the floor right, "
    "and does the sensor work?"
)
_SELF_JUDGED: Final = (
    "The session judges itself: the threshold was chosen by the same samples whose errors are shown."
)


def _unseen(unseen: pl.DataFrame, decimals: int) -> Table:
    """Return the errors of each session at a threshold, with so many decimals, that was chosen by the others."""
    columns = {
        "session": Column(decimals=0),
        "threshold": Column("theta_E of the others", decimals=decimals),
        "false_positive": Column("still read as vibrating", share=True),
        "false_negative": Column("vibrating read as still", share=True),
    }
    caption = (
        f"Each session at the threshold of the others ({unseen['rule'][0]}). In the first table sessions judge "
        "themselves."
    )
    return Table(unseen.drop("rule"), columns, caption, "unseen")


def _law(law: pl.DataFrame) -> Table:
    columns = {
        "value": Column(decimals=4, limits=("low", "high")),
        "error": Column("standard error", decimals=4),
    }
    caption = (
        "Law of the sensor, by maximum likelihood; errors and 95 % limits from a bootstrap over robots in sessions, "
        "with the error of the mean of as many tiles and robots."
    )
    return Table(law, columns, caption, "law")


def _value(found: Threshold) -> str:
    return with_limits(Estimate(found.value, found.low, found.high), decimals=found.decimals)


def _can_be_decided(one: Threshold) -> str:
    """Return whether the floor can be decided; a share of ones that is the same on any floor decides nothing."""
    return (
        one.decidable.says
        if one.tells_kinds_apart
        else "No: vibrating tiles do not read as vibrating more often than still ones."
    )


def _thresholds(thresholds: Sequence[Threshold], margin_m: float) -> Table:
    """Return a row for each rule: the threshold, its error rates, and whether the floor can be decided with it."""
    rows = [
        {
            "rule": one.rule,
            "value": _value(one),
            "still": _both(one.all_samples.false_positive, one.inner_samples.false_positive),
            "vibrating": _both(one.all_samples.false_negative, one.inner_samples.false_negative),
            "ones": with_limits(estimate_of(one.share_by_session), "%"),
            "says": _can_be_decided(one),
        }
        for one in thresholds
    ]
    columns = {
        "value": Column("theta_E"),
        "still": Column("still read as vibrating"),
        "vibrating": Column("vibrating read as still"),
        "ones": Column("share of ones"),
        "says": Column("can it be decided?", prose=True),
    }
    caption = (
        f"Thresholds. Errors: of all samples, and in brackets of those farther than {stated(1000 * margin_m)} mm from "
        "a tile of the other kind. Share of ones: tiles weighted equally, 95 % over sessions."
    )
    return Table(pl.DataFrame(rows), columns, caption, "thresholds")


def _both(all_samples: float, inner: float) -> str:
    return f"{percent(all_samples)} ({percent(inner)})"


def _profile(profile: pl.DataFrame, at: Threshold) -> Table:
    """Return the errors by distance to the nearest tile of the other kind; a dash where there are no samples."""
    rows = []
    for row in profile.to_dicts():
        from_mm, to_mm = 1000 * row["from_m"], 1000 * row["to_m"]
        rows.append(
            {
                "distance": f"{number(from_mm, 0)} mm or more"
                if math.isinf(to_mm)
                else f"{span((from_mm, to_mm), 0)} mm",
                "still": f"{percent(row['false_positive'])} of {row['still']}",
                "vibrating": f"{percent(row['false_negative'])} of {row['vibrating']}",
            }
        )
    columns = {"still": Column("still read as vibrating"), "vibrating": Column("vibrating read as still")}
    caption = f"Errors by distance to the nearest tile of the other kind, at {number(at.value, at.decimals)}."
    return Table(pl.DataFrame(rows), columns, caption, "edge_profile")


_NESTED: Final = ("all_samples", "inner_samples", "share_by_session", "decidable")
"""Numbers of a threshold that have names of their own."""


def write_pages(recording: Recording, folder: Path) -> list[str]:
    """Write a page and a picture of each session into ``folder``; return the names of the pages.

    The pages show beliefs. If these are not all logged, those of all sessions are computed by a replay, and the title
    of each page says so. The pictures show no beliefs, and decisions as logged. Pages show no gate if it is not known:
    that of the scenario is not the robots'.
    """

    names = []
    has_gate = recording.knows("decision.gate", "decision.min_observations")
    logged = recording.logs_beliefs
    with_replayed = recording if logged else with_beliefs(recording)
    at = "" if _knows_bits(recording) else " at an unknown threshold"
    replayed = f" (beliefs replayed{at}, not logged)"
    runs = recording.runs["run"].to_list()
    for run in runs:
        name = "run" if len(runs) == 1 else f"run-{run + 1}"
        write_run_picture(recording, folder / f"{name}.png", run)
        title = str(recording.sessions[run]["log"]) + ("" if logged else replayed)
        data = payload(with_replayed, run, title=title)
        data["rule"]["gated"] &= has_gate
        write_file(folder / f"{name}.html", page_html(data))
        names.append(f"{name}.html")
    return names
