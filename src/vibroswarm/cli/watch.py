"""``--watch``: play an inspection back in the terminal, or as plain lines elsewhere."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.analysis.message_log import (
    LOST,
    MAX_ENTRIES,
    NOT_DUE,
    OWN,
    RECEIVED,
    MessageLog,
    log_size,
    message_log,
)
from vibroswarm.analysis.verdict import answers_of, decision_words
from vibroswarm.faults import fault_words
from vibroswarm.motion.pose import pose
from vibroswarm.observation.decision_boundary import readings_boundary
from vibroswarm.result import Result

if TYPE_CHECKING:
    from rich.console import RenderableType

FRAMES_PER_S = 12
LINES = 20
"""Number of lines of a playback without a terminal."""
BAR = 24
SYMBOLS = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZ"


@dataclass(frozen=True)
class Moment:
    """What is shown at one time; one entry per robot."""

    time_s: float
    x_m: NDArray[np.float64]
    y_m: NDArray[np.float64]
    belief: NDArray[np.float64]
    decision: NDArray[np.int64]
    faults: list[str]
    """Of each robot, in words; empty while it has none."""
    radio: Radio | None = None


@dataclass(frozen=True)
class Radio:
    """What was sent until one time."""

    lost: NDArray[np.int64]
    """(robots,): messages to each robot that are lost."""
    addressed: NDArray[np.int64]
    """(robots,): messages to it."""
    latest: NDArray[np.uint8]
    """(receivers, senders): state of the sender's latest message there; ``OWN`` if there is none."""


class Playback:
    """Run 0 of a result, at any time."""

    def __init__(self, result: Result) -> None:
        self.result, self.scenario = result, result.scenario
        self.floor = result.floor()
        self.robots = result.ends.height
        self.end_s = float(result.ends["end_s"][0])
        joined = result.motion.join(result.inference, on=["run", "robot", "sample"], maintain_order="left")
        self.log = self._message_log()
        self.samples = [joined.filter(pl.col("robot") == robot) for robot in range(self.robots)]

    def at(self, time_s: float) -> Moment:
        """Return the state at a time."""
        assert self.result.segments is not None, "a playback needs segments"
        at = min(time_s, self.end_s)
        poses = np.array([pose(self.result.segments, 0, robot, at) for robot in range(self.robots)])
        belief = np.full(self.robots, self._prior_belief())
        decision = np.full(self.robots, -1)
        for robot, samples in enumerate(self.samples):
            done = int(samples["time_s"].search_sorted(at, side="right"))
            if done:
                belief[robot], decision[robot] = (
                    samples["belief_below"][done - 1],
                    samples["decision"][done - 1],
                )
        return Moment(at, poses[:, 0], poses[:, 1], belief, decision, self._faults(at), self._radio(at))

    def _faults(self, time_s: float) -> list[str]:
        words = [list[str]() for _ in range(self.robots)]
        if self.result.faults is not None:
            begun = self.result.faults.filter((pl.col("run") == 0) & (pl.col("from_s") <= time_s))
            for row in begun.to_dicts():
                words[row["robot"]].append(fault_words(row["fault"]))
        return [", ".join(own) for own in words]

    def _message_log(self) -> MessageLog | None:
        """Return the run's messages, unless all hear all or there are too many to list."""
        if self.scenario.network.name == "ideal" or log_size(self.result) > MAX_ENTRIES:
            return None
        return message_log(self.result)

    def _radio(self, time_s: float) -> Radio | None:
        """Return what was sent and lost until a time, s; None without a log of messages."""
        if self.log is None:
            return None
        sent = int(np.searchsorted(self.log.time_s, time_s, side="right"))
        state, sender = self.log.state[:sent], self.log.sender[:sent]
        latest = np.full((self.robots, self.robots), OWN, dtype=np.uint8)
        for i in range(self.robots):
            own = np.flatnonzero(sender == i)
            if own.size:
                latest[:, i] = state[own[-1]]
        return Radio((state == LOST).sum(axis=0), (state != OWN).sum(axis=0), latest)

    def _prior_belief(self) -> float:
        from scipy.special import betainc

        decision = self.scenario.decision
        return float(betainc(decision.prior_alpha, decision.prior_beta, readings_boundary(self.scenario)))


def play(result: Result, speed: float) -> None:
    """Play run 0 back, ``speed`` times as fast; as plain lines if stdout is not a terminal."""
    playback = Playback(result)
    if not sys.stdout.isatty():
        for time_s in np.linspace(0.0, playback.end_s, LINES + 1)[1:]:
            print(line(playback.at(float(time_s))), flush=True)
        return
    from rich.live import Live

    began_s = time.monotonic()
    with Live(frame(playback, playback.at(0.0), speed), refresh_per_second=FRAMES_PER_S) as live:
        time_s = 0.0
        while time_s < playback.end_s:
            time.sleep(1.0 / FRAMES_PER_S)
            time_s = (time.monotonic() - began_s) * speed
            live.update(frame(playback, playback.at(time_s), speed))


