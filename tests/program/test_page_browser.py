"""The page in a real browser: it draws, plays, obeys, shows the tables' numbers, and asks for nothing."""

from __future__ import annotations

import html
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from helpers.page_records import make_record
from vibroswarm.analysis.message_log import MessageLog
from vibroswarm.run_page.payload import RunRecord
from vibroswarm.run_page.write import write_page

BLANK = """(id) => {
  const canvas = document.getElementById(id);
  const copy = document.createElement("canvas");
  [copy.width, copy.height] = [canvas.width, canvas.height];
  const context = copy.getContext("2d", { willReadFrequently: true });
  context.drawImage(canvas, 0, 0);
  const seen = new Set(new Uint32Array(context.getImageData(0, 0, copy.width, copy.height).data.buffer));
  return seen.size < 3;
}"""

Open = Callable[..., Any]


@pytest.fixture(scope="module")
def path(record: RunRecord, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("page") / "run.html"
    write_page(record, file)
    return file


@pytest.fixture
def open_page(browser: Any, path: Path) -> Iterator[Open]:
    """Opens a page; at the end, whatever it logged or asked for fails the test."""
    noise: list[str] = []
    contexts: list[Any] = []

    def opened(hash_: str = "#t=0", file: Path = path, **options: Any) -> Any:
        options = {"viewport": {"width": 1280, "height": 800}, "color_scheme": "light"} | options
        contexts.append(browser.new_context(**options))
        page = contexts[-1].new_page()
        page.on("console", lambda message: noise.append(f"{message.type}: {message.text}"))
        page.on("pageerror", lambda error: noise.append(f"error: {error}"))
        own = file.as_uri()
        page.on("request", lambda request: request.url.split("#")[0] == own or noise.append(request.url))
        page.goto(own + hash_)
        return page

    yield opened
    for context in contexts:
        context.close()
    assert noise == []


def state(page: Any) -> dict[str, Any]:
    got: dict[str, Any] = page.evaluate("vibroswarm.state()")
    return got


def wait_until(page: Any, true: str) -> None:
    """Asks until the expression holds (the page's policy forbids the evaluation by which Playwright would wait)."""
    for _ in range(200):
        if page.evaluate(true):
            return
        page.wait_for_timeout(25)
    pytest.fail(f"not within 5 s: {true}")


def settled(page: Any) -> dict[str, Any]:
    """The state after the frame that was asked for has been drawn."""
    page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return state(page)


def latest(record: RunRecord, robot: int, time_s: float) -> dict[str, Any]:
    table = record.motion.join(record.inference, on=["run", "robot", "sample"])
    return (
        table.filter((pl.col("robot") == robot) & (pl.col("time_s") <= time_s)).sort("sample").to_dicts()[-1]
    )


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_draws(open_page: Open, scheme: str) -> None:
    page = open_page("#t=100", color_scheme=scheme)
    assert state(page)["theme"] == scheme
    for canvas in ("floor", "past", "actors", "belief"):
        assert not page.evaluate(BLANK, canvas), canvas
    assert page.locator(".card canvas").count() == 5


def test_it_plays_when_opened_and_can_be_paused(open_page: Open) -> None:
    page = open_page("")
    wait_until(page, "vibroswarm.state().time_s > 1")
    page.click("#play")
    stopped = settled(page)
    assert not stopped["playing"]
    page.wait_for_timeout(120)
    assert state(page)["time_s"] == stopped["time_s"]
    page.click("#play")
    wait_until(page, f"vibroswarm.state().time_s > {stopped['time_s']}")


def test_it_waits_where_motion_is_not_wanted(open_page: Open) -> None:
    page = open_page("", reduced_motion="reduce")
    assert settled(page)["time_s"] == 0
    assert not state(page)["playing"]


def test_it_stops_at_the_end_and_begins_again(open_page: Open, record: RunRecord) -> None:
    page = open_page(f"#t={record.t_end_s - 1}")
    page.click("#play")
    wait_until(page, "!vibroswarm.state().playing")
    assert state(page)["time_s"] == record.t_end_s
    page.click("#play")
    wait_until(page, "vibroswarm.state().playing && vibroswarm.state().time_s < 100")


def test_the_slider_and_the_chart_scrub(open_page: Open, record: RunRecord) -> None:
    page = open_page()
    page.locator("#scrub").fill("120")
    assert settled(page)["time_s"] == 120
    assert page.inner_text("#clock") == "120.0 s"
    box = page.locator("#belief").bounding_box()
    page.mouse.move(box["x"] + 34 + (box["width"] - 44) * 0.25, box["y"] + box["height"] / 2)
    page.mouse.down()
    assert settled(page)["time_s"] == pytest.approx(record.t_end_s * 0.25, abs=1)
    page.mouse.move(box["x"] + 34 + (box["width"] - 44) * 0.75, box["y"] + box["height"] / 2)
    page.mouse.up()
    assert settled(page)["time_s"] == pytest.approx(record.t_end_s * 0.75, abs=1)


def test_keys(open_page: Open, record: RunRecord) -> None:
    page = open_page("#t=60")
    for key, time_s in [
        ("ArrowRight", 65),
        ("Shift+ArrowRight", 125),
        ("ArrowLeft", 120),
        (".", 120.02),
        (",", 120),
        ("End", record.t_end_s),
        ("Home", 0),
    ]:
        page.keyboard.press(key)
        assert settled(page)["time_s"] == pytest.approx(time_s, abs=1e-9), key
    page.keyboard.press("+")
    assert settled(page)["speed"] == 50
    page.keyboard.press("-")
    page.keyboard.press("-")
    assert settled(page)["speed"] == 10
    page.keyboard.press("3")
    assert settled(page)["followed"] == 3
    page.keyboard.press("Escape")
    assert settled(page)["followed"] is None
    page.keyboard.press("Space")
    wait_until(page, "vibroswarm.state().time_s > 0.5")
    page.keyboard.press("Space")
    assert not settled(page)["playing"]
    page.keyboard.press("?")
    assert page.locator("#help").is_visible()
    page.keyboard.press("Escape")
    assert not page.locator("#help").is_visible()


def test_the_address_opens_a_moment_and_follows(open_page: Open) -> None:
    page = open_page("#t=90.5&robot=2")
    assert state(page)["time_s"] == 90.5
    assert state(page)["followed"] == 2
    page.keyboard.press("ArrowRight")
    wait_until(page, "location.hash === '#t=95.5&robot=2'")
    page.evaluate("location.hash = '#t=30'")
    wait_until(page, "vibroswarm.state().time_s === 30")


@pytest.mark.parametrize("time_s", [45.0, 101.37, 240.0])
def test_numbers_of_now_are_those_of_the_tables(open_page: Open, record: RunRecord, time_s: float) -> None:
    page = open_page()
    page.evaluate("(t) => vibroswarm.seek(t)", time_s)
    decided = 0
    for index, robot in enumerate(record.robots["robot"]):
        row = latest(record, robot, time_s)
        mind = page.evaluate("([id, t]) => vibroswarm.mind(id, t)", [robot, time_s])
        assert {name: mind[name] for name in ("alpha", "beta", "belief", "decision", "received")} == {
            "alpha": row["alpha"], "beta": row["beta"], "belief": row["belief_below"], "decision": row["decision"],
            "received": row["messages_received"],
        }  # fmt: skip
        card = page.locator(".card").nth(index)
        assert card.locator(".card-alpha").text_content() == str(row["alpha"])
        assert card.locator(".card-beta").text_content() == str(row["beta"])
        assert card.locator(".card-p").text_content() == _said(row["belief_below"])
        decided += row["decision"] >= 0
    assert page.text_content("#now-decided") == str(decided)


def test_lost_messages_are_drawn_and_counted(open_page: Open, record: RunRecord, tmp_path: Path) -> None:
    """A record whose even messages are lost at robot 0; without that nothing is said of losses."""
    rows = record.motion.sort("time_s", "robot")
    sender, tick = (
        rows["robot"].to_numpy().astype(np.int64),
        np.rint(rows["time_s"].to_numpy() / 0.02).astype(np.int64),
    )
    arrival = np.repeat(tick[:, None] + 1, 5, axis=1)
    arrival[::2, 0] = -1
    arrival[np.arange(sender.size), sender] = -1
    log = MessageLog(0.02, sender, tick, arrival, np.full(5, 10**9))
    file = tmp_path / "radio.html"
    write_page(replace(record, radio=log), file)
    page = open_page(file=file)
    for time_s in (60.0, 101.37):
        page.evaluate("(t) => vibroswarm.seek(t)", time_s)
        counts = log.counts(time_s)["lost"].to_list()
        assert counts[0] > 0
        assert page.locator("#roster [data-column=lost]").all_text_contents() == list(map(str, counts))
    assert page.locator("#legend").text_content().endswith("heardlost")
    assert open_page().locator("#roster [data-column=lost]").count() == 0


def test_the_table_is_the_table(open_page: Open, record: RunRecord) -> None:
    page = open_page()
    for index, row in enumerate(record.robots.sort("robot").to_dicts()):
        cells = page.locator("#roster tbody tr").nth(index)

        def said(column: str, cells: Any = cells) -> str:
            return str(cells.locator(f"[data-column={column}]").text_content())

        for column in ("alpha", "beta", "samples", "sent", "messages_received"):
            assert said(column) == str(row[column])
        undecided = row["decision"] < 0
        time_s = "–" if undecided else f"{row['decision_time_s']:.3f}".rstrip("0").rstrip(".") + " s"
        assert said("decision_time_s") == time_s
        assert said("belief_at_decision") == ("–" if undecided else _said(row["belief_at_decision"]))
        assert said("decision").startswith({0: "still", 1: "vibrating", -1: "undecided"}[row["decision"]])


def test_robots_are_where_the_segments_say(open_page: Open, record: RunRecord) -> None:
    page = open_page()
    for row in record.motion.sample(60, seed=1).to_dicts():
        pose = page.evaluate("([id, t]) => vibroswarm.pose(id, t)", [row["robot"], row["time_s"] - 0.5])
        assert np.hypot(pose["x"] - row["x_m"], pose["y"] - row["y_m"]) < 0.001
        assert abs(np.angle(np.exp(1j * (pose["heading"] - row["heading_rad"])))) < np.radians(3)
        assert pose["kind"] == "stop"


@pytest.mark.parametrize(
    ("outcome", "words"),
    [
        ("right", "The swarm is right"),
        ("wrong", "The swarm is wrong"),
        ("split", "The swarm is split"),
        ("incomplete", "decided"),
        ("truth_undefined", "The swarm agrees"),
    ],
)
def test_every_outcome_is_said(
    open_page: Open, record: RunRecord, tmp_path: Path, outcome: str, words: str
) -> None:
    fill = 0.5 if outcome == "truth_undefined" else record.fill_ratio
    write_page(
        replace(record, consensus=outcome, fill_ratio=fill, consensus_time_s=None), tmp_path / "run.html"
    )
    page = open_page("#t=10", file=tmp_path / "run.html")
    assert words in page.inner_text("#verdict-line")


def test_decisions_are_said_by_their_boundary(open_page: Open, record: RunRecord, tmp_path: Path) -> None:
    """An inspector asks whether more than 3 % vibrates; "mostly" would be wrong there."""
    file = tmp_path / "inspector.html"
    write_page(replace(record, decision_boundary=0.03, fill_ratio=0.4777777777777778), file)
    text = open_page("#t=100", file=file).inner_text("body")
    assert "mostly" not in text
    assert "Above 0.95 it decides less than 3 % vibrating, below 0.05 more than 3 % vibrating." in text
    assert "0.477778" in text


def test_a_run_without_samples_opens(open_page: Open, record: RunRecord, tmp_path: Path) -> None:
    empty = {name: getattr(record, name).clear() for name in ("motion", "observations", "inference")}
    nothing = pl.lit(None, dtype=pl.Float64)
    robots = record.robots.with_columns(
        decision=pl.lit(-1, dtype=pl.Int8), decision_time_s=nothing, belief_at_decision=nothing
    )
    bare = replace(record, robots=robots, consensus="incomplete", consensus_time_s=None, **empty)
    write_page(bare, tmp_path / "run.html")
    page = open_page("#t=10", file=tmp_path / "run.html")
    assert page.inner_text("#verdict-line") == "No robot has decided."


def test_names_stay_text(open_page: Open, record: RunRecord, tmp_path: Path) -> None:
    name = "</script><img src=x onerror=alert(1)><b>"
    write_page(replace(record, title=name, details={name: name}), tmp_path / "run.html")
    page = open_page("#t=10", file=tmp_path / "run.html")
    assert page.title() == name
    assert page.inner_text("#run-name") == name
    assert page.locator("img").count() == 0


def test_what_lies_under_the_pointer_is_told(open_page: Open, record: RunRecord) -> None:
    page = open_page("#t=100")
    box = page.locator("#actors").bounding_box()
    pose = page.evaluate("vibroswarm.pose(0, 100)")
    x, y = box["x"] + pose["x"] * box["width"], box["y"] + (1 - pose["y"]) * box["height"]
    page.mouse.move(x, y)
    assert page.inner_text("#tooltip p").startswith("Robot ")
    page.mouse.click(x, y)
    assert settled(page)["followed"] is not None
    page.mouse.move(box["x"] + 3, box["y"] + 3)
    assert "tile" in page.inner_text("#tooltip p")


@pytest.mark.parametrize("size", [(390, 844), (320, 640), (820, 1180), (1024, 700), (1600, 1000)])
def test_nothing_runs_over_the_side(open_page: Open, size: tuple[int, int]) -> None:
    page = open_page("#t=100", viewport={"width": size[0], "height": size[1]})
    assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
    arena = page.locator("#arena-frame").bounding_box()
    story = page.locator(".story").bounding_box()
    assert arena["width"] >= 280
    assert arena["x"] + arena["width"] < story["x"] or arena["y"] + arena["height"] < story["y"]


def test_the_theme_can_be_switched(open_page: Open) -> None:
    page = open_page("#t=100")
    colour = "getComputedStyle(document.body).backgroundColor"
    light = page.evaluate(colour)
    page.click("#theme")
    assert settled(page)["theme"] == "dark"
    assert page.evaluate(colour) != light


def _said(belief: float) -> str:
    if 0.9995 < belief < 1:
        return "> 0.999"
    return "< 0.001" if 0 < belief < 0.0005 else f"{belief:.3f}"


def test_a_recorded_session_can_be_watched(open_page: Open, tmp_path: Path) -> None:
    """Messages that the log does not tell are neither drawn nor said to be a bit."""
    from vibroswarm.cli import main

    shipped = Path(__file__).parents[2] / "examples" / "lab"
    out = tmp_path / "kept"
    arguments = [str(shipped / "session-1.csv"), "--floor", str(shipped / "floor.txt"), "--out", str(out)]
    assert main(["lab", "import", *arguments]) == 0
    page = open_page("#t=60", file=out / "run.html")
    for canvas in ("floor", "past", "actors", "belief"):
        assert not page.evaluate(BLANK, canvas), canvas
    assert "recorded, session 1" in page.text_content("#details")
    began = state(page)["time_s"]
    if not state(page)["playing"]:
        page.click("#play")
    wait_until(page, f"vibroswarm.state().time_s > {began}")


@pytest.mark.parametrize("policy", ["the page's", "none"])
def test_a_script_that_was_put_into_the_page_does_not_run(
    browser: Any, path: Path, tmp_path: Path, policy: str
) -> None:
    """Control: without the policy it runs. The page's own script runs in both."""
    text = path.read_text(encoding="utf-8")
    text = text.replace(
        "</main>", "<script>window.injected = 1</script><img src='x:' onerror='injected = 1'></main>"
    )
    if policy == "none":
        text = re.sub(r"<meta http-equiv=.Content-Security-Policy[^>]*>", "", text)
    changed = tmp_path / "changed.html"
    changed.write_text(text, encoding="utf-8")
    page = browser.new_page()
    page.goto(changed.as_uri())
    wait_until(page, "typeof vibroswarm === 'object'")
    page.wait_for_timeout(200)
    assert page.evaluate("window.injected === 1") is (policy == "none")
    page.close()


def test_robots_with_faults_are_marked_from_then_on(
    open_page: Open, record: RunRecord, tmp_path: Path
) -> None:
    faults = ((1, "stuck at 1", 0.0, False), (3, "battery empty", 90.0, True))
    write_page(replace(record, faults=faults), tmp_path / "faults.html")
    page, usual = open_page("#t=100", tmp_path / "faults.html"), open_page("#t=100")
    for one in (page, usual):
        settled(one)
    assert page.evaluate("[1, 3, 0].map((id) => vibroswarm.faults(id, 100))") == [
        ["stuck at 1"],
        ["battery empty"],
        [],
    ]
    assert page.evaluate("vibroswarm.faults(3, 89)") == []
    words = page.locator("#roster tbody tr").all_inner_texts()
    assert "stuck at 1" in words[1]
    assert "stuck" not in words[0]
    assert "has a fault" in page.inner_text("#legend")
    assert "has a fault" not in usual.inner_text("#legend")
    shown = "document.getElementById('actors').toDataURL()"
    assert page.evaluate(shown) != usual.evaluate(shown)


@pytest.mark.parametrize("way", ["src", "srcdoc"])
def test_it_opens_in_a_hidden_frame_and_draws_once_shown(
    browser: Any, path: Path, tmp_path: Path, way: str
) -> None:
    source = path.as_uri() if way == "src" else html.escape(path.read_text(encoding="utf-8"))
    around = tmp_path / "notebook.html"
    around.write_text(
        f'<iframe {way}="{source}" style="display:none; width:900px; height:700px"></iframe>',
        encoding="utf-8",
    )
    page = browser.new_page(reduced_motion="reduce")
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(around.as_uri())
    frame = page.frames[1]
    wait_until(frame, "typeof vibroswarm === 'object'")
    assert frame.evaluate("innerWidth") == 0
    frame.evaluate("vibroswarm.seek(100)")
    page.evaluate("document.querySelector('iframe').style.display = 'block'")
    wait_until(frame, "document.getElementById('arena-frame').clientWidth > 250")
    for canvas in ("floor", "past", "actors", "belief"):
        assert not frame.evaluate(BLANK, canvas), canvas
    assert errors == []
    page.close()


@pytest.mark.parametrize("gate", ["total", "received", "own"])
def test_the_gate_opens_when_the_tables_say(
    open_page: Open, record: RunRecord, tmp_path: Path, gate: str
) -> None:
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
    file = tmp_path / "gate.html"
    undecided = record.robots.with_columns(decision=pl.lit(-1, dtype=pl.Int8))
    write_page(replace(record, gate=gate, min_observations=least, robots=undecided), file)
    page = open_page(file=file)
    assert page.evaluate("vibroswarm.gate().first_s") == pytest.approx(first, abs=1e-9)
    words = {"total": "observations, its own and received", "received": "received bits", "own": "own samples"}
    lead = page.inner_text("#belief-lead")
    assert f"only with more than {least} {words[gate]}: before {first:.1f} s it is too early" in lead


def test_no_gate_is_shown_that_was_not_in_force(open_page: Open, record: RunRecord, tmp_path: Path) -> None:
    """Of a strategy without a gate, and where robots decided before it."""
    for name, fields in {"none": {"gated": False}, "broken": {"min_observations": 100}}.items():
        write_page(replace(record, **fields), tmp_path / f"{name}.html")
        page = open_page(file=tmp_path / f"{name}.html")
        assert page.evaluate("vibroswarm.gate().first_s") == 0
        assert "too early" not in page.inner_text("#belief-lead")


def test_the_question_the_outcome_and_now_are_told_apart(open_page: Open, record: RunRecord) -> None:
    page = open_page("#t=10")
    share = f"{100 * record.fill_ratio:.1f}".removesuffix(".0")
    assert page.inner_text("#task") == f"Does more than 50 % of the floor vibrate? Truth: no ({share} %)."
    assert page.inner_text("[data-fact=votes] dd") == "3 of 5 say: not vibrating\n2 of 5 undecided"
    assert page.inner_text("#outcome-time") == "Outcome, at the end of the run (4 min 0 s)"
    assert page.inner_text(".now-line") == "Now, at 10.0 s\n0 of 5 decided"


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


def test_flags_of_sixty_robots_stand_apart(open_page: Open, record: RunRecord, tmp_path: Path) -> None:
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
    file = tmp_path / "sixty.html"
    write_page(replace(record, robots=table, gated=False), file)
    flags = open_page(file=file, viewport={"width": 900, "height": 700}).evaluate("vibroswarm.flags()")
    assert sorted(robot for flag in flags for robot in flag["robots"]) == list(range(59))
    places = [flag["place"] for flag in flags]
    assert min(np.diff(places)) >= 2 * flags[0]["radius"]
    assert all(len({robot % 5 // 4 for robot in flag["robots"]}) == 1 for flag in flags)
    few = open_page().evaluate("vibroswarm.flags()")
    assert [len(flag["robots"]) for flag in few] == [1, 1, 1]


def test_minutes_stand_beside_seconds(open_page: Open) -> None:
    page = open_page("#t=100")
    assert page.inner_text("#clock-minutes") == "1:40 / 4:00 min"
    assert page.inner_text("#now-time") == "100.0 s (1 min 40 s)"


def test_the_scale_bar_is_as_long_as_it_says(open_page: Open) -> None:
    page = open_page()
    bar = page.evaluate("vibroswarm.scaleBar()")
    width = page.locator("#arena-frame").evaluate("(frame) => frame.clientWidth")
    assert bar["words"] == "20 cm"
    assert bar["width"] == pytest.approx(0.2 * width, rel=0.01)


def test_believed_places_lie_where_the_table_says_and_can_be_switched_off(
    open_page: Open, record: RunRecord, tmp_path: Path
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
    )
    file = tmp_path / "places.html"
    write_page(replace(record, places=places.reverse()), file)
    page = open_page(file=file)
    for robot in (0, 3):
        row = latest(record, robot, 101.37)
        told = places.filter((pl.col("robot") == robot) & (pl.col("sample") == row["sample"])).to_dicts()[0]
        drawn = page.evaluate("(id) => vibroswarm.place(id, 101.37)", robot)
        assert [drawn[name] for name in ("x", "y", "heading", "spread", "trueX", "trueY")] == pytest.approx(
            [told["x_m"], told["y_m"], told["heading_rad"], 0.04, row["x_m"], row["y_m"]], abs=1e-6
        )
    page.evaluate("vibroswarm.seek(101.37)")
    shown = "document.getElementById('actors').toDataURL()"
    plain = open_page("#t=101.37")
    assert page.evaluate(shown) != plain.evaluate(shown)
    page.uncheck("#layer-places")
    assert settled(page)["time_s"] == 101.37
    assert page.evaluate(shown) == plain.evaluate(shown)
    assert plain.locator("#layer-places").count() == 0


@pytest.mark.parametrize("layer", ["paths", "samples", "rays", "messages"])
def test_layers_can_be_switched_off_and_on(open_page: Open, layer: str) -> None:
    page = open_page("#t=100.5")
    shown = "document.getElementById('actors').toDataURL()"
    times = (100.5, 101.5, 103.0, 105.0)

    def pictures() -> list[str]:
        return [page.evaluate(f"(t) => {{ vibroswarm.seek(t); return {shown}; }}", t) for t in times]

    before = pictures()
    page.uncheck(f"#layer-{layer}")
    assert pictures() != before
    page.check(f"#layer-{layer}")
    assert pictures() == before


def test_many_beliefs_are_a_band_and_one_line_under_the_pointer(open_page: Open, tmp_path: Path) -> None:
    """The band's numbers against those of the tables, at three times."""
    crowd = make_record(robots=20, t_end_s=60.0, seed=4, min_observations=60)
    file = tmp_path / "crowd.html"
    write_page(crowd, file)
    page = open_page(file=file)
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


def test_events_are_reached_in_order(open_page: Open, record: RunRecord, tmp_path: Path) -> None:
    file = tmp_path / "events.html"
    write_page(replace(record, faults=((3, "battery empty", 90.0, True),)), file)
    page = open_page(file=file)
    gate = page.evaluate("vibroswarm.gate().first_s")
    decided = record.robots["decision_time_s"].drop_nulls().to_list()
    events = sorted({gate, 90.0, *decided})
    for time_s in [*events, record.t_end_s]:
        page.keyboard.press("n")
        assert settled(page)["time_s"] == pytest.approx(time_s, abs=1e-9)
    page.click("#previous-event")
    assert settled(page)["time_s"] == pytest.approx(events[-1])
    page.keyboard.press("p")
    assert settled(page)["time_s"] == pytest.approx(events[-2])
    page.click("#next-event")
    assert settled(page)["time_s"] == pytest.approx(events[-1])


def test_a_range_is_looped_until_it_is_cleared(open_page: Open) -> None:
    page = open_page("#t=100")
    page.keyboard.press("l")
    assert settled(page)["loop"] == {"from": 100, "to": None}
    page.keyboard.press("ArrowRight")
    page.click("#loop")
    assert settled(page)["loop"] == {"from": 100, "to": 105}
    page.click("#play")
    times = []
    for _ in range(40):
        page.wait_for_timeout(25)
        times.append(state(page)["time_s"])
    assert all(100 <= time_s <= 105 for time_s in times)
    assert any(later < earlier for earlier, later in pairwise(times))
    page.keyboard.press("l")
    assert settled(page)["loop"] is None
    wait_until(page, "vibroswarm.state().time_s > 106")


def test_data_and_picture_are_saved(open_page: Open, record: RunRecord, tmp_path: Path) -> None:
    page = open_page("#t=100")
    with page.expect_download() as saved:
        page.click("#data")
    assert saved.value.suggested_filename == "Five-robots-on-a-made-up-floor.csv"
    table = pl.read_csv(saved.value.path())
    known = record.motion.join(record.inference, on=["run", "robot", "sample"]).sort("robot", "sample")
    for name in ("robot", "sample", "time_s", "x_m", "y_m", "alpha", "beta", "belief_below", "decision"):
        assert table[name].to_list() == known[name].to_list(), name
    with page.expect_download() as saved:
        page.click("#picture")
    head = saved.value.path().read_bytes()[:24]
    frame = page.locator("#arena-frame").evaluate("(frame) => [frame.clientWidth, frame.clientHeight]")
    assert head[:8] == b"\x89PNG\r\n\x1a\n"
    assert [int.from_bytes(head[16:20]), int.from_bytes(head[20:24])] == [frame[0], frame[1] + 30]


def test_a_video_is_recorded(open_page: Open) -> None:
    page = open_page("#t=100")
    page.click("#video")
    wait_until(page, "vibroswarm.state().time_s > 110")
    with page.expect_download() as saved:
        page.click("#video")
    content = saved.value.path().read_bytes()
    assert content[:4] == b"\x1a\x45\xdf\xa3"  # EBML, the container of WebM
    assert b"webm" in content[:64]
    assert len(content) > 5000
    assert not settled(page)["playing"]


def test_the_floor_can_be_enlarged_and_moved(open_page: Open) -> None:
    page = open_page("#t=100")
    shown = "document.getElementById('floor').toDataURL()"
    whole, bar = page.evaluate(shown), page.evaluate("vibroswarm.scaleBar()")
    box = page.locator("#actors").bounding_box()
    point = [0.3 * box["width"], 0.6 * box["height"]]
    assert page.evaluate("([x, y]) => vibroswarm.screen(0.3, 0.4)", point) == pytest.approx(
        {"x": point[0], "y": point[1]}, abs=1.5
    )
    page.mouse.move(box["x"] + point[0], box["y"] + point[1])
    page.keyboard.down("Control")
    page.mouse.wheel(0, -300)
    page.keyboard.up("Control")
    wait_until(page, "vibroswarm.screen(1, 0).x - vibroswarm.screen(0, 0).x > 1.3 * "
               f"{box['width']}")  # fmt: skip
    assert page.evaluate("vibroswarm.screen(0.3, 0.4)") == pytest.approx(
        {"x": point[0], "y": point[1]}, abs=2
    )
    assert page.evaluate(shown) != whole
    nearer = page.evaluate("vibroswarm.scaleBar()")
    assert nearer["words"] != bar["words"] or nearer["width"] > 1.3 * bar["width"]
    page.mouse.down()
    page.mouse.move(box["x"] + point[0] + 40, box["y"] + point[1] - 30, steps=4)
    page.mouse.up()
    moved = page.evaluate("vibroswarm.screen(0.3, 0.4)")
    assert moved == pytest.approx({"x": point[0] + 40, "y": point[1] - 30}, abs=4)
    assert settled(page)["followed"] is None
    for _ in range(3):
        if page.locator("#zoom-out").is_enabled():
            page.click("#zoom-out")
            settled(page)
    assert page.locator("#zoom-out").is_disabled()
    assert page.evaluate(shown) == whole
