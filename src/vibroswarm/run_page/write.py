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
from scipy.special import betainc

from vibroswarm.core.atomic_io import write_file
from vibroswarm.core.numbers import count, number
from vibroswarm.errors import InputError, check_kind
from vibroswarm.floors.floor import Floor
from vibroswarm.localisation.locate import is_estimated
from vibroswarm.observation.decision_boundary import expected_ones_on, readings_boundary
from vibroswarm.result import Result
from vibroswarm.run_page.payload import MapsOverTime, RunRecord, packed_column, payload
from vibroswarm.scenario.change_fields import change_words
from vibroswarm.scenario.fault_draws import fault_words
from vibroswarm.scenario.fault_fields import MOTION_FAULTS
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.statistics.map_figures import keeps_floor_map, maps_over_time
from vibroswarm.statistics.reports_over_time import (
    estimates_of,
    report_headings,
    reports_over_time,
    true_number_over_time,
)
from vibroswarm.statistics.robot_knowledge import true_places_notes
from vibroswarm.statistics.verdict import (
    Verdict,
    estimates_in_words,
    holds_opinions,
    strategy_name,
    verdict,
)
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
        InputError: ``result`` is no ``Result``, has no such run, was simulated without poses, or is of a
            recording without decisions; or its strategy or network is not loaded.
    """
    check_kind(result, Result, "result", "a Result, as simulate() returns")
    why_not = why_no_page(result)
    if why_not is not None or result.poses is None:
        raise InputError(f"no page can be made: {why_not}")
    floor, scenario = result.floor(run), result.scenario
    of_run = pl.col("run") == run
    summary = result.runs.filter(of_run).to_dicts()[0]
    floor_at_end, size_m = floor.at(summary["end_s"]), (scenario.arena.width_m, scenario.arena.height_m)
    rule = rule_of(scenario)
    found = None if scenario.task.name == "fill_ratio" else verdict(result, run)
    if found is not None:
        rule |= {"answers": list(found.answers), "asked_anew": found.asked_anew}
    return RunRecord(
        title=title or f"{count(scenario.swarm.robots, 'robot')} on {floor.name}",
        arena=dict(zip(("width_m", "height_m"), size_m, strict=True)),
        floor=floor,
        t_end_s=summary["end_s"],
        strategy=strategy_name(scenario.strategy.name),
        seed=result.seed,
        run=run,
        # That of the table of runs is the number that the task asks for, if it asks for one.
        fill_ratio=floor_at_end.fill_ratio_within(*size_m),
        consensus=summary["consensus"],
        consensus_time_s=summary["consensus_time_s"],
        truth=summary["truth"],
        poses=result.poses.filter(of_run),
        **{name: getattr(result, name).filter(of_run) for name in RECORDED_TABLES},
        rule=rule,
        body=body_of(scenario),
        tick_s=scenario.tick_s,
        expected_ones=expected_ones_on(scenario.sensor, floor_at_end, size_m)
        if rule["tested"] != rule["boundary"]
        else None,
        kinds=max(scenario.sensor.kinds, scenario.sensor.readings),
        estimates=None if found is None else _estimates_in(found),
        faults=() if result.faults is None else _faults_in(result.faults.filter(of_run)),
        places=None if result.places is None else result.places.filter(of_run),
        maps=_maps_of(result, run, summary["end_s"]),
        **_reports_of(result, run),
        notes=(*true_places_notes([scenario]), *_surface_notes(floor)),
        details=_details_of(result),
    )


RECORDED_TABLES: Final = ("motion", "observations", "inference", "robots")
"""Tables of a result of which the page holds the rows of its run."""


def rule_of(scenario: Scenario) -> dict[str, Any]:
    """Return how robots decide on the fill ratio, by the names that the page's scripts read.

    ``prior_belief`` is the belief before the first sample: P(share of ones < tested).
    """
    decision, strategy = scenario.decision, strategy_of(scenario.strategy.name)
    prior, tested = (decision.prior_alpha, decision.prior_beta), readings_boundary(scenario)
    read = fields_read(strategy)
    return {
        "credible_threshold": decision.credible_threshold,
        "boundary": decision.decision_boundary,
        "tested": float(tested),
        "prior_alpha": prior[0],
        "prior_beta": prior[1],
        "prior_belief": float(betainc(*prior, tested)),
        "min_observations": decision.min_observations,
        "gate": decision.gate,
        "gate_counts_current": decision.gate_counts_current,
        "gated": "min_observations" in read,
        "by_belief": "credible_threshold" in read,
        "answers": None,
        "asked_anew": False,
        "decides": strategy.decides,
        "opinions": holds_opinions(scenario),
    }


def body_of(scenario: Scenario) -> dict[str, Any]:
    """Return the geometry of a robot's body and rays, by the names that the page's scripts read."""
    rays = scenario.rays
    return {
        "radius_m": scenario.robot.body_radius_m,
        "ray_forward_m": rays.forward_m,
        "ray_sides_m": list(rays.side_m),
        "ray_angles_rad": [math.radians(angle) for angle in rays.angle_deg],
        "ray_range_m": rays.range_m,
        "ray_disc_radius_m": rays.disc_radius_m,
        "avoidance_threshold_m": scenario.walk.avoidance_threshold_mm / 1000.0,
    }


def _estimates_in(found: Verdict) -> dict[str, Any] | None:
    """Return what robots say to a task that asks for a number, in words; None if it asks for a decision.

    They are: the number asked for, the right one, the range of the estimates (empty if there are none), a sentence on
    how good they are, and the estimate of each robot.
    """
    if not found.estimated:
        return None
    told, sure = estimates_in_words(found)
    each = ["\u2013" if robot.estimate is None else number(robot.estimate, 3) for robot in found.robots]
    true = number(found.fill_ratio, digits=4)
    return {"asked": found.estimated, "true": true, "told": told, "sure": sure, "of_robots": each}


def _faults_in(faults: pl.DataFrame) -> tuple[dict[str, Any], ...]:
    """Return the faults of a run, by the names that the page's scripts read."""
    return tuple(
        {
            "robot": row["robot"],
            "fault": fault_words(row["fault"]),
            "from_s": row["from_s"],
            "stops": row["fault"] in MOTION_FAULTS,
        }
        for row in faults.to_dicts()
    )


def _details_of(result: Result) -> dict[str, Any]:
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
    if not floor.has_contrasts:
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
    samples = result.motion.filter(run=run).sort("robot", "sample").select("robot", "time_s")
    wide = told.pivot("name", index=["robot", "time_s"], values="value")
    values = samples.join(wide, on=["robot", "time_s"], how="left", maintain_order="left")
    headings, estimates = report_headings(result, names), estimates_of(result)
    truth = true_number_over_time(result, run)
    reports = tuple(
        {
            "name": headings[name],
            "values": packed_column(values[name].fill_null(math.nan).to_numpy().astype(np.float32)),
            "truth": truth if name in estimates else None,
        }
        for name in names
    )
    return {"reports": reports, "reported": len(every_name)}


def why_no_page(result: Result) -> str | None:
    """Return why no page can show the runs of a result, as a clause; None if one can."""
    if result.poses is None:
        return "no poses between samples were kept (simulate with poses=True)"
    return None


def write_run_page(result: Result, path: str | Path, run: int = 0) -> None:
    """Write the page of one run: a single file that a browser opens from disk; an existing file is replaced.

    Args:
        result: simulated with poses, or a recording. path: of the file. run: number of the run.
    Raises:
        InputError: as of ``record_of``, or ``path`` is no path or cannot be written.
        RunError: the disk is full or failed.
    """
    write_page(record_of(result, run), Path(path))
