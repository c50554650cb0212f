"""The two pictures of a search: its scores, and the fields of its candidates, over the iterations."""

from __future__ import annotations

from typing import Any

import polars as pl

from vibroswarm.core.numbers import count, number
from vibroswarm.errors import InputError
from vibroswarm.plots.error_bars import series_handle
from vibroswarm.plots.inputs import check_once, tidy, with_series
from vibroswarm.plots.labels import label_of
from vibroswarm.plots.layout import legend_below, plain_axes, whole_ticks
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import FAINT, SERIES, Style, look, style_named


@drawn
def draw_search(
    frame: pl.DataFrame,
    personal: pl.DataFrame | None = None,
    *,
    label: str = "cost",
    true: float | None = None,
    title: str = "",
    style: str = "column",
) -> Picture:
    """Draw scores over the iterations: the best so far, the mean of the candidates, and the best of each particle.

    Scores are costs: lower is better.

    Args:
        frame: one row per iteration with the columns ``iteration``, ``best`` (so far, as the search believes) and
            ``mean`` (of the iteration's candidates); null: no score. The axis begins at 0 unless a score, of any of the
            arguments, lies below.
        personal: of a particle swarm, one row per iteration and particle with the columns ``iteration``, ``particle``
            and ``score`` (the best of the particle so far); None: not drawn.
        label: of the score, with its unit.
        true: score of the winner (the candidate that the search chose) on runs that the search did not use, drawn as a
            level line; None: no line.
        title: above the picture.
        style: "column", "page" or "slide".

    Returns:
        Picture; its numbers are ``iteration, best, mean``, without those of ``personal`` and ``true``.

    Raises:
        InputError: a frame is not as described.
    """
    sizes = style_named(style)
    frame = tidy(
        frame, numbers=("iteration", "best", "mean"), complete=("iteration",), once=("iteration",)
    ).sort("iteration")
    names = ["best as the search believes", "mean of the candidates"]
    names += ["best of each particle"] if personal is not None else []
    names += ["true, on fresh runs"] if true is not None else []
    figure, axes = plain_axes(sizes, "iteration", label, title=title)
    handles = [] if personal is None else [_particles(axes, personal, sizes)]
    best, mean = look(0), look(1)
    (of_mean,) = axes.plot(
        frame["iteration"], frame["mean"], color=mean.colour, linestyle=mean.line, linewidth=sizes.line_pt
    )
    (of_best,) = axes.plot(
        frame["iteration"], frame["best"], color=best.colour, linestyle=best.line,
        linewidth=sizes.line_pt * 1.5, zorder=3,
    )  # fmt: skip
    handles = [of_best, of_mean, *handles]
    if true is not None:  # in a colour and a line that no other curve has
        handles.append(axes.axhline(true, color=SERIES[4], linestyle=look(2).line, linewidth=sizes.line_pt))
    if not axes.dataLim.y0 < 0:  # y0: the lowest score that is drawn; +inf if there is none
        axes.set_ylim(bottom=0)
    _iterations(axes, frame)
    legend_below(figure, sizes, handles, names)  # handles and names have the same order
    caption = f"{label} over {count(frame.height, 'iteration')}: the best so far and the mean of the candidates tried."
    if true is not None:
        caption += (
            f" On fresh runs the winner's is {number(true, digits=4)}; below it: selection bias or chance."
        )
    return Picture(figure, frame.select("iteration", "best", "mean"), caption)


def _particles(axes: Any, personal: pl.DataFrame, sizes: Style) -> Any:
    """Draw the best score of each particle; return one of the lines, since all look the same in the legend."""
    own = tidy(personal, numbers=("iteration", "particle", "score"), complete=("iteration", "particle"))
    lines = [
        axes.plot(
            part["iteration"],
            part["score"],
            color=FAINT,
            alpha=0.5,
            linewidth=sizes.line_pt * 0.5,
            zorder=2,
        )
        for _, part in own.sort("iteration").group_by("particle", maintain_order=True)
    ]
    return lines[-1][0]


@drawn
def draw_parameters(
    frame: pl.DataFrame,
    *,
    title: str = "",
    style: str = "column",
) -> Picture:
    """Draw the mean of each field over the candidates of an iteration, as a fraction of the field's range.

    Args:
        frame: one row per iteration and field with the columns ``iteration``, ``share`` (the mean: 0 at the field's
            lower bound, 1 at the upper) and, for several fields, ``series`` (the name of the field,
            which is labelled with its words, symbol and unit unless two fields would have the same label).
        title: above the picture.
        style: "column", "page" or "slide".

    Returns:
        Picture; its numbers are ``iteration, series, share``; ``series`` is empty if the frame does not have it.

    Raises:
        InputError: the frame is not as described, a share lies outside [0, 1], or there are more than ``SERIES_UP_TO``
            fields.
    """
    sizes = style_named(style)
    frame = tidy(frame, numbers=("iteration", "share"), complete=("iteration", "share"))
    frame, series = with_series(frame)
    labels = {name: label_of(name).text for name in series if "." in name}
    once = {name: text for name, text in labels.items() if list(labels.values()).count(text) == 1}
    frame = frame.with_columns(pl.col("series").replace(once))
    series = [once.get(name, name) for name in series]
    check_once(frame, ["iteration", "series"])
    if not frame["share"].is_between(-1e-9, 1 + 1e-9).all():  # 1e-9: for rounding
        raise InputError("lies outside 0 to 1; give shares of the bounds", field="share")
    figure, axes = plain_axes(sizes, "iteration", "mean, share of its bounds", title=title)
    for index, name in enumerate(series):
        part = frame.filter(series=name).sort("iteration")
        line = series_handle(sizes, look(index))
        line.set_data(part["iteration"], part["share"])
        line.set_markevery(max(part.height // 8, 1))  # about eight marks per curve
        axes.add_line(line)
    axes.autoscale_view()
    axes.set_ylim(-0.02, 1.02)
    _iterations(axes, frame)
    if any(series):
        legend_below(figure, sizes, [series_handle(sizes, look(k)) for k in range(len(series))], series)
    caption = "Mean of each field over the candidates of an iteration: 0 is its lower bound, 1 its upper."
    return Picture(figure, frame.select("iteration", "series", "share"), caption)


def _iterations(axes: Any, frame: pl.DataFrame) -> None:
    """Set the axis of iterations, which are whole numbers; of a single one, lines are marks."""
    whole_ticks(axes.xaxis)
    if frame["iteration"].n_unique() == 1:
        axes.set_xlim(frame["iteration"][0] - 1.0, frame["iteration"][0] + 1.0)
        for line in axes.lines:
            if len(line.get_xdata()) == 1 and line.get_marker() == "None":
                line.set_marker("o")
