"""The HTML that a notebook shows: the report of an object, and the player of a run."""

from __future__ import annotations

from typing import Final

from markupsafe import escape

from vibroswarm.report.page import page
from vibroswarm.report.report import report
from vibroswarm.result import Result

PLAYER_PX: Final = 760
"""Height of the frame with a run's page."""


def html_of(value: object) -> str:
    """Return what a notebook shows of an object that has a report, and of a result the player of its first run."""
    html = page(report(value), whole=False)
    return html + _player(value) if isinstance(value, Result) and value.poses is not None else html


def _player(result: Result) -> str:
    """Return a frame with the page of a run; it is sandboxed, so that its scripts cannot reach the notebook."""
    from vibroswarm.run_page.payload import payload
    from vibroswarm.run_page.write import page_html

    content = page_html(payload(result, int(result.runs["run"][0])))
    style = f"width: 100%; height: {PLAYER_PX}px; border: 0"
    sandbox = "allow-scripts allow-downloads"
    return f'<iframe sandbox="{sandbox}" loading="lazy" style="{style}" srcdoc="{escape(content)}"></iframe>'
