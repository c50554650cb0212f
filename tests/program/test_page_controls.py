"""The page's layers, events, loop, zoom and files, in a real browser."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import polars as pl
import pytest

from helpers.page_browser import ACTORS, Open, settled, state, wait_until
from vibroswarm.run_page.payload import RunRecord


def test_layers_can_be_switched_off_and_on(open_page: Open) -> None:
    page = open_page("#t=100.5", viewport={"width": 400, "height": 800})  # pictures as small as can be
    times = (100.5, 101.5, 103.0, 105.0)

    def pictures() -> list[str]:
        return [page.evaluate(f"(t) => {{ vibroswarm.seek(t); return {ACTORS}; }}", t) for t in times]

    before = pictures()
    for layer in ("paths", "samples", "rays", "messages"):
        page.uncheck(f"#layer-{layer}")
        assert pictures() != before, layer
        page.check(f"#layer-{layer}")
        assert pictures() == before, layer


def test_events_are_reached_in_order(open_page: Open, record: RunRecord) -> None:
    page = open_page(
        of=replace(record, faults=({"robot": 3, "fault": "battery empty", "from_s": 90.0, "stops": True},))
    )
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


def test_data_and_picture_are_saved(open_page: Open, record: RunRecord) -> None:
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
    assert [int.from_bytes(head[16:20]), int.from_bytes(head[20:24])] == [frame[0], frame[1] + 50]


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
