"""The page in a real browser: it draws, plays, obeys, shows the tables' numbers, and asks for nothing."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.browser import Tabs
from helpers.page_browser import ACTORS, BLANK, Open, latest, settled, state, wait_until
from helpers.page_records import make_record, ruled
from vibroswarm.analysis.message_log import MessageLog
from vibroswarm.cli import main
from vibroswarm.run_page.payload import RunRecord


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_draws(open_page: Open, scheme: str) -> None:
    page = open_page("#t=100", color_scheme=scheme)
    assert state(page)["theme"] == scheme
    for canvas in ("floor", "past", "actors", "belief"):
        assert not page.evaluate(BLANK, canvas), canvas
    assert page.locator(".card canvas").count() == 5
    assert page.evaluate("document.querySelector('h1, h2').tagName") == "H1"
    colour = "getComputedStyle(document.body).backgroundColor"
    before = page.evaluate(colour)
    page.click("#theme")
    assert settled(page)["theme"] == {"light": "dark", "dark": "light"}[scheme]
    assert page.evaluate(colour) != before


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


def test_cards_and_table_show_the_same_moment_while_it_plays(open_page: Open) -> None:
    """The table was up to 2.4 s of the run behind the cards."""
    page = open_page("")
    both = """[".card-belief > span", "[data-column=belief]"].map((cells) =>
      [...document.querySelectorAll(cells)].map((cell) => cell.textContent))"""
    seen = []
    for _ in range(40):
        page.wait_for_timeout(25)
        seen.append(page.evaluate(both))
    assert all(cards == table for cards, table in seen)
    assert seen[0] != seen[-1]


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


def test_numbers_of_now_are_those_of_the_tables(open_page: Open, record: RunRecord) -> None:
    page = open_page()
    of_a_sample_s = record.motion["time_s"][10]
    for time_s in (of_a_sample_s, 45.0, 101.37, 240.0):
        page.evaluate("(t) => vibroswarm.seek(t)", time_s)
        check_numbers(page, record, time_s)


def check_numbers(page: Any, record: RunRecord, time_s: float) -> None:
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


def test_lost_messages_are_drawn_and_counted(open_page: Open, record: RunRecord) -> None:
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
    page = open_page(of=replace(record, radio=log))
    for time_s in (60.0, 101.37):
        page.evaluate("(t) => vibroswarm.seek(t)", time_s)
        counts = log.counts(time_s)["lost"].to_list()
        assert counts[0] > 0
        assert page.locator("#roster [data-column=lost]").all_text_contents() == list(map(str, counts))
    assert page.locator("#legend").text_content().endswith("heardlost")
    assert open_page().locator("#roster [data-column=lost]").count() == 0


def test_without_javascript_only_the_reason_is_shown(tabs: Tabs, page_path: Path) -> None:
    page = tabs.open(page_path.as_uri(), viewport={"width": 1200, "height": 900}, java_script_enabled=False)
    assert "which is turned off" in page.locator("body").inner_text()
    assert page.locator(".page, .player").locator("visible=true").count() == 0


def test_it_is_printed_light(open_page: Open) -> None:
    """Also what canvases draw; without backgrounds, light words on paper could not be read."""
    page = open_page(color_scheme="dark")
    drawn = "document.getElementById('belief').toDataURL()"
    dark = page.evaluate(drawn)
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert (state(page)["theme"], page.evaluate(INK)) == ("light", "rgb(27, 30, 35)")
    assert page.evaluate(drawn) != dark
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    assert (state(page)["theme"], page.evaluate(INK)) == ("dark", "rgb(236, 234, 228)")
    page.emulate_media(color_scheme="light")
    assert state(page)["theme"] == "light"  # it follows the system as before


INK = "getComputedStyle(document.querySelector('h1')).color"


def test_in_print_it_has_no_controls(open_page: Open) -> None:
    page = open_page("#t=100")
    page.emulate_media(media="print")
    assert page.locator(".actions, .layers, .player").locator("visible=true").count() == 0


def test_the_table_of_ten_robots_fits_a_screen_of_1200_px(open_page: Open) -> None:
    page = open_page("#t=100", of=make_record(robots=10), viewport={"width": 1200, "height": 900})
    fill = "([name, words]) => document.querySelectorAll(`[data-column=${name}]`).forEach((e) => e.textContent = words)"
    widest = {"state": "sampling", "decision_time_s": "1082.34 s", "alpha": "1078", "beta": "1084"}
    for column in (widest | {"sent": "216", "messages_received": "1909"}).items():
        page.evaluate(fill, column)
    assert page.evaluate("(e => e.scrollWidth - e.clientWidth)(document.querySelector('.roster-frame'))") == 0


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
def test_the_first_screen_of_a_telephone_has_the_outcome_and_the_floor(
    open_page: Open, record: RunRecord, outcome: str, words: str
) -> None:
    fill = 0.5 if outcome == "truth_undefined" else record.fill_ratio
    shown = replace(record, consensus=outcome, fill_ratio=fill, consensus_time_s=None)
    page = open_page("#t=10", of=shown, viewport={"width": 400, "height": 800})
    assert words in page.inner_text("#verdict-line")
    bottom = page.locator(".player").bounding_box()["y"]
    above = 0.0
    for part in ("#task", "#verdict-badge", "#verdict-line", "#arena-frame"):
        box = page.locator(part).bounding_box()
        assert above <= box["y"], part
        assert box["y"] + box["height"] <= bottom, part
        above = box["y"]


def test_decisions_are_said_by_their_boundary(open_page: Open, record: RunRecord) -> None:
    """An inspector asks whether more than 3 % vibrates; "mostly" would be wrong there."""
    rule = {"boundary": 0.03, "tested": 0.03, "prior_belief": 0.03}
    inspector = ruled(record, rule, fill_ratio=0.4777777777777778)
    text = open_page("#t=100", of=inspector).inner_text("body")
    assert "mostly" not in text
    assert "Above 0.95 it decides less than 3 % vibrating, below 0.05 more than 3 % vibrating." in text
    assert "0.477778" in text


def test_names_stay_text(open_page: Open, record: RunRecord) -> None:
    name = "</script><img src=x onerror=alert(1)><b>"
    page = open_page("#t=10", of=replace(record, title=name, details={name: name}))
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


def test_nothing_runs_over_the_side(open_page: Open) -> None:
    page = open_page("#t=100")
    for width, height in ((390, 844), (320, 640), (820, 1180), (1024, 700), (1600, 1000)):
        page.set_viewport_size({"width": width, "height": height})
        settled(page)
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        arena = page.locator("#arena-frame").bounding_box()
        story = page.locator(".figures").bounding_box()
        assert arena["width"] >= 280
        assert arena["x"] + arena["width"] < story["x"] or arena["y"] + arena["height"] < story["y"]


def test_words_are_in_the_font_that_the_page_holds(
    open_page: Open, tabs: Tabs, page_path: Path, tmp_path: Path
) -> None:
    """On the page and on canvases. The control is a page without the font's data."""
    tabs.expected = (
        "error: Unsafe attempt to load URL file:",
    )  # of Chromium's inspector, which is asked below
    without = tmp_path / "without.html"
    text = re.sub(r"@font-face.*", "", page_path.read_text(encoding="utf-8"))
    without.write_text(text, encoding="utf-8")
    page, control = open_page("#t=100"), open_page("#t=100", file=without)
    wait_until(page, "document.fonts.status === 'loaded'")
    faces = page.evaluate("[...document.fonts].map((face) => [face.family, face.status])")
    assert faces == [["Roboto embedded", "loaded"]] * 2
    assert page.evaluate("""document.fonts.check('400 12px "Roboto embedded"')""")
    for shown, embedded in ((page, True), (control, False)):
        used = shown.context.new_cdp_session(shown)
        used.send("DOM.enable")
        used.send("CSS.enable")
        root = used.send("DOM.getDocument")["root"]["nodeId"]
        for part in ("#verdict-line", "#task", "#clock", ".fact", "#belief-title"):
            node = used.send("DOM.querySelector", {"nodeId": root, "selector": part})["nodeId"]
            fonts = used.send("CSS.getPlatformFontsForNode", {"nodeId": node})["fonts"]
            assert {font["isCustomFont"] for font in fonts} == {embedded}, (part, fonts)
    widths = """(weight) => {
      const context = document.createElement("canvas").getContext("2d");
      context.font = `${weight} 40px "Roboto embedded"`;
      return [..."0123456789W"].map((text) => context.measureText(text).width);
    }"""
    for weight in (400, 700):
        *digits, widest = page.evaluate(widths, weight)
        assert len(set(digits)) == 1
        assert widest > digits[0]
        assert page.evaluate(widths, weight) != control.evaluate(widths, weight)


