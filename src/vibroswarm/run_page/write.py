"""Write a run's web page: one HTML file with its style, font and scripts and the run's data."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import math
import re
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.analysis.floor_maps import keeps_floor_map, maps_over_time
from vibroswarm.analysis.message_log import MessageLog, log_size, message_log
from vibroswarm.analysis.reports_over_time import estimates_of, report_headings, reports_over_time
from vibroswarm.analysis.true_places import true_places_notes
from vibroswarm.analysis.verdict import (
    estimates_in_words,
    holds_opinions,
    strategy_name,
    verdict,
)
from vibroswarm.core.atomic_io import write_file
from vibroswarm.core.numbers import count, number
from vibroswarm.errors import InputError, check_kind, path_of
from vibroswarm.floors.floor import Floor
from vibroswarm.localisation.locate import is_estimated
from vibroswarm.networks import network as network_of
from vibroswarm.observation.decision_boundary import expected_ones_on, readings_boundary
from vibroswarm.result import Result
from vibroswarm.run_page.payload import (
    Estimates,
    MapsOverTime,
    ReportOverTime,
    RunRecord,
    fault_rows,
    payload,
)
from vibroswarm.scenario.change_fields import change_words
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.strategies import strategy as strategy_of
from vibroswarm.strategies.static_analysis import fields_read

SCRIPTS = (
    "decode.js",
    "run.js",
    "beta.js",
    "rays.js",
    "words.js",
    "gate.js",
    "theme.js",
    "canvas.js",
    "glyphs.js",
    "floor_layer.js",
    "layers.js",
    "faults.js",
    "samples_layer.js",
    "trails.js",
    "robots.js",
    "places.js",
    "map_layer.js",
    "map_view.js",
    "report_charts.js",
    "radio.js",
    "zoom.js",
    "arena.js",
    "belief_axes.js",
    "belief_band.js",
    "belief_chart.js",
    "events.js",
    "posteriors.js",
    "verdict.js",
    "roster.js",
    "details.js",
    "tooltip.js",
    "arena_tooltip.js",
    "export.js",
    "player.js",
    "keyboard.js",
    "address.js",
    "main.js",
)
"""The scripts in the order of the page: each uses only earlier ones."""


def page_html(record: RunRecord) -> str:
    """Return one run as an HTML document that needs no server, network or other file."""
    script = "\n".join(_asset(name) for name in SCRIPTS)
    document = _asset("page.html")
    parts = {
        # Lone surrogates, which cannot be written as UTF-8, become question marks.
        "title": html.escape(record.title.encode("utf-8", "replace").decode("utf-8")),
        "style": _font_faces() + _asset("page.css"),
        "script": script,
        "script_hash": _script_hash(document, script),
        "data": script_json(payload(record)),
    }
    # One pass over the template: text such as {{script}} in the title or in the data stays as it is.
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], document)


WEIGHTS: Final = {400: "100 500", 700: "501 900"}
"""Weights of the page's font that are shipped, each with the range of weights that it is used for."""


def _font_faces() -> str:
    """Return the style rules with the page's font inside, so that all machines show the same page."""
    rules = []
    for weight, range_of in WEIGHTS.items():
        data = files("vibroswarm.run_page").joinpath("assets", f"roboto-{weight}.woff2").read_bytes()
        text = base64.b64encode(data).decode("ascii")
        rules.append(
            f'@font-face {{ font-family: "Roboto embedded"; font-weight: {range_of}; '
            f'src: url(data:font/woff2;base64,{text}) format("woff2"); }}\n'
        )
    return "".join(rules)


def _script_hash(document: str, script: str) -> str:
    """Return the hash of the page's script element; the page's content security policy allows no other script.

    It is the single ``<script>`` without attributes; that with the data is not run, and needs no hash.
    """
    (code,) = re.findall(r"<script>(.*?)</script>", document, flags=re.DOTALL)
    digest = hashlib.sha256(code.replace("{{script}}", script).encode()).digest()
    return f"sha256-{base64.b64encode(digest).decode()}"


def write_page(record: RunRecord, path: Path) -> None:
    """Write the page of a run to ``path``, completely or not at all; an existing file is replaced.

    Raises:
        InputError: ``path`` is a folder, or its folder cannot be written to.
        RunError: the disk is full or failed.
    """
    write_file(path, page_html(record))


def script_json(value: Any) -> str:
    """Return JSON that is safe in a script element: no text in it can end the element or open a comment.

    Raises:
        ValueError: a number is not finite.
    """
    # ASCII only, so that U+2028, a line end in older scripts, is escaped too.
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _asset(name: str) -> str:
    return files("vibroswarm.run_page").joinpath("assets", name).read_text(encoding="utf-8")


