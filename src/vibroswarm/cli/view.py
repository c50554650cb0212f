"""``vibroswarm view``: a run in three dimensions, in a browser."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from vibroswarm.cli.options import between, read_result, real, whole

EPILOG = """\
examples:
  vibroswarm view first
  vibroswarm view first --html first.html
  vibroswarm view first --picture first.png --at 300
"""


def add_parser(commands: Any) -> None:
    """Add the command ``view`` and its options to the program's commands."""
    parser = commands.add_parser(
        "view",
        help="show a run in three dimensions, in a browser on this machine",
        description="Show a run of any source of motion in three dimensions: robots with their beliefs, floor and "
        "samples; orbit, pause and scrub. Only this machine can reach the server. Needs the extra 'view'; pictures "
        "need 'physics'.",
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
        "--port",
        metavar="P",
        type=between(whole, 0, 65535),
        default=8080,
        help="port (default 8080; 0: any free one)",
    )
    parser.add_argument(
        "--html", metavar="FILE", type=Path, help="write one file that plays the run back, and end"
    )
    parser.add_argument(
        "--picture", metavar="FILE", type=Path, help="write a picture (PNG), by EGL or OSMesa, and end"
    )
    parser.add_argument("--at", metavar="T", type=real, help="time of the picture, s (default: the end)")
    parser.add_argument("--force", action="store_true", help="replace FILE")
    parser.add_argument("--open", action="store_true", help="open a browser")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Serve a run to the browser until Ctrl-C; with ``--html`` or ``--picture``, write that file instead.

    Returns the exit code.
    """
    from vibroswarm.errors import InputError
    from vibroswarm.view.server import Server, viser, write_html

    if not 1.0 <= arguments.speed <= 200.0:  # the range of the slider on the page; --html has the same limits
        raise InputError(f"{arguments.speed:g} is not from 1 to 200", field="--speed")
    if arguments.html is not None and arguments.picture is not None:
        raise InputError("conflicts with --html; use one of them", field="--picture")
    if arguments.at is not None and arguments.picture is None:
        raise InputError("needs --picture", field="--at")
    for option, suffix in (("html", ".html"), ("picture", ".png")):
        file = getattr(arguments, option)
        if file is None:
            continue
        if file.suffix != suffix:
            raise InputError(f"'{file}' does not end in {suffix}", field=f"--{option}")
        if file.is_dir() or (file.exists() and not arguments.force):
            raise InputError("exists; add --force to replace it", field=str(file))
    if arguments.picture is None:
        viser()  # raises an error before any work if this package is missing; only pictures do not need it
    result = read_result(arguments.folder)
    number = int(result.runs["run"][0]) if arguments.number is None else arguments.number
    if arguments.picture is not None:
        from vibroswarm.view.picture import write_picture

        way = write_picture(result, number, arguments.picture, time_s=arguments.at)
        print(f"Saved: {arguments.picture} (drawn by {way})")
        return 0
    if arguments.html is not None:
        frames = write_html(result, number, arguments.html, speed=arguments.speed)
        print(f"Saved: {arguments.html} ({frames} frames, {arguments.html.stat().st_size / 1e6:.1f} MB)")
        return 0
    server = Server(result, number, port=arguments.port, speed=arguments.speed)
    print(f"Run {number} at {server.url} (Ctrl-C ends it)", flush=True)
    if arguments.open:
        import webbrowser

        if not webbrowser.open(server.url):
            print("No browser could be opened here; open that address in one.", flush=True)
    try:
        server.serve()
    finally:
        server.stop()
    return 0
