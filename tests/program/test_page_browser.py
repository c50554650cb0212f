"""The page in a real browser: it draws, plays, obeys, shows the tables' numbers, and asks for nothing."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from helpers.page_browser import BLANK, Open, latest, settled, state
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


def test_robots_are_where_the_tables_say(open_page: Open, record: RunRecord) -> None:
    page = open_page()
    for row in record.motion.sample(60, seed=1).to_dicts():
        pose = page.evaluate("([id, t]) => vibroswarm.pose(id, t)", [row["robot"], row["time_s"] - 0.5])
        assert np.hypot(pose["x"] - row["x_m"], pose["y"] - row["y_m"]) < 0.001
        assert abs(np.angle(np.exp(1j * (pose["heading"] - row["heading_rad"])))) < np.radians(3)
        assert pose["kind"] == "stop"


def test_names_stay_text(open_page: Open, record: RunRecord) -> None:
    name = "</script><img src=x onerror=alert(1)><b>"
    page = open_page("#t=10", of=replace(record, title=name, details={name: name}))
    assert page.title() == name
    assert page.inner_text("#run-name") == name
    assert page.locator("img").count() == 0


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


def _said(belief: float) -> str:
    if belief > 0.9995:
        return "> 0.999"
    return "< 0.001" if belief < 0.0005 else f"{belief:.3f}"
