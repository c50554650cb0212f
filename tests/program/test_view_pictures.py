"""Pictures of a run in three dimensions, without a display: what they show, and what is said where none is drawn."""

from __future__ import annotations

import math
import sys
import webbrowser
from ctypes.util import find_library
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from helpers.commands import refusal_of
from vibroswarm import preset, simulate
from vibroswarm.cli import main
from vibroswarm.errors import InputError
from vibroswarm.result import Result
from vibroswarm.view import picture
from vibroswarm.view.picture import FOV_DEG, HEIGHT, WIDTH, camera_of, write_picture
from vibroswarm.view.scene import ROBOT_HEIGHT_M, STILL, VIBRATING, Playback
from vibroswarm.view.server import Server

QUICK = {"run.t_end_s": 60.0, "floor.source": "diagonal:0.46", "strategy.name": "soft"}


@pytest.fixture(scope="module")
def result() -> Result:
    return simulate(preset("paper").with_values(QUICK), 3, [2], segments=True)


@pytest.fixture(scope="module")
def folder(result: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("pictures") / "run"
    result.write(path)
    return path


OSMESA = find_library("OSMesa")
needs_osmesa = pytest.mark.skipif(OSMESA is None, reason="OSMesa is not installed (Debian: libosmesa6)")


@pytest.fixture(params=["either", pytest.param("osmesa", marks=needs_osmesa)])
def drawn(
    request: pytest.FixtureRequest, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> np.ndarray:  # fmt: skip
    """A picture at 30 s, by EGL or OSMesa, and by OSMesa; skips where what it needs is not there."""
    pytest.importorskip("mujoco")
    path, way = tmp_path / "run.png", request.param
    if way != "either":
        monkeypatch.setenv("MUJOCO_GL", way)
    ended = main(["view", str(folder), "--picture", str(path), "--at", "30"])
    said = capsys.readouterr()
    if ended == 2 and way == "either" and OSMESA is None:
        assert "cannot be drawn here without a display" in said.err
        pytest.skip(said.err)
    assert ended == 0, said.err
    assert ("drawn by" if way == "either" else f"drawn by {way}") in said.out
    return np.asarray(Image.open(path).convert("RGB")).astype(int)


def pixel(result: Result, x_m: float, y_m: float, z_m: float) -> tuple[int, int]:
    """Row and column at which a point is seen."""
    eye, axes = camera_of(result)
    right, up, back = axes @ (np.array([x_m, y_m, z_m]) - eye)
    focal = HEIGHT / 2.0 / math.tan(math.radians(FOV_DEG / 2.0))
    return round(HEIGHT / 2.0 + focal * up / back), round(WIDTH / 2.0 - focal * right / back)


def test_a_picture_shows_floor_and_robots_where_they_are(result: Result, drawn: np.ndarray) -> None:
    assert drawn.shape == (HEIGHT, WIDTH, 3)
    playback = Playback(result, 2)
    tiles, (width_m, height_m, left_m, bottom_m) = playback.floor.tiles, playback.floor.geometry[2:]
    rows, columns = tiles.shape
    right = 0
    for row in range(rows):
        for column in range(columns):
            x_m, y_m = left_m + (column + 0.5) * width_m, bottom_m + (rows - 0.5 - row) * height_m
            colour = drawn[pixel(result, x_m, y_m, 0.0)]
            right += np.abs(colour - np.array(VIBRATING if tiles[row, column] else STILL)).max() < 16
    assert right >= tiles.size - 3  # robots or samples may hide some
    for robot in range(5):
        x_m, y_m, heading_rad = playback.poses(robot, 30.0)[0]
        behind = (
            x_m - 0.008 * math.cos(heading_rad),
            y_m - 0.008 * math.sin(heading_rad),
        )  # the front is dark
        colour = drawn[pixel(result, *behind, ROBOT_HEIGHT_M)]
        assert np.abs(colour - np.array(playback.looks(robot, 30.0)[1])).max() < 25
    elsewhere = [
        drawn[pixel(result, *Playback(result, 2).poses(i, 50.0)[0][:2], ROBOT_HEIGHT_M)] for i in range(5)
    ]
    assert any(np.abs(c - np.array(playback.looks(i, 30.0)[1])).max() > 25 for i, c in enumerate(elsewhere))


def test_where_nothing_can_draw_a_sentence_says_so(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Only a way of drawing that MuJoCo does not know is asked for."""
    pytest.importorskip("mujoco")
    monkeypatch.setenv("MUJOCO_GL", "nowhere")
    words = refusal_of(capsys, "view", str(folder), "--picture", str(tmp_path / "run.png"))
    assert "--picture: cannot be drawn here without a display (nowhere: " in words
    assert "install EGL or OSMesa (Debian: libegl1 or libosmesa6), or use --html" in words
    assert "Traceback" not in words
    assert not list(tmp_path.iterdir())


def test_all_ways_are_tried_and_named(
    result: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("mujoco")
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(picture, "WAYS", ("nowhere", "nothing"))
    with pytest.raises(InputError, match=r"\(nowhere: .*; nothing: .*\)"):
        write_picture(result, 2, tmp_path / "run.png")


@needs_osmesa
def test_where_the_first_way_fails_osmesa_draws(
    result: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("mujoco")
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(picture, "WAYS", ("nowhere", "osmesa"))
    assert write_picture(result, 2, tmp_path / "run.png") == "osmesa"


def test_missing_mujoco_is_named_with_its_extra(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(picture, "find_spec", lambda name: None)
    monkeypatch.setitem(sys.modules, "viser", None)  # which pictures do not need
    words = refusal_of(capsys, "view", str(folder), "--picture", str(tmp_path / "run.png"))
    assert "--picture: needs MuJoCo, which is not installed: pip install 'vibroswarm[physics]'" in words


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--picture", "run.jpg"], "--picture: 'run.jpg' does not end in .png"),
        (["--picture", "run.png", "--html", "run.html"], "--picture: conflicts with --html"),
        (["--picture", "run.png", "--at", "900"], "--at: 900 is not from 0 to 60 s"),
        (["--at", "9"], "--at: needs --picture"),
        (["--picture", "run.png", "--speed", "3"], "--speed: does not apply to --picture"),
        (["--picture", "run.png", "--port", "9000"], "--port: does not apply to --picture"),
        (["--html", "run.html", "--port", "9000"], "--port: does not apply to --html"),
        (["--html", "run.html", "--open"], "--open: does not apply to --html"),
    ],
)
def test_bad_input(
    arguments: list[str], words: str, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    pytest.importorskip("mujoco")
    monkeypatch.chdir(tmp_path)
    assert words in refusal_of(capsys, "view", str(folder), *arguments)
    assert not list(tmp_path.iterdir())


def test_where_no_browser_can_be_opened_the_address_is_left(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("viser")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setattr(webbrowser, "open", lambda url: False)
    monkeypatch.setattr(Server, "serve", lambda self: None)
    assert main(["view", str(folder), "--port", "0", "--open"]) == 0
    printed = capsys.readouterr()
    assert "at http://127.0.0.1:" in printed.out
    assert "no browser can be opened here; open http://127.0.0.1:" in printed.err
