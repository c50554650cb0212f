"""Answer a study's question in sentences: one for each pair of cells, with intervals, and one at equal error.

    soft against none: 127 s faster [102, 153], 11.9 points more right [8.4, 15.5], 6.7 points more wrong [3.9, 9.4];
    confirmed on other seeds.

Shares are of robots. A difference is stated if its p-value, corrected over all comparisons of the study, is below
0.05; it is confirmed if the other seeds show it too. A strategy that is faster and wrong more often is not called
better: it is compared at equal error as well (``analysis.forced_error``).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

from vibroswarm.analysis.cell_summary import CellSummary
from vibroswarm.analysis.forced_error import MatchedError
from vibroswarm.analysis.intervals import Interval
from vibroswarm.analysis.paired import DIRECTIONS, side
from vibroswarm.study.cell_comparison import Compared
from vibroswarm.study.spec import Cell
from vibroswarm.study.study_result import StudyResult

SIGNIFICANT: Final = 0.05
EFFECTS: Final = {
    "decision_time_s": ("time", "slower", "faster"),
    "right_share": ("right", "more right", "fewer right"),
    "wrong_share": ("wrong", "more wrong", "fewer wrong"),
    "undecided_share": ("undecided", "more undecided", "fewer undecided"),
}
"""Figures of an answer: its heading, and what a higher and a lower value is called."""
MOST_NAMES: Final = 6
"""Cells of a question that are named."""


@dataclass(frozen=True)
class Effect:
    """One figure of a comparison."""

    figure: str
    """Of ``EFFECTS``."""
    interval: Interval
    """First - reference, in s or percentage points."""
    unit: str
    significant: bool
    repeated: bool
    """Whether it was compared on other seeds too."""
    confirmed: bool

    @property
    def better(self) -> bool | None:
        """Whether the first cell is better in this figure; None where no difference is shown."""
        return self.interval.estimate * DIRECTIONS[self.figure] > 0 if self.significant else None

    @property
    def words(self) -> str:
        """The difference with its interval: ``127 s faster [102, 153]``."""
        _, higher, lower = EFFECTS[self.figure]
        value, low, high = self.interval[:3]
        size, word = f"{self._text(abs(value))} {self.unit}", higher if value > 0 else lower
        ends = (low, high) if value > 0 else (-high, -low)
        return f"{size} {word} {self._brackets(*map(self._text, ends))}".strip()

    @property
    def number(self) -> str:
        """The difference with its sign, unit and interval: ``-127 s [-153, -102]``."""
        if math.isnan(self.interval.estimate):
            return "not defined"
        value, low, high = (self._signed(v) for v in self.interval[:3])
        return f"{value} {self.unit} {self._brackets(low, high)}".strip()

    def _brackets(self, low: str, high: str) -> str:
        finite = math.isfinite(self.interval.low) and math.isfinite(self.interval.high)
        return f"[{low}, {high}]" if finite else ""

    def _text(self, value: float) -> str:
        """Write a number with the digits of the effect: whole seconds if it has two digits, else one decimal."""
        largest = max((abs(v) for v in self.interval[:3] if math.isfinite(v)), default=0.0)
        text = f"{value:.{0 if self.unit == 's' and largest >= 9.95 else 1}f}"
        return text if float(text) else text.removeprefix("-")

    def _signed(self, value: float) -> str:
        text = self._text(value)
        return text if text.startswith("-") or not float(text) else f"+{text}"


@dataclass(frozen=True)
class Answer:
    """What a comparison of two cells says."""

    cell: Cell
    reference: Cell
    first_name: str
    reference_name: str
    rest: str
    """What both cells have in common and others do not."""
    effects: tuple[Effect, ...]
    pairs: int
    matched: MatchedError | None

    @property
    def name(self) -> str:
        """``soft against none, random:0.48``."""
        return f"{self.first_name} against {self.reference_name}" + (f", {self.rest}" if self.rest else "")

    @property
    def headline(self) -> str:
        """Which is faster and which is wrong more often, in a few words."""
        by_figure = {effect.figure: effect for effect in self.effects}
        time, wrong = (self._says(by_figure[figure]) for figure in ("decision_time_s", "wrong_share"))
        if time is None and wrong is None:
            return (
                f"{self.first_name} and {self.reference_name}: no difference shown in time or wrong decisions"
            )
        if time is None:
            return f"{self.first_name} is {wrong} than {self.reference_name}; no difference shown in time"
        open_ = "; no difference shown in wrong decisions"
        return f"{self.first_name} is {time} than {self.reference_name}{open_ if wrong is None else f', and {wrong}'}"

    @staticmethod
    def _says(effect: Effect) -> str | None:
        """Return the comparative of an effect; None if it is not significant."""
        words = {
            "decision_time_s": ("slower", "faster"),
            "wrong_share": ("wrong more often", "wrong less often"),
        }
        return words[effect.figure][int(effect.interval.estimate < 0)] if effect.significant else None

    @property
    def sentence(self) -> str:
        """The comparison in one sentence."""
        shown = [effect for effect in self.effects if effect.significant]
        open_ = [effect for effect in self.effects if not effect.significant]
        if not shown:
            return f"{self.name}: no significant difference ({_listed(open_)})."
        text = f"{self.name}: {', '.join(effect.words for effect in shown)}; {_confirmed(shown)}."
        return text + (f" Not significant: {_listed(open_)}." if open_ else "")

    @property
    def at_equal_error(self) -> str:
        """The comparison at equal error in one sentence; empty if there is none."""
        found = self.matched
        if found is None:
            return ""
        of = self.first_name if found.of_first else self.reference_name
        where = f"At equal error ({100 * found.error:.1f} %, that of {of}), each with its best settings: "
        difference = found.time_difference_s
        if math.isnan(difference.estimate):
            return f"{where}not known, since one of the two never errs so seldom."
        effect = Effect("decision_time_s", difference, "s", side(difference) != 0, False, False)
        if not effect.significant:
            return f"{where}no significant difference in time, {effect.number}.{self._moral(None)}"
        return f"{where}{self.first_name} {effect.words}.{self._moral(difference.estimate < 0)}"

    def _moral(self, faster_at_equal_error: bool | None) -> str:
        """Return what equal error says about a strategy that is faster and wrong more often; empty if neither is both.

        Args:
            faster_at_equal_error: whether the first strategy is faster there; None if no difference is shown.
        """
        better = {effect.figure: effect.better for effect in self.effects}
        if better["decision_time_s"] is None or better["wrong_share"] is None:
            return ""
        if better["decision_time_s"] == better["wrong_share"]:
            return ""
        faster = self.first_name if better["decision_time_s"] else self.reference_name
        if faster_at_equal_error is None or faster_at_equal_error != better["decision_time_s"]:
            return f" So {faster} is faster as run, but not shown to be better: it is wrong more often."
        return f" So {faster} is faster, and not only because it is wrong more often."

    def as_row(self) -> dict[str, float | int | str | None]:
        """Return what was compared at equal error as a flat row."""
        found = self.matched
        row: dict[str, float | int | str | None] = {
            "name": self.name,
            "cell": self.cell.number,
            "reference": self.reference.number,
        }
        if found is None:
            return row
        row |= {"error": found.error, "time_s": found.time_s, "runs": found.time_difference_s.n}
        for name, interval in (
            ("time_difference_s", found.time_difference_s),
            ("error_difference", found.error_difference),
        ):
            for end, value in zip(("", "_low", "_high"), interval[:3], strict=True):
                row[f"{name}{end}"] = value if math.isfinite(value) else None
        return row


def answers_of(
    compared: Sequence[Compared], matched: Mapping[tuple[int, int], MatchedError]
) -> tuple[Answer, ...]:
    """Return an answer for each pair of cells; of pairs that share all else, the largest difference in time first.

    Args:
        compared: all figures of all pairs. matched: by the numbers of cell and reference
            (``cell_comparison.at_equal_error``).
    """
    by_pair: dict[tuple[int, int, str], dict[str, Compared]] = {}
    for one in compared:
        key = (one.cell.number, one.reference.number, one.field)
        by_pair.setdefault(key, {})[one.first.figure] = one
    found = [_answer(figures, matched.get(pair[:2])) for pair, figures in by_pair.items()]
    groups: dict[str, int] = {}
    for answer in found:
        groups.setdefault(answer.rest, len(groups))
    return tuple(sorted(found, key=lambda answer: (groups[answer.rest], -_size(answer))))


def _size(answer: Answer) -> float:
    """Return the absolute difference in time; 0 if it is undefined."""
    size = abs(answer.effects[0].interval.estimate)
    return 0.0 if math.isnan(size) else size


def _answer(figures: Mapping[str, Compared], matched: MatchedError | None) -> Answer:
    """Return the answer of one pair."""
    any_ = next(iter(figures.values()))
    effects = tuple(_effect(figures[figure]) for figure in EFFECTS if figure in figures)
    first, reference, rest = any_.names
    return Answer(any_.cell, any_.reference, first, reference, rest, effects, any_.first.pairs, matched)


def _effect(one: Compared) -> Effect:
    """Return an effect with shares in percentage points."""
    share = one.first.figure != "decision_time_s"
    interval = one.first.difference
    if share:
        interval = interval._replace(**{n: 100 * getattr(interval, n) for n in ("estimate", "low", "high")})
    return Effect(
        one.first.figure,
        interval,
        "points" if share else "s",
        one.first.p_holm < SIGNIFICANT,
        one.replicate is not None,
        one.replicate is not None and one.replicate.confirmed,
    )


def _confirmed(shown: Sequence[Effect]) -> str:
    """Return which of the differences the other seeds confirm."""
    if not any(effect.repeated for effect in shown):
        return "not repeated on other seeds"
    missing = [EFFECTS[effect.figure][0] for effect in shown if not effect.confirmed]
    if not missing:
        return "confirmed on other seeds"
    confirmed = [EFFECTS[effect.figure][0] for effect in shown if effect.confirmed]
    kept = f"{_joined(confirmed, 'and')} confirmed on other seeds, " if confirmed else ""
    return f"{kept}{_joined(missing, 'and')} not confirmed" + ("" if confirmed else " on other seeds")


def _listed(effects: Sequence[Effect]) -> str:
    return ", ".join(f"{EFFECTS[effect.figure][0]} {effect.number}" for effect in effects)


def _joined(names: Sequence[str], word: str) -> str:
    """List names; between semicolons where they have commas of their own."""
    if len(names) == 1:
        return names[0]
    comma = "; " if any(", " in name for name in names) else ", "
    last = f"{comma.rstrip()} {word} " if comma == "; " else f" {word} "
    return f"{comma.join(names[:-1])}{last}{names[-1]}"


def title(result: StudyResult) -> str:
    """Return the study's name, or those of its cells."""
    names = [result.study.cells[number].name for number in result.selected]
    return result.study.name or (_joined(names, "and") if len(names) <= MOST_NAMES else f"{len(names)} cells")


