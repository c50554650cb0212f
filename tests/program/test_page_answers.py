"""What the page says at first sight, in a real browser: question, outcome, gate, flags, places, band."""

from __future__ import annotations

import html
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from helpers.browser import Tabs
from helpers.page_browser import ACTORS, BLANK, Open, latest, settled, wait_until
from helpers.page_records import make_record, ruled
from vibroswarm import preset, simulate
from vibroswarm.observation.observe import kinds_at
from vibroswarm.run_page.payload import MapsOverTime, RunRecord
from vibroswarm.run_page.write import record_of


def test_it_opens_in_hidden_frames_and_draws_once_shown(tabs: Tabs, page_path: Path, tmp_path: Path) -> None:
    """By address and by content."""
    written = html.escape(page_path.read_text(encoding="utf-8"))
    ways = (f'src="{page_path.as_uri()}"', f'srcdoc="{written}"')
    around = tmp_path / "notebook.html"
    around.write_text(
        "".join(f'<iframe {way} style="display:none; width:900px; height:700px"></iframe>' for way in ways),
        encoding="utf-8",
    )
    page = tabs.open(around.as_uri(), viewport={"width": 1280, "height": 1500}, reduced_motion="reduce")
    frames = page.frames[1:]
    assert len(frames) == 2
    for frame in frames:
        wait_until(frame, "typeof vibroswarm === 'object'")
        assert frame.evaluate("innerWidth") == 0
        frame.evaluate("vibroswarm.seek(100)")
    page.evaluate("document.querySelectorAll('iframe').forEach((frame) => { frame.style.display = 'block' })")
    for frame in frames:
        wait_until(frame, "document.getElementById('arena-frame').clientWidth > 250")
        for canvas in ("floor", "past", "actors", "belief"):
            assert not frame.evaluate(BLANK, canvas), canvas
    assert [one for one in tabs.emptied() if one.startswith("error: ")] == []


@pytest.mark.parametrize("gate", ["total", "received", "own"])
def test_the_gate_opens_when_the_tables_say(open_page: Open, record: RunRecord, gate: str) -> None:
    """Observations counted here from the order of samples and the column of received messages."""
    least = 15
    tables = record.inference.join(record.motion, on=["run", "robot", "sample"])
    counted = {
        "total": pl.col("sample") + pl.col("messages_received"),
        "received": pl.col("messages_received"),
        "own": pl.col("sample"),
    }
    first = tables.filter(counted[gate] > least)["time_s"].min()
    assert isinstance(first, float)
    undecided = record.robots.with_columns(decision=pl.lit(-1, dtype=pl.Int8))
    page = open_page(of=ruled(record, {"gate": gate, "min_observations": least}, robots=undecided))
    assert page.evaluate("vibroswarm.gate().first_s") == pytest.approx(first, abs=1e-9)
    words = {"total": "observations, its own and received", "received": "received bits", "own": "own samples"}
    lead = page.inner_text("#belief-lead")
    assert f"only with more than {least} {words[gate]}: before {first:.1f} s it is too early" in lead


def test_no_gate_is_shown_that_was_not_in_force(open_page: Open, record: RunRecord) -> None:
    """Of a strategy without a gate, and where robots decided before it."""
    for rule in ({"gated": False}, {"min_observations": 100}):
        page = open_page(of=ruled(record, rule))
        assert page.evaluate("vibroswarm.gate().first_s") == 0
        assert "too early" not in page.inner_text("#belief-lead")


def test_only_robots_that_decide_by_their_belief_are_said_to(open_page: Open, record: RunRecord) -> None:
    """Others decide by rules that the page does not know, and some report no belief."""
    silent = record.inference.with_columns(belief_below=pl.lit(None, dtype=pl.Float64))
    by_rule = ruled(record, {"by_belief": False, "gated": False})
    pages = {
        "belief": (ruled(record, {"gated": False}), "Above 0.95 it decides mostly still", "beyond 0.95"),
        "rule": (by_rule, "It decides by a rule of its own.", "by a rule of its own"),
        "silent": (
            replace(by_rule, inference=silent),
            "These robots report no belief",
            "by a rule of its own",
        ),
    }
    for name, (shown, lead, decides) in pages.items():
        page = open_page(of=shown)
        assert lead in page.inner_text("#belief-lead")
        assert page.locator("#details div", has_text="Decides").locator("dd").inner_text() == decides
        heads = page.locator("#roster thead tr").last.locator("th").all_text_contents()
        assert ("p" in heads, "p then" in heads) == (name != "silent", name != "silent")
        columns = page.locator("#roster tbody tr").first.locator("th, td").count()
        assert columns == len(heads)  # a column that no robot has is left out, heads and cells alike