def record_of(result: Result, run: int = 0, *, title: str = "") -> RunRecord:
    """Collect the content of the page of one run from a result.

    Args:
        result: simulated, or of a recording (without a seed). run: number of the run. title: heading of the page; by
            default the number of robots and the name of the floor.
    Raises:
        InputError: ``result`` is no ``Result``, has no such run, was simulated without segments, or is of a recording
            without decisions; or its strategy or network is not loaded.
    """
    check_kind(result, Result, "result", "a Result, as simulate() returns")
    why_not = why_no_page(result)
    if why_not is not None or result.segments is None:
        raise InputError(f"no page can be made: {why_not}")
    floor, scenario = result.floor(run), result.scenario
    of_run = pl.col("run") == run
    summary = result.runs.filter(of_run).to_dicts()[0]
    floor_at_end = floor.at(summary["end_s"])
    return RunRecord(
        title=title or f"{count(scenario.swarm.robots, 'robot')} on {floor.name}",
        floor=floor,
        t_end_s=summary["end_s"],
        seed=result.seed,
        run=run,
        # That of the table of runs is the number that the task asks for, if it asks for one.
        fill_ratio=floor_at_end.fill_ratio_within(scenario.arena.width_m, scenario.arena.height_m),
        consensus=summary["consensus"],
        consensus_time_s=summary["consensus_time_s"],
        truth=summary["truth"],
        segments=result.segments.filter(of_run),
        **{name: getattr(result, name).filter(of_run) for name in RECORDED_TABLES},
        faults=() if result.faults is None else fault_rows(result.faults.filter(of_run)),
        places=None if result.places is None else result.places.filter(of_run),
        maps=_maps_of(result, run, summary["end_s"]),
        radio=_radio_of(result, run),
        **_reports_of(result, run),
        notes=(*true_places_notes([scenario]), *_surface_notes(floor)),
        details=_details_of(result),
        **_rules_of(scenario, floor_at_end),
        **_asked(result, run),
        **_bodies_of(scenario),
    )


RECORDED_TABLES: Final = ("motion", "observations", "inference", "robots")
"""Tables of a result of which the page holds the rows of its run."""


def _rules_of(scenario: Scenario, floor_at_end: Floor) -> dict[str, Any]:
    """Return how robots read and decide, by name of the record's field."""
    decision = scenario.decision
    boundary, tested = decision.decision_boundary, readings_boundary(scenario)
    size_m = (scenario.arena.width_m, scenario.arena.height_m)
    strategy = strategy_of(scenario.strategy.name)
    read = fields_read(strategy)
    return {
        "strategy": strategy_name(scenario.strategy.name),
        "decides": strategy.decides,
        "opinions": holds_opinions(scenario),
        "min_observations": decision.min_observations,
        "gate": decision.gate,
        "gate_counts_current": decision.gate_counts_current,
        "gated": "min_observations" in read,
        "credible_threshold": decision.credible_threshold,
        "decides_by_belief": "credible_threshold" in read,
        "decision_boundary": boundary,
        "readings_boundary": tested,
        "expected_ones": expected_ones_on(scenario.sensor, floor_at_end, size_m)
        if tested != boundary
        else None,
        "prior_alpha": decision.prior_alpha,
        "prior_beta": decision.prior_beta,
        "kinds": max(scenario.sensor.kinds, scenario.sensor.readings),
    }


def _asked(result: Result, run: int) -> dict[str, Any]:
    """Return what the task asks for, if that is not the majority, and what the robots estimate."""
    if result.scenario.task.name == "fill_ratio":
        return {}
    found = verdict(result, run)
    estimates = None
    if found.estimated:
        of_robots = (
            "\u2013" if robot.estimate is None else number(robot.estimate, 3) for robot in found.robots
        )
        true = number(found.fill_ratio, digits=4)
        estimates = Estimates(found.estimated, true, *estimates_in_words(found), tuple(of_robots))
    return {"answers": found.answers, "estimates": estimates, "asked_anew": found.asked_anew}


def _bodies_of(scenario: Scenario) -> dict[str, Any]:
    """Return the arena, the robots' bodies and their rays, by name of the record's field."""
    rays = scenario.rays
    return {
        "arena_width_m": scenario.arena.width_m,
        "arena_height_m": scenario.arena.height_m,
        "tick_s": scenario.tick_s,
        "body_radius_m": scenario.robot.body_radius_m,
        "ray_forward_m": rays.forward_m,
        "ray_sides_m": tuple(rays.side_m),
        "ray_angles_rad": tuple(math.radians(angle) for angle in rays.angle_deg),
        "ray_range_m": rays.range_m,
        "ray_disc_radius_m": rays.disc_radius_m,
        "avoidance_threshold_m": scenario.walk.avoidance_threshold_mm / 1000.0,
    }


