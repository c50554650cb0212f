"""The HTML that a notebook shows: the document of an object, and the player of a run or a whole report."""

from __future__ import annotations

from typing import Final

from vibroswarm.documents import document_of
from vibroswarm.documents.run import run_document
from vibroswarm.result import Result
from vibroswarm.run_page.write import page_html, record_of, why_no_page
from vibroswarm.show.markup import escape
from vibroswarm.show.page import fragment_html

PLAYER_PX: Final = 760
"""Height of the frame with a run's page."""


def html_of(value: object) -> str:
    """Return what a notebook shows of an object that has a document."""
    html = fragment_html(document_of(value))
    return html + _first_run(value) if isinstance(value, Result) and value.runs.height else html


def _first_run(result: Result) -> str:
    """Return the player of the first run of a result, and of several runs the first one's document before it."""
    run = int(result.runs["run"][0])
    before = fragment_html(run_document(result, run)) if result.runs.height > 1 else ""
    why_not = why_no_page(result)
    if why_not is not None:
        return before + f"<p>No player: {escape(why_not)}.</p>"
    return before + _frame(page_html(record_of(result, run)), f"Replay of run {run}", PLAYER_PX)


def _frame(page: str, title: str, height_px: int) -> str:
    """Return a frame with a whole page; it is sandboxed, so that its scripts cannot reach the notebook."""
    return (
        f'<iframe title="{escape(title)}" sandbox="allow-scripts allow-downloads" loading="lazy" '
        f'style="width: 100%; height: {height_px}px; border: 0" srcdoc="{escape(page)}"></iframe>'
    )