def question(result: StudyResult, compared: Sequence[Compared]) -> str:
    """Say what was asked: what is compared, in which setting, in how many runs."""
    cells = [result.study.cells[number] for number in result.selected]
    first = cells[0].scenario
    varied = result.study.varied
    robots = (
        "" if "swarm.robots" in varied else f"{first.swarm.robots} robot{'s' * (first.swarm.robots != 1)}"
    )
    floor = "" if "floor.source" in varied else f"floor {first.floor.source}"
    where = ", ".join(words for words in (robots, floor, f"up to {first.run.t_end_s:g} s") if words)
    names = [cell.name for cell in cells]
    listed = _joined(names, "or") if 1 < len(names) <= MOST_NAMES else title(result)
    runs = sorted({result.runs_of(cell.number) for cell in cells})
    count = f"{runs[0]:,}" if len(runs) == 1 else f"{runs[0]:,} to {runs[-1]:,}"
    if not compared:
        return f"{listed}: {where}; {count} runs{' each' * (len(cells) > 1)}, seed {result.study.seed}."
    return (
        f"Which decides sooner, and which is wrong more often: {listed}? {where[0].upper()}{where[1:]}; {count} runs "
        f"each, compared run by run."
    )


class Figures(Protocol):
    """What is said of a cell that is not compared."""

    @property
    def cell(self) -> Cell:
        """The cell."""
        ...

    @property
    def summary(self) -> CellSummary:
        """Its figures."""
        ...


def cell_sentences(cells: Sequence[Figures]) -> list[str]:
    """Return what became of the robots of each cell, in a sentence."""
    sentences = []
    for one in cells:
        found = one.summary
        shares = (
            ("right", found.robots_right),
            ("wrong", found.robots_wrong),
            ("undecided", found.robots_undecided),
        )
        words = [f"{_percent(share)} {word}" for word, share in shares if not math.isnan(share.estimate)]
        time = found.decision_time_s
        limits = f" [{time.low:.0f}, {time.high:.0f}]" if math.isfinite(time.low) else ""
        sentences.append(
            f"{one.cell.name}: robots {', '.join(words)}; decision time {time.estimate:.0f} s{limits}."
        )
    return sentences


def _percent(share: Interval) -> str:
    limits = f" [{100 * share.low:.1f}, {100 * share.high:.1f}]" if math.isfinite(share.low) else ""
    return f"{100 * share.estimate:.1f} %{limits}"
