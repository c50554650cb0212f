"""Answer a study's question in sentences: one for each pair of cells, with intervals, and one at equal error.

    soft against none: 127 s faster [102, 153], 11.9 points more right [8.4, 15.5], 6.7 points more wrong [3.9, 9.4];
    confirmed on other seeds.

A pair is a cell and its reference; every difference is cell - reference. Shares are shares of robots, and "points" are
percentage points. A difference is significant if its p-value, corrected over all comparisons of the study, is below
0.05. It is confirmed if the study's second block of runs, from another seed, shows it too. A strategy that is faster
and wrong more often is not called better: the pair is compared at equal error as well (``analysis.forced_error``).
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
from vibroswarm.analysis.verdict import answers_of as answers_in_words
from vibroswarm.study.cell_comparison import Compared
from vibroswarm.study.spec import Cell
from vibroswarm.study.study_result import StudyResult

SIGNIFICANT: Final = 0.05
"""A difference is significant if its corrected p-value is below this."""
EFFECTS: Final = {
    "decision_time_s": ("time", "slower", "faster"),
    "right_share": ("right", "more right", "fewer right"),
    "wrong_share": ("wrong", "more wrong", "fewer wrong"),
    "undecided_share": ("undecided", "more undecided", "fewer undecided"),
}
"""For each figure of an answer: its short name, and the words for a higher and for a lower value."""
MOST_NAMES: Final = 6
"""The cells of a question are named if there are at most this many."""


@dataclass(frozen=True)
class Effect:
    """The difference of one figure between a cell and its reference."""

    figure: str
    """A key of ``EFFECTS``."""
    interval: Interval
    """Cell - reference, in s or percentage points."""
    unit: str
    """``s`` or ``points``."""
    significant: bool
    repeated: bool
    """Whether the figure was compared on the other seed too."""
    confirmed: bool
    """Whether the other seed shows the same difference."""

    @property
    def better(self) -> bool | None:
        """Whether the cell is better than its reference in this figure; None if the difference is not significant."""
        if not self.significant:
            return None
        # The direction is 1 if higher is better, else -1.
        return self.interval.estimate * DIRECTIONS[self.figure] > 0

    @property
    def words(self) -> str:
        """The size of the difference with its direction in words and its interval: ``127 s faster [102, 153]``.

        The interval is left out if a limit is not finite. The difference must be significant: for 0 or nan the words
        have no sense.
        """
        _, word_if_higher, word_if_lower = EFFECTS[self.figure]
        estimate, low, high = self.interval[:3]
        # The word gives the sign, so a negative difference and its limits are written with their signs reversed.
        if estimate > 0:
            word = word_if_higher
        else:
            word, low, high = word_if_lower, -high, -low
        brackets = self._brackets(self._text(low), self._text(high))
        return f"{self._text(abs(estimate))} {self.unit} {word} {brackets}".strip()

    @property
    def number(self) -> str:
        """The difference with its sign, unit and interval: ``-127 s [-153, -102]``; or ``not defined``.

        The interval is left out if a limit is not finite.
        """
        if math.isnan(self.interval.estimate):
            return "not defined"
        estimate, low, high = (self._signed(value) for value in self.interval[:3])
        return f"{estimate} {self.unit} {self._brackets(low, high)}".strip()

    def _brackets(self, low: str, high: str) -> str:
        """Put the two limits, given as text, in brackets; return an empty text if a limit is not finite."""
        finite = math.isfinite(self.interval.low) and math.isfinite(self.interval.high)
        return f"[{low}, {high}]" if finite else ""

    def _text(self, value: float) -> str:
        """Write a value without ``+``; the estimate and the limits of an effect have the same number of decimals.

        Times are written in whole seconds if the estimate or a limit rounds to 10.0 s or more. All other values have
        one decimal.
        """
        # Estimate and limits; limits may be infinite, and all three may be nan.
        largest = max((abs(v) for v in self.interval[:3] if math.isfinite(v)), default=0.0)
        decimals = 0 if self.unit == "s" and largest >= 9.95 else 1  # above 9.95, one decimal gives 10.0
        text = f"{value:.{decimals}f}"
        return text if float(text) else text.removeprefix("-")  # 0.0 instead of -0.0

    def _signed(self, value: float) -> str:
        """Write a value as ``_text`` does, with ``+`` before a positive value; a value written as 0 has no sign."""
        text = self._text(value)
        return text if text.startswith("-") or not float(text) else f"+{text}"


@dataclass(frozen=True)
class Answer:
    """What a comparison of a cell with its reference says."""

    cell: Cell
    reference: Cell
    first_name: str
    """What the cell is called in this comparison."""
    reference_name: str
    """What its reference is called."""
    rest: str
    """The varied values that both cells share, as text."""
    effects: tuple[Effect, ...]
    """In the order of ``EFFECTS``, one for each figure that was compared; ``comparisons`` compares all of them."""
    pairs: int
    """Number of runs that the first figure compares."""
    matched: MatchedError | None
    """The comparison at equal error; None if there is none."""

    @property
    def name(self) -> str:
        """``soft against none, random:0.48``."""
        return f"{self.first_name} against {self.reference_name}" + (f", {self.rest}" if self.rest else "")

    @property
    def headline(self) -> str:
        """Which of the two cells is faster and which is wrong more often, in a few words."""
        by_figure = {effect.figure: effect for effect in self.effects}
        time, wrong = (self._comparative(by_figure[figure]) for figure in ("decision_time_s", "wrong_share"))
        if time is None and wrong is None:
            return (
                f"{self.first_name} and {self.reference_name}: no difference shown in time or wrong decisions"
            )
        if time is None:
            return f"{self.first_name} is {wrong} than {self.reference_name}; no difference shown in time"
        about_wrong = "; no difference shown in wrong decisions" if wrong is None else f", and {wrong}"
        return f"{self.first_name} is {time} than {self.reference_name}{about_wrong}"

    @staticmethod
    def _comparative(effect: Effect) -> str | None:
        """Return ``slower``, ``wrong less often`` or the like for time or wrong share; None if not significant."""
        if not effect.significant:
            return None
        word_if_higher, word_if_lower = {
            "decision_time_s": ("slower", "faster"),
            "wrong_share": ("wrong more often", "wrong less often"),
        }[effect.figure]
        return word_if_lower if effect.interval.estimate < 0 else word_if_higher

    @property
    def sentence(self) -> str:
        """All significant differences and whether they are confirmed; a second sentence lists the other differences."""
        shown = [effect for effect in self.effects if effect.significant]
        others = [effect for effect in self.effects if not effect.significant]
        if not shown:
            return f"{self.name}: no significant difference ({_listed(others)})."
        text = f"{self.name}: {', '.join(effect.words for effect in shown)}; {_confirmed(shown)}."
        return text + (f" Not significant: {_listed(others)}." if others else "")

    @property
    def at_equal_error(self) -> str:
        """The comparison at equal error and what follows from it, in one or two sentences.

        It is empty if the pair was not compared at equal error.
        """
        found = self.matched
        if found is None:
            return ""
        # The strategies are compared at the error of the one that errs more as run: settings can always make a strategy
        # err more often, but not always less often.
        erring_more = self.first_name if found.of_first else self.reference_name
        where = f"At equal error ({100 * found.error:.1f} %, that of {erring_more}), each with its best settings: "
        difference = found.time_difference_s
        # A safeguard: as run, neither errs more than this, so ``matched_error`` always gives an estimate.
        if math.isnan(difference.estimate):
            return f"{where}not known, since one of the two never errs so seldom."
        if math.isnan(difference.low) or math.isnan(difference.high):
            how = (
                f"{difference.estimate:+.0f} s, but in too many resamples one of the two never errs so seldom"
            )
            return f"{where}{how}."
        # There is no p-value at equal error: the difference is significant if its interval excludes 0.
        effect = Effect(
            figure="decision_time_s",
            interval=difference,
            unit="s",
            significant=side(difference) != 0,
            repeated=False,  # the comparison at equal error has no second block of runs
            confirmed=False,
        )
        if not effect.significant:
            return f"{where}no significant difference in time, {effect.number}.{self._conclusion(None)}"
        return f"{where}{self.first_name} {effect.words}.{self._conclusion(difference.estimate < 0)}"

    @property
    def faster_and_more_wrong(self) -> str | None:
        """Name of the cell that is significantly faster, and also wrong significantly more often; None if none is."""
        better = {effect.figure: effect.better for effect in self.effects}
        first_is_faster, first_errs_less = better["decision_time_s"], better["wrong_share"]
        if first_is_faster is None or first_errs_less is None or first_is_faster == first_errs_less:
            return None
        return self.first_name if first_is_faster else self.reference_name

    def _conclusion(self, first_is_faster_at_equal_error: bool | None) -> str:
        """Write whether a strategy that is faster and wrong more often, as run, is faster at equal error too.

        Args:
            first_is_faster_at_equal_error: None if the difference at equal error is not significant.
        Returns: a sentence after a space. It is empty unless one of the two is significantly faster and also wrong
            significantly more often.
        """
        faster = self.faster_and_more_wrong
        if faster is None:
            return ""
        first_is_faster = faster == self.first_name
        if first_is_faster_at_equal_error is None or first_is_faster_at_equal_error != first_is_faster:
            return f" So {faster} is faster as run, but not shown to be better: it is wrong more often."
        return f" So {faster} is faster, and not only because it is wrong more often."

    def as_row(self) -> dict[str, float | int | str | None]:
        """Return the comparison at equal error as a flat row for a table; without it, only name and cell numbers.

        A difference has three columns: the estimate, and its limits in ``..._low`` and ``..._high``. A value that is
        not finite is None.
        """
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
    """Return one answer for each pair of cells.

    Answers with equal ``Answer.rest`` (the varied values that cell and reference share) stand together, in the order
    in which the values of ``rest`` first appear. Within such a group, the largest difference in time comes first.

    Args:
        compared: all figures of all pairs (``cell_comparison.comparisons``); empty: there are no answers.
        matched: comparisons at equal error, by the numbers of cell and reference (``cell_comparison.at_equal_error``).
    """
    # For each pair, its comparisons by figure. A pair is given by cell, reference and compared field.
    by_pair: dict[tuple[int, int, str], dict[str, Compared]] = {}
    for one in compared:
        key = (one.cell.number, one.reference.number, one.field)
        by_pair.setdefault(key, {})[one.first.figure] = one
    found = [
        _answer(figures, matched.get((cell, reference))) for (cell, reference, _), figures in by_pair.items()
    ]
    rank_of_rest: dict[str, int] = {}  # the position at which each ``rest`` first appears
    for answer in found:
        rank_of_rest.setdefault(answer.rest, len(rank_of_rest))
    return tuple(sorted(found, key=lambda answer: (rank_of_rest[answer.rest], -_time_difference(answer))))


def _time_difference(answer: Answer) -> float:
    """Return the absolute difference in decision time, which is the first effect; 0 if it is undefined."""
    size = abs(answer.effects[0].interval.estimate)
    return 0.0 if math.isnan(size) else size


def _answer(figures: Mapping[str, Compared], matched: MatchedError | None) -> Answer:
    """Return the answer of one pair of cells.

    Args:
        figures: the pair's comparisons by figure, those of ``EFFECTS`` among them. matched: its comparison at equal
            error, None if there is none.
    """
    # The comparison of the first figure. All figures of the pair have the same cells and names.
    one = next(iter(figures.values()))
    effects = tuple(_effect(figures[figure]) for figure in EFFECTS)
    first_name, reference_name, rest = one.names
    return Answer(
        cell=one.cell,
        reference=one.reference,
        first_name=first_name,
        reference_name=reference_name,
        rest=rest,
        effects=effects,
        pairs=one.first.pairs,
        matched=matched,
    )


def _effect(one: Compared) -> Effect:
    """Return the comparison of one figure as an effect, with differences of shares in percentage points."""
    is_share = one.first.figure != "decision_time_s"
    interval = one.first.difference
    if is_share:
        interval = interval._replace(**{n: 100 * getattr(interval, n) for n in ("estimate", "low", "high")})
    return Effect(
        figure=one.first.figure,
        interval=interval,
        unit="points" if is_share else "s",
        significant=one.first.p_holm < SIGNIFICANT,
        repeated=one.replicate is not None,
        confirmed=one.replicate is not None and one.replicate.confirmed,
    )


def _confirmed(shown: Sequence[Effect]) -> str:
    """Write which of the significant differences ``shown``, at least one, the runs from the other seed confirm.

    Returns: such as ``time confirmed on other seeds, wrong not confirmed``.
    """
    if not any(effect.repeated for effect in shown):
        return "not repeated on other seeds"
    confirmed = [EFFECTS[effect.figure][0] for effect in shown if effect.confirmed]
    unconfirmed = [EFFECTS[effect.figure][0] for effect in shown if not effect.confirmed]
    if not unconfirmed:
        return "confirmed on other seeds"
    if not confirmed:
        return f"{_joined(unconfirmed, 'and')} not confirmed on other seeds"
    return (
        f"{_joined(confirmed, 'and')} confirmed on other seeds, {_joined(unconfirmed, 'and')} not confirmed"
    )


def _listed(effects: Sequence[Effect]) -> str:
    """List effects with short name and difference: ``time -127 s [-153, -102], wrong +6.7 points [3.9, 9.4]``."""
    return ", ".join(f"{EFFECTS[effect.figure][0]} {effect.number}" for effect in effects)


def _joined(names: Sequence[str], word: str) -> str:
    """Join names as in ``a, b and c``, where ``word`` is ``and``; as in ``a; b; and c`` if a name contains a comma."""
    if len(names) == 1:
        return names[0]
    has_commas = any(", " in name for name in names)
    separator = "; " if has_commas else ", "
    before_last = f"; {word} " if has_commas else f" {word} "
    return f"{separator.join(names[:-1])}{before_last}{names[-1]}"


def title(result: StudyResult) -> str:
    """Return the study's name; without one, the names of its selected cells, or their number if they are many."""
    names = [result.study.cells[number].name for number in result.selected]
    return result.study.name or (_joined(names, "and") if len(names) <= MOST_NAMES else f"{len(names)} cells")