@pytest.mark.parametrize(
    ("strategy", "by_belief", "gated"),
    [("none", True, True), ("places", True, False), ("totals", False, False), ("dmvd", False, False)],
)
def test_how_robots_decide_is_read_from_their_strategy(strategy: str, by_belief: bool, gated: bool) -> None:
    scenario = preset("paper").with_values({"strategy.name": strategy, "run.t_end_s": 2.0})
    record = record_of(simulate(scenario, seed=1, segments=True))
    assert (record.rule["by_belief"], record.rule["gated"]) == (by_belief, gated)


def test_the_question_the_outcome_and_now_are_told_apart(open_page: Open, record: RunRecord) -> None:
    page = open_page("#t=10")
    share = f"{100 * record.fill_ratio:.1f}".removesuffix(".0")
    assert page.inner_text("#task") == f"Does more than 50 % of the floor vibrate? Truth: no ({share} %)."
    assert page.inner_text("[data-fact=votes] dd") == "3 of 5 say: mostly still\n2 of 5 undecided"
    assert page.inner_text("#verdict-more") == "Decided right: 3, wrong: 0."
    assert f"5, {200 * record.body['radius_m']:g} cm across" in page.text_content("#details")
    assert page.inner_text("#outcome-time") == "Outcome, at the end of the run (4 min 0 s)"
    assert page.inner_text(".now-line") == "Now, at 10.0 s\n0 of 5 decided"
    page.evaluate("vibroswarm.seek(100)")
    assert page.inner_text("#clock-minutes") == "1:40 / 4:00 min"
    assert page.inner_text("#now-time") == "100.0 s (1 min 40 s)"
    page.evaluate("vibroswarm.seek(119.97)")
    assert page.inner_text("#now-time") == "120.0 s (2 min 0 s)"  # not 1 min 60 s


def test_a_note_under_a_resting_pointer_follows_time(open_page: Open) -> None:
    page = open_page("#t=50")
    box = page.locator("#actors").bounding_box()
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    notes = []
    for time_s in (0.0, 120.0, 240.0):
        page.evaluate("(t) => vibroswarm.seek(t)", time_s)
        notes.append(page.text_content("#tooltip"))
    assert len(set(notes)) > 1
    page.mouse.move(0, 0)
    page.evaluate("vibroswarm.seek(60)")
    assert not page.locator("#tooltip").is_visible()


