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
from vibroswarm.motion.pose import pose
from vibroswarm.observation.decision_boundary import readings_boundary
from vibroswarm.result import Result
from vibroswarm.scenario.fault_draws import fault_words

if TYPE_CHECKING:
    from rich.console import RenderableType

FRAMES_PER_S = 12
"""Pictures a second in a terminal."""
LINES = 20
"""Number of lines of a playback without a terminal."""
BAR = 24
"""Length of the bar of a belief of 1, characters."""
SYMBOLS = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZ"
"""Symbols of robots 0, 1, ...; further robots use the same symbols from the first on."""


@dataclass(frozen=True)
class Moment:
    """What is shown at one time; the arrays and the list have one entry per robot."""

    time_s: float
    x_m: NDArray[np.float64]
    y_m: NDArray[np.float64]
    belief: NDArray[np.float64]
    """Probability that the share of ones is below the boundary; nan after a sample if the strategy keeps no belief."""
    decision: NDArray[np.int64]
    """Number of the answer that the robot has decided on; -1 while it is undecided."""
    faults: list[str]
    """Faults that have begun, in words; an empty text for a robot without faults."""
    radio: Radio | None = None
    """Which messages were sent and lost so far; None without a log of messages."""


@dataclass(frozen=True)
class Radio:
    """Messages that were sent until one time, each with its final state.

    The states are those at the end of the run: a message in state ``RECEIVED`` may arrive after this time.
    """

    lost: NDArray[np.int64]
    """(robots,): number of messages sent to each robot that were lost."""
    addressed: NDArray[np.int64]
    """(robots,): number of messages that others sent to each robot; every message goes to all others."""
    latest: NDArray[np.uint8]
    """(receivers, senders): state of the sender's latest message at the receiver; ``OWN`` if the sender has sent none,
    and on the diagonal."""


class Playback:
    """Run 0 of a result, whose state can be requested at any time (``at``).

    ``samples`` has a table for each robot: its samples in order of time, with its belief and decision after each.
    """

    def __init__(self, result: Result) -> None:
        """Prepare the tables from which ``at`` computes a moment.

        Args:
            result: one run, with segments (the robots' positions between samples).
        """
        self.result, self.scenario = result, result.scenario
        self.floor = result.floor()
        self.robots = result.ends.height  # one row for each robot
        self.end_s = float(result.ends["end_s"][0])  # the same for all robots of a run
        # ``motion`` is in order of time, which the join keeps.
        joined = result.motion.join(result.inference, on=["run", "robot", "sample"], maintain_order="left")
        self.log = self._message_log()
        self.samples = [joined.filter(pl.col("robot") == robot) for robot in range(self.robots)]

    def at(self, time_s: float) -> Moment:
        """Return the state at a time, s; for a time after the end of the run, the state at the end.

        Beliefs and decisions are those after each robot's latest sample. Before its first sample, a robot has the
        belief of the prior and is undecided.
        """
        assert self.result.segments is not None, "a playback needs segments"
        shown_s = min(time_s, self.end_s)
        # for each robot x (m), y (m) and heading
        poses = np.array(
            [pose(self.result.segments, run=0, robot=robot, time_s=shown_s) for robot in range(self.robots)]
        )
        belief = np.full(self.robots, self._prior_belief())
        decision = np.full(self.robots, -1)
        for robot, samples in enumerate(self.samples):
            done = int(samples["time_s"].search_sorted(shown_s, side="right"))  # number of samples until now
            if done:
                belief[robot], decision[robot] = (
                    samples["belief_below"][done - 1],
                    samples["decision"][done - 1],
                )
        return Moment(
            time_s=shown_s,
            x_m=poses[:, 0],
            y_m=poses[:, 1],
            belief=belief,
            decision=decision,
            faults=self._faults(shown_s),
            radio=self._radio(shown_s),
        )

    def _faults(self, time_s: float) -> list[str]:
        """Return for each robot, in words, its faults that have begun by a time, s; an empty text if it has none."""
        words = [list[str]() for _ in range(self.robots)]
        if self.result.faults is not None:
            begun = self.result.faults.filter((pl.col("run") == 0) & (pl.col("from_s") <= time_s))
            for row in begun.to_dicts():
                words[row["robot"]].append(fault_words(row["fault"]))
        return [", ".join(own) for own in words]

    def _message_log(self) -> MessageLog | None:
        """Return the messages of the run; None if their display is not needed, or if there are too many to list.

        It is not needed with the network ``ideal``, under which every robot hears every message.
        """
        if self.scenario.network.name == "ideal" or log_size(self.result) > MAX_ENTRIES:
            return None
        return message_log(self.result)

    def _radio(self, time_s: float) -> Radio | None:
        """Return which messages were sent and lost until a time, s; None without a log of messages."""
        if self.log is None:
            return None
        sent = int(np.searchsorted(self.log.time_s, time_s, side="right"))
        # The log is in the order of time, so the messages sent until now are its first rows: the state of each message
        # at each receiver, (messages, receivers), and the sender of each message, (messages,).
        state, sender = self.log.state[:sent], self.log.sender[:sent]
        latest = np.full((self.robots, self.robots), OWN, dtype=np.uint8)
        for i in range(self.robots):
            own = np.flatnonzero(sender == i)  # the messages that robot i has sent
            if own.size:
                latest[:, i] = state[own[-1]]  # the state of the last of them, at each receiver
        return Radio(lost=(state == LOST).sum(axis=0), addressed=(state != OWN).sum(axis=0), latest=latest)

    def _prior_belief(self) -> float:
        """Return the belief of a robot without samples, by the prior.

        It is the probability that the share of ones is below the boundary. The prior is a Beta distribution, whose
        cumulative distribution function is ``betainc``.
        """
        from scipy.special import betainc

        decision = self.scenario.decision
        return float(betainc(decision.prior_alpha, decision.prior_beta, readings_boundary(self.scenario)))


