"""Print the tables of a league: standings, calibration of beliefs, fronts of time and error, and curves of faults."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import polars as pl

    from vibroswarm.league.standings import Standings


def print_standings(standings: Standings, tables: dict[str, pl.DataFrame]) -> None:
    """Print the answer in sentences, the standings, and the differences, beliefs, faults and fronts if there are any.

    The tables "floors" and "floor_differences", which have rows for each floor, are not printed.

    Args:
        standings: the finished league.
        tables: the tables that ``league._tables_of`` returns; "beliefs" and "faults" may be missing.
    """
    from vibroswarm.cli.output import print_line, print_paragraph, print_table
    from vibroswarm.league.report import answers

    league, table = standings.league, tables["standings"]
    for sentence in (*standings.notes, *answers(table, tables)):
        print_paragraph(sentence)
    print_line()
    print_table(
        [
            "strategy",
            "forced error, %",
            "right, %",
            "wrong, %",
            "undecided, %",
            "decision time, s",
            "worst floor, %",
            "messages",
            "bytes",
        ],
        [
            [
                row["name"],
                values_text(row, "forced_error", scale=100, form=".1f"),
                *(f"{100 * row[name]:.1f}" for name in ("right", "wrong", "undecided")),
                values_text(row, "decision_time_s", scale=1, form=".0f"),
                # None with one run of one swarm size: the runs that measure the worst floor did not choose it
                "-" if row["worst_floor_error"] is None else f"{100 * row['worst_floor_error']:.1f}",
                f"{row['sent']:.0f}",
                f"{row['bytes_sent']:.0f}",
            ]
            for row in table.iter_rows(named=True)
        ],
        more=("right, %", "worst floor, %", "messages", "bytes"),  # printed with --wide only
    )
    if tables["differences"].height:
        print_line()
        differences = tables["differences"]
        print_paragraph(f"Difference from {differences['reference'][0]}; p by Holm over the entries")
        rows = [_difference(row) for row in differences.iter_rows(named=True)]
        columns = ["strategy", "figure", "difference", "p"]
        print_table(columns, rows, names=2)  # strategy and figure name a row
    if "beliefs" in tables and tables["beliefs"].height:
        print_beliefs(tables["beliefs"])
    if "faults" in tables and tables["faults"].height:
        print_faults(tables["faults"])
    # A front of a single entry adds nothing to the entry's row in the standings.
    if (tables["fronts"]["points"] > 1).any():
        print_fronts(tables["fronts"])
    print_line()
    untuned = [entry.label for entry in league.entries if not entry.tuned]
    if untuned:
        print_paragraph(f"Not tuned for a league ('vibroswarm tune'): {', '.join(untuned)}")
    sizes = ", ".join(map(str, league.robots))
    print_paragraph(
        f"Averages over {len(league.floors)} floors and swarms of {sizes}; {league.runs} runs of each, 95 % intervals "
        "over motions. Forced error: wrong, or undecided and leaning to the wrong side at the end. The worst floor is "
        "chosen by other motions than those that measure it. Messages and bytes: per robot and run."
    )


def print_beliefs(beliefs: pl.DataFrame) -> None:
    """Print the confidence of robots when they decided, how often these decisions were right, and how many decided.

    These are averages over floors, in which each floor is weighted by the prior probability of its number of vibrating
    tiles. The column "floors" names that prior: the strategy's own, or the one of tiles that vibrate independently. The
    column "settings" names the settings of decisions: the entry's own, or a threshold of 95 % and no least number of
    observations.

    Args:
        beliefs: result of ``belief_calibration``.
    """
    from vibroswarm.cli.output import print_line, print_paragraph, print_table

    print_line()
    print_paragraph("Robots that decided: their confidence, and how often they were right")
    print_table(
        ["strategy", "settings", "floors", "confidence, %", "right, %", "decided, %"],
        [
            [
                row["name"],
                row["settings"],
                row["prior"],
                values_text(row, "confidence", scale=100, form=".1f"),
                values_text(row, "right", scale=100, form=".1f"),
                f"{100 * row['decided']:.0f}",
            ]
            for row in beliefs.iter_rows(named=True)
        ],
        names=3,  # strategy, settings and weighting of floors name a row
    )


def print_fronts(fronts: pl.DataFrame) -> None:
    """Print, for each strategy, its time at the error of the reference, and its error at the time of the reference.

    Both values are read off the strategy's front. The front joins the strategy's best entries: those that none of its
    other entries beats in both time and error. The reference is the entry with which all others are compared.
    """
    from vibroswarm.cli.output import print_line, print_table

    print_line()
    print_line("At equal error, and at equal time")
    print_table(
        ["strategy", "entries on front", "time at its error, s", "error at its time, %"],
        [
            [
                row["strategy"],
                row["points"],
                values_text(row, "time_at_equal_error_s", scale=1, form=".0f"),
                values_text(row, "error_at_equal_time", scale=100, form=".1f"),
            ]
            for row in fronts.iter_rows(named=True)
        ],
    )


def print_faults(curves: pl.DataFrame) -> None:
    """Print, for each kind of fault, how many faulty robots each entry tolerates.

    That number is followed by the forced errors (%) of the working robots, with 0, 1, 2, ... faulty robots. A dash
    stands for a kind of fault that does not exist for the entry's strategy: "opposite" if messages have no opposite.

    Args:
        curves: result of ``fault_curves``: one row for each entry, kind of fault and number of faulty robots. Within an
            entry and kind, that number rises from row to row.
    """
    from vibroswarm.cli.output import print_line, print_paragraph, print_table
    from vibroswarm.league.fault_curves import MARGIN, borne

    kinds = curves["kind"].unique(maintain_order=True).to_list()
    errors = {
        (row["name"], row["kind"], row["faulty"]): f"{100 * row['forced_error']:.1f}"
        for row in curves.iter_rows(named=True)
    }
    tolerated = {(row["name"], row["kind"]): row["borne"] for row in borne(curves).iter_rows(named=True)}
    print_line()
    print_paragraph(
        "Faulty robots that a strategy tolerates, and the forced error (%) of the others with 0, 1, ... of them"
    )
    rows = []
    for name in curves["name"].unique(maintain_order=True):
        row = [name]
        for kind in kinds:
            # in order of the number of faulty robots, as the rows of `curves` are
            by_faulty = [text for (entry, fault, _), text in errors.items() if (entry, fault) == (name, kind)]
            row.append(f"{tolerated[name, kind]}: {', '.join(by_faulty)}" if by_faulty else "-")
        rows.append(row)
    print_table(["strategy", *(kind.replace("_", " ") for kind in kinds)], rows)
    print_paragraph(
        f"Tolerated: the 95 % interval of the rise lies below {100 * MARGIN:.0f} points, for that number and all below."
    )


def _difference(row: dict[str, Any]) -> list[str]:
    """Return the printed cells of a row of differences: strategy, figure, difference with limits, and p.

    The figure is the decision time or the forced error: ``Standings.differences`` compares no others.
    """
    is_time = row["figure"] == "decision_time_s"
    scale, form, unit = (1, "+.0f", " s") if is_time else (100, "+.1f", " points")
    name = "decision time" if is_time else "forced error"
    p = "-" if row["p_holm"] is None else "<0.001" if row["p_holm"] < 0.001 else f"{row['p_holm']:.3f}"
    return [row["name"], name, values_text(row, "difference", scale, form, unit), p]


def values_text(row: dict[str, Any], name: str, scale: float, form: str, unit: str = "") -> str:
    """Format a figure of a row with its limits, such as ``44.1 % [41.0, 47.2]``; without limits that are missing.

    If the figure itself is missing, the result is "not reached": for example, a front may have no point with the error
    of the reference.

    Args:
        name: column of the figure. The columns of its limits have the same name with ``_low`` and ``_high`` added.
        scale: factor by which each number is multiplied.
        form: format specification of each number, such as ``.1f``.
        unit: text that follows the figure, such as " %".
    """
    # A value x is missing if it is None, or if it is NaN: then x != x.
    values = [row[name + end] for end in ("", "_low", "_high")]
    if values[0] is None or values[0] != values[0]:
        return "not reached"
    estimate = f"{scale * values[0]:{form}}{unit}"
    if any(one is None or one != one for one in values[1:]):
        return estimate
    return f"{estimate} [{scale * values[1]:{form}}, {scale * values[2]:{form}}]"