def line(moment: Moment) -> str:
    """Return a moment as one line of text."""
    marks = {-1: "?", 0: "<", 1: ">"}
    beliefs = " ".join(
        f"{robot}:{belief:.2f}{marks[int(decision)]}{'!' if faults else ''}"
        for robot, (belief, decision, faults) in enumerate(
            zip(moment.belief, moment.decision, moment.faults, strict=True)
        )
    )
    decided = int((moment.decision != -1).sum())
    failed = sum(bool(faults) for faults in moment.faults)
    note = f"  with a fault (!): {failed}" if failed else ""
    radio = moment.radio
    lost = "" if radio is None else f"  lost {radio.lost.sum()}/{radio.addressed.sum()}"
    return f"t={moment.time_s:7.1f} s  decided {decided}/{moment.decision.size}{lost}  belief in 'less' {beliefs}{note}"


def frame(playback: Playback, moment: Moment, speed: float) -> RenderableType:
    """Return a moment as a terminal picture: the arena, and each robot's belief as a bar."""
    from rich.columns import Columns
    from rich.console import Group
    from rich.panel import Panel
    from rich.text import Text

    decided = int((moment.decision != -1).sum())
    head = Text(
        f"t = {moment.time_s:7.1f} s of {playback.end_s:g} s   {speed:g}x   "
        f"{decided} of {playback.robots} decided   Ctrl-C to stop"
    )
    arena = Panel(Text("\n".join(arena_rows(playback, moment))), title="arena", expand=False)
    beliefs = Panel(Text("\n".join(belief_rows(playback, moment))), title="belief", expand=False)
    panels = [arena, beliefs]
    if moment.radio is not None:
        rows = radio_rows(moment.radio)
        panels.append(Panel(Text("\n".join(rows)), title="radio: who hears whom", expand=False))
    return Group(head, Columns(panels))


def _has_unicode() -> bool:
    """Return whether the terminal shows more than ASCII."""
    return "utf" in (sys.stdout.encoding or "").lower()


def arena_rows(playback: Playback, moment: Moment, rows: int = 22) -> list[str]:
    """Return the arena from above: vibrating tiles shaded, a symbol for each robot; cells are twice as high as wide."""
    width_m, height_m = playback.scenario.arena.width_m, playback.scenario.arena.height_m
    columns = int(np.clip(round(2 * rows * width_m / height_m), 4, 100))
    rows = max(2, round(columns * height_m / width_m / 2))
    x = (np.arange(columns) + 0.5) * width_m / columns
    y = height_m - (np.arange(rows) + 0.5) * height_m / rows
    tile = playback.floor.tile_at(*np.meshgrid(x, y))
    flat = playback.floor.tiles.ravel()
    shade, dot = ("░", "·") if _has_unicode() else ("#", ".")
    cells = np.where(tile < 0, " ", np.where(flat[tile] == 1, shade, dot))
    column = np.clip((moment.x_m / width_m * columns).astype(int), 0, columns - 1)
    row = np.clip(((height_m - moment.y_m) / height_m * rows).astype(int), 0, rows - 1)
    for robot in range(playback.robots):
        cells[row[robot], column[robot]] = SYMBOLS[robot % len(SYMBOLS)]
    return ["".join(cells[r]) for r in range(rows)]


def radio_rows(radio: Radio) -> list[str]:
    """Return a row for each receiver: a mark for each sender's latest message, heard or lost, and what was lost."""
    heard, lost = ("●", "x") if _has_unicode() else ("o", "x")
    robots = radio.lost.size
    shown = robots if robots <= len(SYMBOLS) else 0  # a larger swarm: the counts alone
    marks = {RECEIVED: heard, LOST: lost, NOT_DUE: "-", OWN: " "}
    rows = [f"{'':3}{' '.join(SYMBOLS[:shown])}{'   lost' if shown else 'lost'}"]
    for robot in range(robots):
        row = " ".join(marks[int(state)] for state in radio.latest[robot, :shown])
        counts = f"{radio.lost[robot]} of {radio.addressed[robot]}"
        rows.append(f"{SYMBOLS[robot % len(SYMBOLS)]:<3}{row}{'   ' if shown else ''}{counts}")
    return rows


def belief_rows(playback: Playback, moment: Moment) -> list[str]:
    """Return a bar for each robot: its belief that less than the boundary vibrates."""
    boundary, answers = playback.scenario.decision.decision_boundary, answers_of(playback.scenario)
    answer = f"less than {100 * boundary:g} %" if playback.scenario.task.name == "fill_ratio" else answers[0]
    block, rest = ("█", "─") if _has_unicode() else ("=", "-")
    rows = [f"{'':3}{'0':<{BAR}}1   in '{answer}'"]
    for robot, (belief, decision) in enumerate(zip(moment.belief, moment.decision, strict=True)):
        full = round(belief * BAR)
        decision_text = "" if decision == -1 else f"  decided: {decision_words(int(decision), answers)}"
        decision_text += f"  ({moment.faults[robot]})" if moment.faults[robot] else ""
        rows.append(
            f"{SYMBOLS[robot % len(SYMBOLS)]:<3}{block * full}{rest * (BAR - full)} {belief:.2f}{decision_text}"
        )
    return rows