def play(result: Result, speed: float) -> None:
    """Play run 0 of a result back, ``speed`` times as fast as in reality.

    If stdout is not a terminal, ``LINES`` evenly spaced moments are printed as lines instead, without waiting.
    """
    playback = Playback(result)
    if not sys.stdout.isatty():
        # Time 0 is left out, since nothing has happened then.
        for time_s in np.linspace(0.0, playback.end_s, LINES + 1)[1:]:
            print(line(playback, playback.at(float(time_s))), flush=True)
        return
    from rich.live import Live

    began_s = time.monotonic()
    with Live(frame(playback, playback.at(0.0), speed), refresh_per_second=FRAMES_PER_S) as live:
        time_s = 0.0
        while time_s < playback.end_s:
            time.sleep(1.0 / FRAMES_PER_S)
            time_s = (time.monotonic() - began_s) * speed
            live.update(frame(playback, playback.at(time_s), speed))


def line(playback: Playback, moment: Moment) -> str:
    """Return a moment as one line of text: for each robot its belief, and a mark for its decision and faults.

    The belief is that in the task's first answer, such as "less"; "-" if the strategy has none. The mark is ? if the
    robot is undecided, < if it decided for the first answer, > for the second; ! follows if it has a fault. The line
    also has the number of lost messages, if the moment has ``radio``.
    """
    marks = {-1: "?", 0: "<", 1: ">"}
    beliefs = " ".join(
        f"{robot}:{_belief_text(belief)}{marks[int(decision)]}{'!' if faults else ''}"
        for robot, (belief, decision, faults) in enumerate(
            zip(moment.belief, moment.decision, moment.faults, strict=True)
        )
    )
    decided = int((moment.decision != -1).sum())
    failed = sum(bool(faults) for faults in moment.faults)
    note = f"  with a fault (!): {failed}" if failed else ""
    radio = moment.radio
    lost = "" if radio is None else f"  lost {radio.lost.sum()}/{radio.addressed.sum()}"
    head = f"t={moment.time_s:7.1f} s  decided {decided}/{moment.decision.size}{lost}"
    first = "less" if playback.scenario.task.name == "fill_ratio" else answers_of(playback.scenario)[0]
    return f"{head}  belief in '{first}' {beliefs}{note}"


def _belief_text(belief: float) -> str:
    """Return a belief with two decimals; "-" for nan, which strategies without beliefs have after a sample."""
    return "-" if np.isnan(belief) else f"{belief:.2f}"


