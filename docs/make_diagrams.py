"""Draw the pictures of README.md and of the model: ``python docs/make_diagrams.py``.

``inspection.svg`` is one run (preset paper, soft feedback, seed 2): the floor after five minutes, and all beliefs.
``stages.svg`` shows how motion, observation and inference lead to a result; ``model.svg`` what one robot does.
They have a background of their own, so that they are readable on light and on dark pages.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from html import escape
from pathlib import Path

import numpy as np

from vibroswarm import Result, pose, preset, simulate

TARGET = Path(__file__).with_name("images")
PAPER, INK, FAINT, LINE = "#fdfcf8", "#1b1f23", "#5b6067", "#c9c4b8"
VIBRATING, STILL, TILE, RIPPLE = "#b04a08", "#0b5f96", "#f9e8da", "#e3b18f"
MOMENT_S = 300.0


def svg(width: int, height: int, title: str, parts: list[str]) -> str:
    """Return a whole picture; a title is what a screen reader says."""
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        f'role="img" font-family="DejaVu Sans, Verdana, Arial, sans-serif" font-size="13">\n'
        f"<title>{escape(title)}</title>\n"
        f'<rect width="{width}" height="{height}" rx="10" fill="{PAPER}"/>\n'
        + "\n".join(parts)
        + "\n</svg>\n"
    )


def text(x: float, y: float, words: str, *, size: int = 13, fill: str = INK, more: str = "") -> str:
    """Return a text element; ``more``: further attributes."""
    return f'<text x="{x:g}" y="{y:g}" font-size="{size}" fill="{fill}" {more}>{escape(words)}</text>'


def floor_at(result: Result, time_s: float, left: float, top: float, side: float) -> Iterator[str]:
    """Draw tiles, samples so far, the paths of the last 20 s, and the robots."""
    tiles = result.floor().tiles
    tile = side / len(tiles)
    for (row, column), vibrates in np.ndenumerate(tiles):
        x, y = left + column * tile, top + row * tile
        fill = TILE if vibrates else "#ffffff"
        yield (
            f'<rect x="{x:g}" y="{y:g}" width="{tile:g}" height="{tile:g}" fill="{fill}" stroke="{LINE}" '
            'stroke-width=".5"/>'
        )
        if vibrates:
            for k in range(1, 5):
                wave = f"M{x + 4:g} {y + k * tile / 5:.1f}" + "q4 -5 8 0t8 0" * int((tile - 8) // 16)
                yield f'<path d="{wave}" fill="none" stroke="{RIPPLE}" stroke-width=".8"/>'
    for robot in range(result.scenario.swarm.robots):
        path = pose(result.poses, 0, robot, np.linspace(time_s - 20.0, time_s, 81))
        points = " ".join(f"{left + side * x:.1f},{top + side * (1 - y):.1f}" for x, y in path[:, :2])
        yield f'<polyline points="{points}" fill="none" stroke="{FAINT}" stroke-width="1.2"/>'
    samples = result.motion.join(result.observations, on=["run", "robot", "sample"])
    marks: dict[int, list[str]] = {0: [], 1: []}
    for at_s, x, y, bit in samples.select("time_s", "x_m", "y_m", "observation").iter_rows():
        if at_s <= time_s:
            marks[bit].append(f"M{left + side * x:.1f} {top + side * (1 - y):.1f}")
    diamonds = "".join(f"{mark}m0 -3.4l3.4 3.4l-3.4 3.4l-3.4 -3.4z" for mark in marks[1])
    circles = "".join(f"{mark}m-2.6 0a2.6 2.6 0 1 0 5.2 0a2.6 2.6 0 1 0 -5.2 0" for mark in marks[0])
    yield f'<path d="{circles}" fill="{PAPER}" stroke="{STILL}" stroke-width="1.2"/>'
    yield f'<path d="{diamonds}" fill="{VIBRATING}"/>'
    for robot in range(result.scenario.swarm.robots):
        x, y = pose(result.poses, 0, robot, np.array([time_s]))[0, :2]
        cx, cy = left + side * x, top + side * (1 - y)
        yield f'<circle cx="{cx:.1f}" cy="{cy:.1f}" r="9" fill="{PAPER}" stroke="{INK}" stroke-width="1.6"/>'
        yield text(cx, cy + 4, str(robot), size=11, more='text-anchor="middle" font-weight="bold"')
    yield f'<rect x="{left:g}" y="{top:g}" width="{side:g}" height="{side:g}" fill="none" stroke="{INK}"/>'


def beliefs(result: Result, left: float, top: float, width: float, height: float) -> Iterator[str]:
    """Draw the belief of each robot over time, with the credible threshold and the decisions."""
    t_end, limit = result.scenario.run.t_end_s, result.scenario.decision.credible_threshold

    def px(time_s: float) -> float:
        return left + width * time_s / t_end

    def py(belief: float) -> float:
        return top + height * (1 - belief)

    for low, high, colour in ((limit, 1.0, "#d7e6f2"), (0.0, 1 - limit, TILE)):
        yield f'<rect x="{left:g}" y="{py(high):g}" width="{width:g}" height="{py(low) - py(high):g}" fill="{colour}"/>'
    for value in (0.0, 0.5, 1.0):
        yield f'<path d="M{left:g} {py(value):g}h{width:g}" stroke="{LINE}"/>'
        yield text(left - 6, py(value) + 4, f"{value:g}", size=12, fill=FAINT, more='text-anchor="end"')
    for minute in range(0, int(t_end // 60) + 1, 5):
        anchor, words = 'text-anchor="middle"', f"{minute} min" if minute else "0"
        yield text(
            px(60.0 * minute),
            top + height + 18,
            words,
            size=12,
            fill=FAINT,
            more=anchor,
        )
    table = result.inference.join(
        result.motion.select("run", "robot", "sample", "time_s"), on=["run", "robot", "sample"]
    )
    decided = dict(result.robots.select("robot", "decision_time_s").iter_rows())
    for robot in range(result.scenario.swarm.robots):
        own = table.filter(robot=robot).sort("time_s").select("time_s", "belief_below").rows()
        parts = (
            [(t, p) for t, p in own if t <= decided[robot]],
            [(t, p) for t, p in own if t >= decided[robot]],
        )
        for points, colour in zip(parts, (FAINT, STILL), strict=True):
            line = " ".join(f"{px(t):.1f},{py(p):.1f}" for t, p in points)
            yield f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="1.3" opacity=".8"/>'
    for at_s in decided.values():
        yield f'<circle cx="{px(at_s):.1f}" cy="{py(limit):.1f}" r="3.5" fill="{STILL}"/>'
    yield text(left + 66, py(limit) - 4, "above 0.95: decides 'less than half'", size=12, fill=STILL)
    yield text(left + 66, py(0.0) - 4, "below 0.05: decides 'more than half'", size=12, fill=VIBRATING)


def inspection() -> str:
    """Return the picture of one run."""
    scenario = preset("paper").with_values({"strategy.name": "soft"})
    result = simulate(scenario, seed=2, poses=True)
    consensus_s = result.runs["consensus_time_s"][0]
    bold = 'font-weight="bold"'
    parts = [
        text(24, 34, "Does most of this floor vibrate?", size=17, more=bold),
        text(24, 55, "5 robots, after 5 minutes. 12 of 25 tiles do.", fill=FAINT),
        *floor_at(result, MOMENT_S, 24, 72, 330),
        f'<path d="M30 421m0 -4l4 4l-4 4l-4 -4z" fill="{VIBRATING}"/>',
        text(40, 425, "read vibrating"),
        f'<circle cx="158" cy="421" r="3.2" fill="{PAPER}" stroke="{STILL}" stroke-width="1.4"/>',
        text(168, 425, "read still"),
        text(252, 425, "(1 in 7 is wrong)", fill=FAINT),
        text(400, 34, "Each robot's belief that less than half does", size=17, more=bold),
        text(400, 55, f"All 5 decide 'less than half' by {consensus_s:.0f} s: right.", fill=FAINT),
        *beliefs(result, 424, 72, 430, 330),
    ]
    return svg(
        880, 440, "Five robots inspect a floor: where they sampled, and what they believe over time", parts
    )


def box(
    x: float, y: float, width: float, head: str, lines: tuple[str, ...], colour: str = INK
) -> Iterator[str]:
    """Draw a box with a heading and lines of text."""
    height = 34 + 18 * len(lines)
    yield (
        f'<rect x="{x:g}" y="{y:g}" width="{width:g}" height="{height}" rx="8" fill="#ffffff" stroke="{colour}" '
        f'stroke-width="1.5"/>'
    )
    yield text(x + 14, y + 23, head, size=15, fill=colour, more='font-weight="bold"')
    for k, line in enumerate(lines):
        yield text(x + 14, y + 44 + 18 * k, line, size=12, fill=FAINT)


def arrow(path: str, dashed: bool = False) -> str:
    """Return a line with a tip."""
    dash = ' stroke-dasharray="5 4"' if dashed else ""
    return f'<path d="{path}" fill="none" stroke="{INK}" stroke-width="1.6"{dash} marker-end="url(#tip)"/>'


TIP = (
    '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" markerHeight="8" orient="auto">'
    f'<path d="M0 0L8 4L0 8z" fill="{INK}"/></marker></defs>'
)


def stages() -> str:
    """Return the diagram of the stages: which depends on what."""
    parts = [
        TIP,
        *box(24, 40, 190, "Motion", ("where and when", "robots sample")),
        *box(270, 40, 190, "Observation", ("what each sample reads", ""), VIBRATING),
        *box(516, 40, 190, "Inference", ("what each robot believes,", "sends and decides"), STILL),
        *box(752, 40, 144, "Result", ("who decided what,", "when, how sure")),
        *box(270, 160, 190, "Localisation", ("where each robot", "believes it sampled")),
        arrow("M214 75H268"),
        arrow("M460 75H514"),
        arrow("M706 75H750"),
        arrow("M119 110V195H268"),
        arrow("M460 195H600V112"),
        arrow("M560 110V262H70V112", dashed=True),
        text(24, 24, "walk, robot, seed", size=12, fill=VIBRATING),
        text(270, 24, "floor, sensor", size=12, fill=VIBRATING),
        text(516, 24, "strategy, network, decision rule", size=12, fill=VIBRATING),
        text(752, 24, "task", size=12, fill=VIBRATING),
        text(
            84,
            280,
            "only if the strategy steers: the same stages, sample by sample (closed loop)",
            size=12,
            fill=FAINT,
        ),
        text(630, 195, "One motion serves every floor, sensor,", size=12, fill=FAINT),
        text(630, 213, "network and strategy, so comparisons", size=12, fill=FAINT),
        text(630, 231, "are paired exactly.", size=12, fill=FAINT),
    ]
    return svg(
        920,
        300,
        "Motion leads to observation and localisation, both lead to inference, and inference to a result",
        parts,
    )


def model() -> str:
    """Return the diagram of one robot: the walk, and what happens at a sample."""
    parts = [
        TIP,
        text(24, 26, "The walk", size=14, more='font-weight="bold"'),
        *box(24, 40, 180, "Drive", ("a leg of random length",)),
        *box(24, 140, 180, "Turn", ("by a random angle",)),
        *box(24, 240, 180, "Avoid", ("a wall or a robot is near",)),
        arrow("M90 92V138"),
        arrow("M130 140V94"),
        arrow("M24 266H10V66H22"),
        arrow("M204 80H222V266H206"),
        text(270, 26, "Every few seconds: a sample", size=14, more='font-weight="bold"'),
        *box(270, 40, 170, "Stop", ("for 1 s, on one tile",)),
        *box(270, 140, 170, "Read", ("energy E > threshold?", "bit O: 1 vibrates")),
        *box(480, 140, 180, "Count", ("O and the bits heard:", "Beta(\u03b1, \u03b2) of f"), STILL),
        *box(700, 140, 190, "Decide", ("p > 0.95: less than half", "p < 0.05: more than half"), STILL),
        *box(700, 260, 190, "Send one bit", ("reading, decision, or", "drawn from both"), VIBRATING),
        *box(480, 260, 180, "Other robots", ("hear it, unless it is", "lost on the way")),
        arrow("M204 58H268"),
        arrow("M355 92V138"),
        arrow("M440 175H478"),
        arrow("M660 175H698"),
        arrow("M795 210V258"),
        arrow("M700 295H662"),
        arrow("M570 260V212"),
        text(480, 118, "p = P(f < 1/2): the belief", size=12, fill=FAINT),
    ]
    return svg(
        920,
        350,
        "A robot drives, turns and avoids; at a sample it stops, reads, counts, decides and sends one bit",
        parts,
    )


PICTURES = {"inspection": inspection, "stages": stages, "model": model}

if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    for name, draw in PICTURES.items():
        (TARGET / f"{name}.svg").write_text(draw(), encoding="utf-8")
