"""The folder of one run: its tables, its page, its maps and pictures."""

from __future__ import annotations

from pathlib import Path

from vibroswarm.analysis.floor_maps import floor_maps, keeps_floor_map
from vibroswarm.analysis.reports_over_time import reports_over_time
from vibroswarm.core.atomic_io import whole_folder
from vibroswarm.result import Result
from vibroswarm.run_page.write import why_no_page, write_run_page
from vibroswarm.study.summary import write_table


def write_run_folder(result: Result, out: Path, *, pictures: bool) -> None:
    """Write a result with its page and maps, and with ``pictures`` their pictures, into the folder ``out``.

    The folder is written completely or not at all; an older result in it is replaced. The page is written only if it
    can show the result (``why_no_page``), and maps only if the robots' strategy keeps a map of the floor.
    """

    with whole_folder(out, replace=True) as part:
        result.write_into(part)
        if why_no_page(result) is None:
            write_run_page(result, part / "run.html")
        maps = floor_maps(result) if keeps_floor_map(result.scenario) else None
        if maps is not None:
            write_table(maps, part / "maps")
        if pictures:
            # here, since a run without pictures need not wait for matplotlib
            from vibroswarm.plots.picture import save_figure
            from vibroswarm.plots.reports import draw_run_reports
            from vibroswarm.plots.run import maps_figure, write_run_picture

            write_run_picture(result, part / "run.png")
            if reports_over_time(result).height:
                save_figure(lambda: draw_run_reports(result, style="page").figure, part / "reports.png")
            if maps is not None:
                save_figure(lambda: maps_figure(maps), part / "maps.png")