def frame(playback: Playback, moment: Moment, speed: float) -> RenderableType:
    """Return a moment as a picture for the terminal: the arena, beliefs as bars, and who hears whom by radio.

    The radio is left out without a log of messages.

    Args:
        speed: simulated seconds per second, shown in the first line.
    """
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
    """Return the arena from above as lines of text: vibrating tiles shaded, a symbol for each robot.

    A character is about twice as high as wide, so a square has twice as many columns as rows.

    Args:
        rows: wanted number of lines. It gives the number of columns, which is limited to 4 to 100. If this limit
            changes the number of columns, the number of lines changes in proportion.
    """
    width_m, height_m = playback.scenario.arena.width_m, playback.scenario.arena.height_m
    columns = int(np.clip(round(2 * rows * width_m / height_m), 4, 100))
    rows = max(2, round(columns * height_m / width_m / 2))
    x = (np.arange(columns) + 0.5) * width_m / columns  # centres of the characters, m
    y = height_m - (np.arange(rows) + 0.5) * height_m / rows  # the first line is the top of the arena
    # Index of the tile under each character, (rows, columns); -1 where the floor does not reach.
    tile = playback.floor.tile_at(*np.meshgrid(x, y))
    flat = playback.floor.tiles.ravel()
    shade, dot = ("░", "·") if _has_unicode() else ("#", ".")
    # Where `tile` is -1, flat[-1] is the last tile, which does not matter: the outer `where` puts a blank there.
    cells = np.where(tile < 0, " ", np.where(flat[tile] == 1, shade, dot))
    # Clipped, so that a robot at the very edge of the arena is drawn in the outermost character.
    column = np.clip((moment.x_m / width_m * columns).astype(int), 0, columns - 1)
    row = np.clip(((height_m - moment.y_m) / height_m * rows).astype(int), 0, rows - 1)
    for robot in range(playback.robots):
        cells[row[robot], column[robot]] = SYMBOLS[robot % len(SYMBOLS)]
    return ["".join(cells[r]) for r in range(rows)]


def radio_rows(radio: Radio) -> list[str]:
    """Return the radio's state as lines of text: a header, then a row for each receiver.

    The row of a receiver has a mark for each sender, which shows whether the sender's latest message was heard or lost,
    and the number of all messages that the receiver lost so far. The mark is "-" if the message arrives too late to be
    read, and a blank if there is none. If there are more robots than symbols, the marks are left out.
    """
    heard, lost = ("●", "x") if _has_unicode() else ("o", "x")
    robots = radio.lost.size
    shown = robots if robots <= len(SYMBOLS) else 0
    marks = {RECEIVED: heard, LOST: lost, NOT_DUE: "-", OWN: " "}
    # The first 3 characters of each row are for the receiver's symbol.
    rows = [f"{'':3}{' '.join(SYMBOLS[:shown])}{'   lost' if shown else 'lost'}"]
    for robot in range(robots):
        row = " ".join(marks[int(state)] for state in radio.latest[robot, :shown])
        counts = f"{radio.lost[robot]} of {radio.addressed[robot]}"
        rows.append(f"{SYMBOLS[robot % len(SYMBOLS)]:<3}{row}{'   ' if shown else ''}{counts}")
    return rows


def belief_rows(playback: Playback, moment: Moment) -> list[str]:
    """Return beliefs as lines of text: a header, then for each robot a bar of its belief in the first answer.

    The first answer of the task ``fill_ratio`` is that the share of vibrating tiles is less than the boundary. After
    the bar, the line states the robot's decision and its faults.
    """
    boundary, answers = playback.scenario.decision.decision_boundary, answers_of(playback.scenario)
    answer = f"less than {100 * boundary:g} %" if playback.scenario.task.name == "fill_ratio" else answers[0]
    block, rest = ("█", "─") if _has_unicode() else ("=", "-")
    # The first 3 characters of each row are for the robot's symbol; in the header, 0 and 1 mark the ends of the bar.
    rows = [f"{'':3}{'0':<{BAR}}1   in '{answer}'"]
    for robot, (belief, decision) in enumerate(zip(moment.belief, moment.decision, strict=True)):
        full = 0 if np.isnan(belief) else round(belief * BAR)
        decision_text = "" if decision == -1 else f"  decided: {decision_words(int(decision), answers)}"
        decision_text += f"  ({moment.faults[robot]})" if moment.faults[robot] else ""
        rows.append(
            f"{SYMBOLS[robot % len(SYMBOLS)]:<3}{block * full}{rest * (BAR - full)} "
            f"{_belief_text(belief)}{decision_text}"
        )
    return rows