def _details_of(result: Result) -> dict[str, Any]:
    """Return what made the result, by name."""
    scenario = result.scenario
    version_names = ("vibroswarm", "python", "numpy", "numba", "architecture", "code")
    return {
        "scenario": scenario.hash,
        "motion": result.source,
        **({"change": changes} if (changes := change_words(scenario.change)) else {}),
        **{name: result.versions[name] for name in version_names if name in result.versions},
    }


def _surface_notes(floor: Floor) -> tuple[str, ...]:
    """Return what the page does not show of a floor's values, as a sentence; nothing if it has none."""
    if floor.surface.values is None:
        return ()
    return ("Tiles have values between still and vibrating; those of 0.5 and above are drawn as vibrating.",)


MAP_TIMES: Final = 41
"""Number of times of a run at which a page shows maps."""
MAX_MAPS: Final = 1_000_000
"""Largest number of values (times, maps, tiles) for which a page shows all maps, and not only the pooled map."""


def _maps_of(result: Result, run: int, end_s: float) -> MapsOverTime | None:
    """Return the robots' maps and the pooled map of a run at ``MAP_TIMES`` times up to its end, ``end_s``.

    If all these maps would be too large for a page, only the pooled map is returned. The result is None if the robots
    keep no maps, or if the maps cannot be recomputed (a recording, or a result without the moves that estimated places
    need).
    """
    if not keeps_floor_map(result.scenario) or result.seed is None:
        return None
    if is_estimated(result.scenario) and result.moves is None:
        return None
    time_s = np.linspace(0.0, end_s, MAP_TIMES)
    beliefs = maps_over_time(result, run, time_s)
    pooled = beliefs[:, -1:]  # the last map at each time
    return MapsOverTime(time_s, beliefs if beliefs.size <= MAX_MAPS else pooled)


MOST_REPORTS: Final = 12
"""Most values that a page shows of what robots report, the first ones."""


def _reports_of(result: Result, run: int) -> dict[str, Any]:
    """Return what robots reported after each sample of a run, sorted by robot and sample, and how many values.

    The keys are names of the record's fields.
    """
    told = reports_over_time(result, run)
    if told.is_empty():
        return {}
    every_name = told["name"].unique(maintain_order=True).to_list()
    names = every_name[:MOST_REPORTS]
    samples = result.motion.filter(pl.col("run") == run).sort("robot", "sample").select("robot", "time_s")
    wide = told.pivot("name", index=["robot", "time_s"], values="value")
    values = samples.join(wide, on=["robot", "time_s"], how="left", maintain_order="left")
    headings, estimates = report_headings(result, names), estimates_of(result)
    truth = result.runs.filter(pl.col("run") == run)["fill_ratio"][0]
    reports = tuple(
        ReportOverTime(
            headings[name],
            values[name].fill_null(math.nan).to_numpy().astype(np.float32),
            truth if name in estimates else None,
        )
        for name in names
    )
    return {"reports": reports, "reported": len(every_name)}


MAX_RADIO: Final = 4_000_000
"""Most messages times robots (one byte each) for which a page shows which robots heard each message."""


def _radio_of(result: Result, run: int) -> MessageLog | None:
    """Return the log of a run's messages, which tells which robots heard each of them.

    The result is None if every message reaches all robots at once (the ideal network), if the messages cannot be
    recomputed (a recording, or a result without the moves that the network reads), or if they are too many for a page.
    """
    network = network_of(result.scenario.network.name)
    if result.seed is None or network.name == "ideal" or (network.reads_positions and result.moves is None):
        return None
    return message_log(result, run) if log_size(result, run) <= MAX_RADIO else None


def why_no_page(result: Result) -> str | None:
    """Return why no page can show the runs of a result, as a clause; None if one can."""
    if result.segments is None:
        return "no positions between samples were kept (segments=True keeps those of a source that has them)"
    return None


def write_run_page(result: Result, path: str | Path, run: int = 0) -> None:
    """Write the page of one run: a single file that a browser opens from disk; an existing file is replaced.

    Args:
        result: simulated with segments, or a recording. path: of the file. run: number of the run.
    Raises:
        InputError: as of ``record_of``, or ``path`` is no path or cannot be written.
        RunError: the disk is full or failed.
    """
    path = path_of(path)
    write_page(record_of(result, run), path)