def _said(belief: float) -> str:
    if belief > 0.9995:
        return "> 0.999"
    return "< 0.001" if belief < 0.0005 else f"{belief:.3f}"


def test_a_recorded_session_can_be_watched(open_page: Open, tmp_path: Path) -> None:
    """Messages that the log does not tell are neither drawn nor said to be a bit."""

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
    tabs: Tabs, page_path: Path, tmp_path: Path, policy: str
) -> None:
    """Control: without the policy it runs. The page's own script runs in both."""
    text = page_path.read_text(encoding="utf-8")
    text = text.replace(
        "</main>", "<script>window.injected = 1</script><img src='x:' onerror='injected = 1'></main>"
    )
    if policy == "none":
        text = re.sub(r"<meta http-equiv=.Content-Security-Policy[^>]*>", "", text)
    changed = tmp_path / "changed.html"
    changed.write_text(text, encoding="utf-8")
    page = tabs.open(changed.as_uri(), viewport={"width": 1280, "height": 800})
    wait_until(page, "typeof vibroswarm === 'object'")
    page.wait_for_timeout(200)
    assert page.evaluate("window.injected === 1") is (policy == "none")
    assert any("Content Security Policy" in one for one in tabs.emptied()) is (policy != "none")


def test_robots_with_faults_are_marked_from_then_on(open_page: Open, record: RunRecord) -> None:
    faults = (
        {"robot": 1, "fault": "stuck at 1", "from_s": 0.0, "stops": False},
        {"robot": 3, "fault": "battery empty", "from_s": 90.0, "stops": True},
    )
    page, usual = open_page("#t=100", of=replace(record, faults=faults)), open_page("#t=100")
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
    assert page.evaluate(ACTORS) != usual.evaluate(ACTORS)