def test_flags_of_sixty_robots_stand_apart(open_page: Open, record: RunRecord) -> None:
    """Each decided robot has one flag, alone or with others; none lies on another."""
    chance = np.random.default_rng(5)
    row = record.robots.row(0, named=True)
    times = np.sort(np.append(chance.uniform(90, 240, 30), chance.uniform(150, 152, 29)))
    table = pl.DataFrame(
        [
            row
            | {"robot": i, "decision": i % 5 // 4, "decision_time_s": float(time), "belief_at_decision": 0.96}
            for i, time in enumerate(times)
        ]
        + [row | {"robot": 59, "decision": -1, "decision_time_s": None, "belief_at_decision": None}],
        schema=record.robots.schema,
    )
    flags = open_page(
        of=ruled(record, {"gated": False}, robots=table), viewport={"width": 900, "height": 700}
    ).evaluate("vibroswarm.flags()")
    assert sorted(robot for flag in flags for robot in flag["robots"]) == list(range(59))
    places = [flag["place"] for flag in flags]
    assert min(np.diff(places)) >= 2 * flags[0]["radius"]
    assert all(len({robot % 5 // 4 for robot in flag["robots"]}) == 1 for flag in flags)
    few = open_page().evaluate("vibroswarm.flags()")
    assert [len(flag["robots"]) for flag in few] == [1, 1, 1]


def test_the_scale_bar_is_as_long_as_it_says_and_covers_nothing(open_page: Open) -> None:
    """It is drawn below the floor, above the legend, and says something there."""
    page = open_page()
    bar = page.evaluate("vibroswarm.scaleBar()")
    width = page.locator("#arena-frame").evaluate("(frame) => frame.clientWidth")
    assert bar["words"] == "20 cm"
    assert bar["width"] == pytest.approx(0.2 * width, rel=0.01)
    frame, scale, legend = (
        page.locator(f"#{name}").bounding_box() for name in ("arena-frame", "scale", "legend")
    )
    assert scale["y"] >= frame["y"] + frame["height"]
    assert legend["y"] >= scale["y"] + scale["height"]
    inked = """() => document.getElementById("scale").getContext("2d")
        .getImageData(0, 0, scale.width, scale.height).data.some((value) => value > 0)"""
    assert page.evaluate(inked)


NARROW = {"width": 800, "height": 800}
"""A window in one column: the arena is as wide as the page, whatever the height of its legend."""


def test_believed_places_lie_where_the_table_says_and_can_be_switched_off(
    open_page: Open, record: RunRecord
) -> None:
    chance = np.random.default_rng(8)
    off = chance.normal(0, 0.04, (2, len(record.motion)))
    places = record.motion.select(
        "robot",
        "sample",
        x_m=pl.col("x_m") + pl.Series(off[0]),
        y_m=pl.col("y_m") + pl.Series(off[1]),
        heading_rad="heading_rad",
        spread_m=pl.lit(0.04),
        lagged_sample=pl.when(pl.col("sample") >= 4).then(pl.col("sample") - 4),
        lagged_x_m=pl.when(pl.col("sample") >= 4).then(pl.col("x_m") / 2),
        lagged_y_m=pl.when(pl.col("sample") >= 4).then(pl.col("y_m") / 2),
        lagged_spread_x_m=pl.lit(0.02),
        lagged_spread_y_m=pl.lit(0.03),
    )
    page = open_page(of=replace(record, places=places.reverse()), viewport=NARROW)
    for robot in (0, 3):
        row = latest(record, robot, 101.37)
        told = places.filter((pl.col("robot") == robot) & (pl.col("sample") == row["sample"])).to_dicts()[0]
        drawn = page.evaluate("(id) => vibroswarm.place(id, 101.37)", robot)
        assert [drawn[name] for name in ("x", "y", "heading", "spread", "trueX", "trueY")] == pytest.approx(
            [told["x_m"], told["y_m"], told["heading_rad"], 0.04, row["x_m"], row["y_m"]], abs=1e-6
        )
        smoothed = page.evaluate("(id) => vibroswarm.smoothed(id, 101.37)", robot)
        of = record.motion.filter(
            (pl.col("robot") == robot) & (pl.col("sample") == row["sample"] - 4)
        ).to_dicts()[0]
        assert list(smoothed.values()) == pytest.approx(
            [of["sample"], row["x_m"] / 2, row["y_m"] / 2, 0.02, 0.03, of["x_m"], of["y_m"]], abs=1e-6
        )
    assert page.evaluate("vibroswarm.smoothed(0, 5)") is None
    page.evaluate("vibroswarm.seek(101.37)")
    plain = open_page("#t=101.37", viewport=NARROW)
    assert page.evaluate(ACTORS) != plain.evaluate(ACTORS)
    page.uncheck("#layer-places")
    assert settled(page)["time_s"] == 101.37
    assert page.evaluate(ACTORS) == plain.evaluate(ACTORS)
    assert plain.locator("#layer-places").count() == 0


def test_the_map_grows_and_strategies_without_counts_have_no_posteriors(
    open_page: Open, record: RunRecord
) -> None:
    """Maps as given, by robot and pooled, at the latest time before; the tile's note says the number."""
    rows, columns = record.floor.tiles.shape
    robots = record.robots.height
    beliefs = np.random.default_rng(5).random((41, robots + 1, rows * columns))
    time_s = np.linspace(0.0, record.t_end_s, 41)
    uncounted = record.inference.with_columns(alpha=pl.lit(None, pl.UInt32), beta=pl.lit(None, pl.UInt32))
    page = open_page(
        of=replace(record, maps=MapsOverTime(time_s, beliefs), inference=uncounted), viewport=NARROW
    )
    for t in (0.0, 101.37, record.t_end_s):
        at = np.searchsorted(time_s, t, side="right") - 1
        for tile in (0, rows * columns - 1):
            for robot in (0, robots - 1, None):
                drawn = page.evaluate("([i, t, id]) => vibroswarm.mapBelief(i, t, id)", [tile, t, robot])
                of = robots if robot is None else robot
                assert drawn == pytest.approx(beliefs[at, of, tile], abs=0.5 / 255 + 1e-9)
    page.evaluate("vibroswarm.seek(101.37)")
    with_map = page.evaluate(ACTORS)
    page.uncheck("#layer-map")
    assert settled(page)["time_s"] == 101.37
    plain = open_page("#t=101.37", viewport=NARROW)
    assert with_map != page.evaluate(ACTORS) == plain.evaluate(ACTORS)
    assert plain.locator("#layer-map").count() == 0
    assert page.locator("#cards").is_hidden()
    assert plain.locator("#cards").is_visible()
    assert page.locator("#roster [data-column=alpha]").count() == 0
    assert "NaN" not in page.locator("body").inner_text()


def test_robots_that_exchange_opinions_have_decided_when_they_agree(
    open_page: Open, record: RunRecord
) -> None:
    """Their opinions, which may change, were counted as decisions from the first sample on."""
    opinions = record.inference.with_columns(decision=pl.lit(0, dtype=pl.Int8))
    agreed = record.robots.with_columns(decision=pl.lit(0, dtype=pl.Int8), decision_time_s=pl.lit(101.0))
    page = open_page(of=ruled(record, {"decides": "opinion"}, inference=opinions, robots=agreed))
    for time_s, decided in ((100.0, "0"), (101.0, "5")):
        page.evaluate("(t) => vibroswarm.seek(t)", time_s)
        assert page.text_content("#now-decided") == decided


def test_many_beliefs_are_a_band_and_one_line_under_the_pointer(open_page: Open) -> None:
    """The band's numbers against those of the tables, at three times."""
    crowd = make_record(robots=20, t_end_s=60.0, seed=4, min_observations=60)
    page = open_page(of=crowd)
    band = page.evaluate("vibroswarm.band()")
    assert band[0]["low"] == band[0]["mean"] == band[0]["high"] == pytest.approx(0.5)
    for point in (band[len(band) // 3], band[len(band) // 2], band[-1]):
        beliefs = sorted(latest(crowd, robot, point["t"])["belief_below"] for robot in crowd.robots["robot"])
        assert point["mean"] == pytest.approx(np.mean(beliefs))
        assert (point["low"], point["high"]) == (beliefs[2], beliefs[-3])
    assert "Band: the middle 80 % of the robots" in page.inner_text("#belief-lead")
    shown = "document.getElementById('belief').toDataURL()"
    before = page.evaluate(shown)
    box = page.locator("#belief").bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    assert settled(page)["hovered"] in range(20)
    assert page.evaluate(shown) != before
    page.mouse.move(0, 0)
    assert settled(page)["hovered"] is None
    assert page.evaluate(shown) == before
    page.check("#layer-lines")
    assert page.evaluate(shown) != before
    assert "Band" not in open_page().inner_text("#belief-lead")


GREYS = """(item) => {
  const context = item.querySelector("canvas").getContext("2d");
  const { data } = context.getImageData(5, 4, 10, 8);
  return new Set(data.filter((_, i) => i % 4 === 1)).size;
}"""
"""How many shades the middle of a swatch of the legend has, in one channel of colour."""


def test_kinds_of_tile_and_patches_are_shown(open_page: Open) -> None:
    """Decisions, legend and marks of three kinds; a patch is painted over still tiles."""

    short = preset("paper").with_values({"run.t_end_s": 200.0, "decision.min_observations": 20})
    three = short.with_values(
        {
            "sensor.model": "confusion",
            "floor.source": "random:0.2,0.2,0.6",
            "task.name": "majority",
            "strategy.name": "dirichlet",
        }
    )
    result = simulate(three, 2, 1, segments=True)
    assert set(result.robots["decision"]) == {2}
    page = open_page("#t=150", of=result, reduced_motion="reduce")  # colours do not fade into each other
    assert "it says \u201ckind 2 is most common\u201d" in page.inner_text("#verdict-line")
    answers = [f"\u201ckind {kind} is most common\u201d" for kind in range(3)]
    assert page.inner_text("#task").startswith(f"{answers[0]}, {answers[1]} or {answers[2]}?")
    assert "read kind 2" in page.inner_text("body")
    swatches = page.locator(".legend-item", has_text=re.compile("^kind")).all()
    assert [swatch.evaluate(GREYS) > 1 for swatch in swatches] == [False, True, True]  # waves, and lines
    pips = "[...document.querySelectorAll('#pips li')].map((pip) => getComputedStyle(pip).backgroundColor)"
    page.evaluate("vibroswarm.seek(200)")
    assert set(page.evaluate(pips)) == {"rgb(29, 122, 58)"}
    marks = pips.replace("#pips li", "#scrub-marks i")
    assert set(page.evaluate(marks)) == {"rgb(29, 122, 58)"}  # they had the colour of kind 0
    assert "of 5 say: \u201ckind 2" in page.inner_text("#facts")
    lead = page.inner_text("#belief-lead")  # without beliefs, the gate alone says why nobody decided before
    assert "report no belief" in lead
    assert "only with more than 20 observations" in lead
    assert "Share of kind 1" in page.inner_text("#details")
    read = result.observations["observation"].to_numpy()
    kind = result.floor(0).tiles.ravel()[result.observations["tile"].to_numpy()]
    assert f"{round(100 * (read != kind).mean(), 1):g} % misread" in page.inner_text("#facts")
    patched = simulate(short.with_values({"floor.source": "patch:0.4"}), 1, 1, segments=True)
    page = open_page("#t=150", of=patched)
    on = patched.floor(0).contrast_at(patched.motion["x_m"], patched.motion["y_m"]) > 0
    bits = patched.observations["observation"].to_numpy()
    assert f"{round(100 * (bits != on).mean(), 1):g} % misread" in page.inner_text("#facts")
    assert not page.evaluate(BLANK, "floor")


def test_a_floor_that_changes_is_shown_as_it_is_at_the_time(open_page: Open) -> None:

    values = {"floor.source": "stripe:0.48", "run.t_end_s": 120.0, "change.at_s": 60, "change.to": "invert"}
    result = simulate(preset("paper").with_values(values), 2, 1, segments=True)
    page = open_page("#t=0", of=result)
    drawn = []
    for time_s in (59.0, 60.0, 59.0):
        page.evaluate("t => vibroswarm.seek(t)", time_s)
        drawn.append(page.evaluate('document.getElementById("floor").toDataURL()'))
    assert drawn[0] == drawn[2] != drawn[1]
    assert page.inner_text("#task").endswith("Truth at the end: yes (52 %).")
    page.evaluate("t => vibroswarm.seek(t)", 120.0)
    seen = result.observations
    kinds = kinds_at(result.floor(0), seen["tile"].to_numpy(), result.motion["time_s"].to_numpy())
    at_first = result.floor(0).tiles.ravel()[seen["tile"].to_numpy()]
    shares = [round(100 * (seen["observation"].to_numpy() != now).mean(), 1) for now in (kinds, at_first)]
    assert f"{shares[0]:g} % misread" in page.inner_text("#facts")
    assert shares[1] > shares[0] + 10, "by the floor at time 0 it would be another share"


STOPS = np.array([[0, 34, 78], [65, 77, 107], [124, 123, 120], [188, 174, 108], [254, 232, 56]])
CORNER = """id => {
  const copy = document.createElement("canvas"), context = copy.getContext("2d", { willReadFrequently: true });
  context.drawImage(document.getElementById(id), 0, 0);
  return Array.from(context.getImageData(3, 3, 1, 1).data).slice(0, 3);
}"""


def test_the_map_stands_beside_its_uncertainty(open_page: Open, record: RunRecord) -> None:
    """The first tile has the colours of its probability and standard deviation, of all samples or of one robot."""
    rows, columns = record.floor.tiles.shape
    robots = record.robots.height
    beliefs = np.random.default_rng(6).random((41, robots + 1, rows * columns))
    time_s = np.linspace(0.0, record.t_end_s, 41)
    page = open_page("#t=100", of=replace(record, maps=MapsOverTime(time_s, beliefs)))
    assert page.is_visible("#map-section")
    for t, robot in ((100.0, None), (record.t_end_s, None), (100.0, 0)):
        page.evaluate("t => vibroswarm.seek(t)", t)
        if robot is not None:
            page.keyboard.press(str(robot))
            settled(page)
        at = np.searchsorted(time_s, t, side="right") - 1
        p = np.rint(255 * beliefs[at, robots if robot is None else robot, 0]) / 255  # as the page has it
        for canvas, share in (("map-probability", p), ("map-uncertainty", np.sqrt(p * (1 - p)) / 0.5)):
            colour = [np.interp(4 * share, range(5), STOPS[:, k]) for k in range(3)]
            assert page.evaluate(CORNER, canvas) == pytest.approx(colour, abs=1.5), (t, robot, canvas)
    plain = open_page("#t=100")
    assert not plain.is_visible("#map-section")


def test_it_shows_what_robots_report_as_time_goes_on(
    open_page: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vibroswarm.run_page.write.MOST_REPORTS", 1)
    scenario = preset("paper").with_values(
        {"strategy.name": "mcp", "run.t_end_s": 200.0, "task.name": "share"}
    )
    result = simulate(scenario, 3, 1, segments=True)
    page = open_page("", of=result, reduced_motion="reduce")
    assert page.inner_text("#reports-title") == "What robots report"
    assert page.inner_text("#reports-lead").endswith("Dashed: the true number. The first 1 of 2 values.")
    assert result.reports is not None
    times = result.motion.select("robot", "sample", "time_s")
    told = result.reports.filter(pl.col("name") == "estimate").join(times, on=["robot", "sample"])
    first_s = told.filter(pl.col("robot") == 1)["time_s"].min()
    for robot, at_s in ((0, 50.0), (1, first_s), (3, 120.0), (4, 200.0)):
        last = told.filter((pl.col("robot") == robot) & (pl.col("time_s") <= at_s)).sort("time_s")["value"][
            -1
        ]
        assert page.evaluate(f"vibroswarm.reported('estimate', {robot}, {at_s})") == pytest.approx(
            last, abs=1e-6
        )
    assert page.evaluate("vibroswarm.reported('estimate', 0, 0)") is None
    page.evaluate("vibroswarm.seek(200)")
    mean = told.group_by("robot", maintain_order=True).last()["value"].mean()
    assert isinstance(mean, float)
    assert page.inner_text("#reports figcaption >> nth=0") == f"estimate mean {mean:.3g}"
    for chart in page.locator("#reports canvas").all():
        chart.evaluate("canvas => { canvas.id = 'chart' }")
        assert not page.evaluate(BLANK, "chart")
        chart.evaluate("canvas => { canvas.id = '' }")
    assert open_page().locator("#reports-section").is_hidden()  # robots that report nothing


def test_a_task_that_asks_for_a_number_is_answered_by_estimates(open_page: Open) -> None:
    """The share of still tiles, which is not the fill ratio that the page shows too."""
    values = {"strategy.name": "dirichlet", "task.name": "share", "task.share.kind": 0, "run.t_end_s": 60.0}
    result = simulate(preset("paper").with_values(values), seed=1, segments=True)
    page = open_page(of=result)
    assert page.inner_text("#task") == "What is the share of tiles of kind 0? Truth: 0.52."
    assert page.inner_text("#verdict-badge") == "Estimates"
    estimates = result.robots["estimate"]
    assert page.inner_text("#verdict-line") == f"The robots estimate {estimates[0]:.3f}."
    assert page.inner_text("#verdict-more").startswith(f"Mean error {(estimates - 0.52).abs().mean():.3g}")
    of_decisions = page.locator("[data-fact=consensus], [data-fact=certainty]")
    assert of_decisions.count() == 0
    cells = page.locator("#roster [data-column=estimate]").all_text_contents()
    assert [float(cell) for cell in cells] == [round(estimate, 3) for estimate in estimates]
    assert page.locator("#details div", has_text="Fill ratio").locator("dd").inner_text() == "0.48"


def test_beside_another_boundary_no_robot_says_still(open_page: Open) -> None:
    """Robots that said "less than 90 %" of a floor of 40 % were said to say "still"."""
    values = {
        **{"floor.source": "random:0.4", "decision.decision_boundary": 0.9, "decision.boundary_of": "tiles"},
        **{"decision.min_observations": 20, "run.t_end_s": 100.0},
    }
    page = open_page(of=simulate(preset("paper").with_values(values), seed=1, segments=True))
    said = set(page.locator("#roster [data-column=decision]").all_text_contents())
    assert {words.split()[0] for words in said} <= {"less", "more", "undecided"}
    assert said != {"undecided"}


def test_tiles_that_are_no_squares_and_a_run_without_samples(open_page: Open) -> None:
    long = {"arena.width_m": 10.0, "arena.height_m": 0.3, "swarm.robots": 2, "run.t_end_s": 1.0}
    page = open_page(of=simulate(preset("paper").with_values(long), seed=1, segments=True))
    floor = page.locator("#details div", has_text="Floor").locator("dd").inner_text()
    assert floor == "5 rows \u00d7 5 columns, tiles of 200 cm \u00d7 6 cm, random:0.48"
    assert page.inner_text("[data-fact=samples] dd") == "0"
    assert page.inner_text("#verdict-line") == "No robot has decided."


def test_readings_of_values_are_not_misread(open_page: Open) -> None:
    hill = {"floor.source": "gradient:0..1", "decision.boundary_of": "tiles", "task.name": "mean"}
    result = simulate(preset("paper").with_values({**hill, "run.t_end_s": 30.0}), seed=1, segments=True)
    page = open_page(of=result)
    assert page.inner_text("[data-fact=samples] dd") == str(result.motion.height)
    assert "misread" not in page.inner_text("body")


def test_robots_that_tell_a_change_do_not_decide_by_a_belief(open_page: Open) -> None:
    tells = {"strategy.name": "reset", "task.name": "changed", "strategy.reset.tells_change": True}
    inverted = {"floor.source": "random:0.4", "change.at_s": 20.0, "change.to": "invert", "run.t_end_s": 30.0}
    result = simulate(preset("paper").with_values(tells | inverted), seed=1, segments=True)
    page = open_page(of=result)
    decides = page.locator("#details div", has_text="Decides").locator("dd").inner_text()
    assert decides == "after more than 381 readings, own and received"
    assert "hatched right of 0.5" in page.inner_text("#posterior-lead")
    assert page.locator(".card-belief").count() == 0


def test_where_each_robot_is_asked_anew_no_answer_is_called_wrong(open_page: Open, record: RunRecord) -> None:
    rule = {"answers": ("as it was", "changed"), "asked_anew": True}
    page = open_page(of=ruled(record, rule, consensus="truth_undefined"))
    assert "Truth: depends on the last answer of each robot" in page.inner_text("#task")
    assert "so some answers may be right" in page.inner_text("#verdict-more")


def test_a_threshold_near_one_is_told_as_it_is_and_no_belief_is_one(
    open_page: Open, record: RunRecord
) -> None:
    """A belief of 1 is one that was rounded to it."""
    certain = {
        "inference": record.inference.with_columns(
            belief_below=pl.when(pl.col("robot") == 2).then(0.02).otherwise(1.0)
        ),
        "robots": record.robots.with_columns(
            belief_at_decision=pl.when(pl.col("robot") == 2).then(0.0).otherwise(1.0),
            decision=(pl.col("robot") == 2).cast(pl.Int8),
        ),
    }
    page = open_page("#t=200", of=ruled(record, {"credible_threshold": 1 - 1e-9}, **certain))
    assert "below 1e-9 mostly vibrating" in page.inner_text("#belief-lead")
    assert set(page.locator("#roster [data-column=belief]").all_text_contents()) == {"> 0.999", "0.020"}
    assert page.inner_text("[data-fact=certainty] dd") == "> 0.999\nlowest > 0.999"
