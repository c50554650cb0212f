"""``vibroswarm view``: a run in three dimensions, in a browser."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from vibroswarm.cli.options import read_result, real, whole

EPILOG = """\
examples:
  vibroswarm view first
  vibroswarm view first --html first.html
"""


def add_parser(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "view",
        help="show a run in three dimensions, in a browser on this machine",
        description="Show a run of any source of motion in three dimensions: robots with their beliefs, floor and "
        "samples; orbit, pause and scrub. Only this machine can reach the server. Needs the extra 'view'.",
        epilog=EPILOG,
    )
    parser.add_argument("folder", metavar="DIR", type=Path, help="folder of a result (run --out, lab import)")
    parser.add_argument(
        "--run", metavar="N", type=whole, dest="number", help="number of the run (default: the first)"
    )
    parser.add_argument(
        "--speed", metavar="X", type=real, default=20.0, help="simulated seconds a second (default 20)"
    )
    parser.add_argument(
        "--port", metavar="P", type=whole, default=8080, help="port (default 8080; 0: any free one)"
    )
    parser.add_argument(
        "--html", metavar="FILE", type=Path, help="write one file that plays the run back, and end"
    )
    parser.add_argument("--force", action="store_true", help="replace FILE")
    parser.add_argument("--open", action="store_true", help="open a browser")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Serve a run until Ctrl-C, or write its file."""
    from vibroswarm.errors import InputError
    from vibroswarm.view.server import Server, viser, write_html

    if not 1.0 <= arguments.speed <= 200.0:
        raise InputError(f"{arguments.speed:g} is not from 1 to 200", field="--speed")
    if arguments.html is not None:
        if arguments.html.suffix != ".html":
            raise InputError(f"'{arguments.html}' does not end in .html", field="--html")
        if arguments.html.is_dir() or (arguments.html.exists() and not arguments.force):
            raise InputError("exists; add --force to replace it", field=str(arguments.html))
    viser()
    result = read_result(arguments.folder)
    number = int(result.runs["run"][0]) if arguments.number is None else arguments.number
    if arguments.html is not None:
        frames = write_html(result, number, arguments.html, arguments.speed)
        print(f"Saved: {arguments.html} ({frames} frames, {arguments.html.stat().st_size / 1e6:.1f} MB)")
        return 0
    server = Server(result, number, arguments.port, arguments.speed)
    print(f"Run {number} at {server.url} (Ctrl-C ends it)", flush=True)
    if arguments.open:
        import webbrowser

        webbrowser.open(server.url)
    try:
        server.serve()
    finally:
        server.stop()
    return 0
