"""``vibroswarm view``: a run in three dimensions, in a browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from vibroswarm.cli.command_line import Option
from vibroswarm.cli.deliver import open_page, print_line, print_saved_file
from vibroswarm.cli.option_values import refuse
from vibroswarm.cli.options import Force
from vibroswarm.cli.terminal import report
from vibroswarm.errors import named


def view(
    folder: Annotated[Path, Option("folder of a result (run --out, lab import)", "DIR")],
    /,
    *,
    run: Annotated[int | None, Option("number of the run (default: the first)")] = None,
    speed: Annotated[
        float | None, Option("simulated seconds a second (default 20.0)", low=1, high=200)
    ] = None,
    port: Annotated[
        int | None, Option("port (default 8080; 0: any free one)", "P", low=0, high=65535)
    ] = None,
    html: Annotated[Path | None, Option("write one file that plays the run back, and end")] = None,
    picture: Annotated[Path | None, Option("write a picture (PNG), by EGL or OSMesa, and end")] = None,
    at: Annotated[float | None, Option("time of the picture, s (default: the end)", "T")] = None,
    force: Force = False,
    open: Annotated[bool, Option("open a browser")] = False,
) -> None:
    """Show a run of any source of motion in three dimensions: robots with their beliefs, floor and samples.

    Orbit, pause and scrub. Only this machine can reach the server, which Ctrl-C ends. Needs the extra 'view'; pictures
    need 'physics'.

    examples:
      vibroswarm view first
      vibroswarm view first --html first.html
      vibroswarm view first --picture first.png --at 300
    """
    from vibroswarm.core import numbers
    from vibroswarm.recordings.recording import read_result
    from vibroswarm.view.server import Server, viser, write_html

    file_option = "--picture" if picture is not None else "--html" if html is not None else None
    not_of_file = {"port": port is not None, "open": open, "speed": speed is not None and picture is not None}
    for option, is_given in not_of_file.items():
        refuse(is_given and file_option, f"--{option}", f"does not apply to {file_option}")
    speed = 20.0 if speed is None else speed
    refuse(html and picture, "--picture", "conflicts with --html; use one of them")
    refuse(at is not None and picture is None, "--at", "needs --picture")
    _check_file("--html", html, ".html", force)
    _check_file("--picture", picture, ".png", force)
    if picture is None:
        viser()  # raises an error before any work if this package is missing; only pictures do not need it
    report(f"reading {folder} and preparing its scene ...")
    result = read_result(folder)
    number = int(result.runs["run"][0]) if run is None else run
    if picture is not None:
        from vibroswarm.view.picture import write_picture

        with named("--picture", of="--out"):
            way = write_picture(result, number, picture, time_s=at)
        print_saved_file(picture, f"drawn by {way}")
        return
    if html is not None:
        with named("--html", of="--out"):
            frames = write_html(result, number, html, speed=speed)
        print_saved_file(
            html, f"{numbers.count(frames, 'frame')}, {numbers.number(html.stat().st_size / 1e6, 1)} MB"
        )
        return
    server = Server(result, number, port=8080 if port is None else port, speed=speed)
    print_line(f"Run {number} at {server.url} (Ctrl-C ends it)")
    if open:
        open_page(server.url)
    try:
        server.serve()
    finally:
        server.stop()


def _check_file(option: str, file: Path | None, suffix: str, force: bool) -> None:
    """Refuse the file of an option, if it is given, before the work."""
    if file is None:
        return
    refuse(file.suffix != suffix, option, f"'{file}' does not end in {suffix}")
    refuse(file.is_dir(), option, f"'{file}' is a folder; give the name of a file")
    refuse(file.exists() and not force, str(file), "exists; add --force to replace it")