def question(result: StudyResult, compared: Sequence[Compared]) -> str:
    """Write what the study asks: which cells are compared, in which setting, and in how many runs.

    Without comparisons, the text is no question: it names the cells, the setting and the runs.
    """
    cells = [result.study.cells[number] for number in result.selected]
    first = cells[0].scenario
    varied = result.study.varied
    # The setting is what all cells share: a varied field is not part of it, but of the cells' names.
    robots = (
        "" if "swarm.robots" in varied else f"{first.swarm.robots} robot{'s' * (first.swarm.robots != 1)}"
    )
    floor = "" if "floor.source" in varied else f"floor {first.floor.source}"
    end = "" if "run.t_end_s" in varied else f"up to {first.run.t_end_s:g} s"
    where = ", ".join(words for words in (robots, floor, end) if words)
    names = [cell.name for cell in cells]
    listed = _joined(names, "or") if 1 < len(names) <= MOST_NAMES else title(result)
    runs = sorted({result.runs_of(cell.number) for cell in cells})
    count = f"{runs[0]:,}" if len(runs) == 1 else f"{runs[0]:,} to {runs[-1]:,}"
    setting = f"{where}; {count} runs" if where else f"{count} runs"
    if not compared:
        return f"{listed}: {setting}{' each' * (len(cells) > 1)}, seed {result.study.seed}."
    return (
        f"Which decides sooner, and which is wrong more often: {listed}? {setting[0].upper()}{setting[1:]} each, "
        f"compared run by run."
    )


class Figures(Protocol):
    """A cell with its figures, as ``cell_sentences`` needs them."""

    @property
    def cell(self) -> Cell:
        """The cell."""
        ...

    @property
    def summary(self) -> CellSummary:
        """The cell's figures."""
        ...


def cell_sentences(cells: Sequence[Figures]) -> list[str]:
    """Return the figures of each cell in words: its shares of right, wrong and undecided robots, and its decision time.

    The shares right and wrong are left out if they are undefined, and limits are left out if they are not finite. If no
    answer is right in some runs, a second sentence says on what the swarms agreed.
    """
    sentences = []
    for one in cells:
        figures = one.summary
        shares = (
            ("right", figures.robots_right),
            ("wrong", figures.robots_wrong),
            ("undecided", figures.robots_undecided),
        )
        words = [f"{_percent(share)} {word}" for word, share in shares if not math.isnan(share.estimate)]
        time = figures.decision_time_s
        limits = f" [{time.low:.0f}, {time.high:.0f}]" if math.isfinite(time.low) else ""
        sentences.append(
            f"{one.cell.name}: robots {', '.join(words)}; decision time {time.estimate:.0f} s{limits}."
            + (f" {_agreement(one)}" if lacks_truth(figures) else "")
        )
    return sentences


def lacks_truth(figures: CellSummary) -> bool:
    """Return whether no answer is right in some runs of a cell: then its outcome is on what its swarms agreed."""
    return figures.swarm_right.n < figures.runs


def _agreement(one: Figures) -> str:
    """Write on what the swarms of a cell agreed, in a sentence; whether agreement lasted if opinions may change."""
    figures = one.summary
    less, more = answers_in_words(one.cell.scenario)
    lasted = ""
    if figures.agreement_lasted.n:
        lasted = f"; {_percent(figures.agreement_lasted)} of the agreements lasted to the end"
    return (
        f"Swarms agreed on '{less}' in {_percent(figures.agreed_on_0)} of the runs, on '{more}' in "
        f"{_percent(figures.agreed_on_1)}; {_percent(figures.swarm_split)} split, {_percent(figures.swarm_incomplete)} "
        f"incomplete{lasted}."
    )


def _percent(share: Interval) -> str:
    """Write a share in percent with its limits: ``48.7 % [44.2, 53.1]``; without limits if they are not finite."""
    limits = f" [{100 * share.low:.1f}, {100 * share.high:.1f}]" if math.isfinite(share.low) else ""
    return f"{100 * share.estimate:.1f} %{limits}"
