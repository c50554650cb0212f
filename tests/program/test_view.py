"""``vibroswarm view`` shows what the tables say; its page works in a browser, and is for this machine only."""

from __future__ import annotations

import io
import math
import socket
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from PIL import Image

from helpers.browser import launched
from helpers.commands import refusal_of
from vibroswarm import preset, simulate
from vibroswarm.cli import main
from vibroswarm.errors import InputError
from vibroswarm.motion.pose import pose
from vibroswarm.result import Result
from vibroswarm.view.picture import scene_xml
from vibroswarm.view.scene import (
    LESS,
    MORE,
    STILL,
    UNSURE,
    VIBRATING,
    Playback,
    colour_of,
    floor_picture,
    kind_colours,
    robot_parts,
    words_of,
)
from vibroswarm.view.server import HOST, Server, free_port, legend, write_html

QUICK = {
    "run.t_end_s": 40.0,
    "decision.min_observations": 3,
    "decision.credible_threshold": 0.6,
    "floor.source": "diagonal:0.46",
}


@pytest.fixture(scope="module")
def result() -> Result:
    """A run in which robots decide."""
    return simulate(preset("paper").with_values(QUICK), 3, [2], segments=True)


@pytest.fixture(scope="module")
def folder(result: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("view") / "run"
    result.write(path)
    return path


def test_it_shows_what_the_tables_say(result: Result) -> None:
    """Poses, beliefs, decisions and samples at random times, by plain loops over rows."""
    playback = Playback(result, 2)
    rows = result.motion.join(result.inference, on=["run", "robot", "sample"]).to_dicts()
    decided = 0
    for time_s in np.random.default_rng(5).uniform(0.0, 40.0, 60).tolist():
        past = [row for row in rows if row["time_s"] <= time_s]
        assert playback.samples_by(time_s) == len(past)
        for robot in range(5):
            assert np.array_equal(playback.poses(robot, time_s)[0], pose(result.segments, 2, robot, time_s))  # type: ignore[arg-type]
            own = [row for row in past if row["robot"] == robot]
            expected = (own[-1]["belief_below"], own[-1]["decision"]) if own else (0.5, -1)
            assert playback.belief(robot, time_s) == expected
            decided += expected[1] >= 0
    assert decided > 20


def test_without_segments_robots_go_straight_between_samples(result: Result) -> None:
    playback = Playback(Result(**{**vars(result), "segments": None}), 2)
    assert not playback.is_exact
    own = result.motion.filter(pl.col("robot") == 1)
    times = own["time_s"].to_numpy()
    assert np.allclose(playback.poses(1, times)[:, :2], own.select("x_m", "y_m").to_numpy())
    middle = playback.poses(1, (times[0] + times[1]) / 2)[0]
    assert middle[0] == pytest.approx((own["x_m"][0] + own["x_m"][1]) / 2)
    assert (
        math.cos(middle[2]) * (own["x_m"][1] - own["x_m"][0])
        + math.sin(middle[2]) * (own["y_m"][1] - own["y_m"][0])
        > 0
    )


def test_the_picture_of_the_floor_lies_as_the_floor(result: Result) -> None:
    """Each sample's tile, by the table, has the colour of its kind at the sample's place."""
    playback = Playback(result, 2)
    picture, tiles = floor_picture(playback, 0.0), playback.floor.tiles
    joined = result.motion.join(result.observations, on=["run", "robot", "sample"]).filter(
        pl.col("tile") >= 0
    )
    kinds = set()
    for x_m, y_m, tile in joined.select("x_m", "y_m", "tile").rows():
        pixel = picture[int((1.0 - y_m) * picture.shape[0]), int(x_m * picture.shape[1])]
        kind = int(tiles.flat[tile])
        assert tuple(pixel) == (VIBRATING if kind else STILL)
        kinds.add(kind)
    assert kinds == {0, 1}


def test_the_floor_is_drawn_as_it_is_at_the_time() -> None:
    changing = preset("paper").with_values({**QUICK, "change.at_s": [10.0, 20.0], "change.to": "invert"})
    server = Server(simulate(changing, 3, [0]), 0)
    try:
        server.playing.value = False
        shown = []
        for time_s in (0.0, 10.0, 19.0, 20.0, 5.0):
            server.time.value = time_s
            server.step(0.0)
            shown.append(server.scene.floor_image.image.copy())
        still, inverted = shown[0], shown[1]
        assert not np.array_equal(still, inverted)
        assert [np.array_equal(one, inverted) for one in shown] == [False, True, True, False, False]
        assert np.array_equal(shown[3], still)
        assert np.array_equal(shown[4], still)
    finally:
        server.stop()


def test_robots_on_wheels_are_drawn_as_mujoco_has_them(result: Result) -> None:
    body, front, *wheels = robot_parts(replace(result, source="mujoco"))
    assert (body.kind, body.size_m) == ("box", (0.033, 0.025, 0.033))
    assert body.at_m[2] + body.size_m[2] / 2 == pytest.approx(0.035)
    assert front.at_m[0] > 0.0
    assert len(wheels) == 4
    for part in wheels:
        assert part.at_m[2] - part.size_m[2] / 2 == pytest.approx(0.0)
        assert abs(part.at_m[0]) + part.size_m[0] / 2 < 0.0165
        assert abs(part.at_m[1]) + part.size_m[1] / 2 <= 0.0125 + 1e-12
    assert [part.kind for part in robot_parts(result)] == ["cylinder", "box"]


def test_colours_and_words_of_beliefs() -> None:
    assert [colour_of(belief) for belief in (0.0, 0.5, 1.0)] == [MORE, UNSURE, LESS]
    answers = "less", "more"
    assert words_of(0.634, -1, answers) == "p 0.63"
    assert words_of(0.99, 0, answers) == "p 0.99 decided less"
    assert words_of(0.01, 1, answers) == "p 0.01 decided more"


@pytest.mark.parametrize(("strategy", "told"), [("none", "its belief p"), ("dmvd", "its decision (blue")])
def test_only_beliefs_that_robots_have_are_explained(strategy: str, told: str) -> None:
    run = simulate(preset("paper").with_values({"strategy.name": strategy, "run.t_end_s": 20.0}), 3, [0])
    assert f"Over each robot: {told}" in legend(Playback(run, 0))


def test_each_of_three_kinds_has_its_colours_and_decisions_their_words() -> None:
    three: dict[str, Any] = {
        "sensor.model": "confusion", "strategy.name": "dirichlet", "task.name": "majority",
        "floor.source": "random:0.16,0.16,0.68", "decision.min_observations": 20, "run.t_end_s": 120.0,
    }  # fmt: skip
    playback = Playback(simulate(preset("paper").with_values(three), 3, [0], segments=True), 0)
    shown = np.unique(floor_picture(playback, 0.0).reshape(-1, 3), axis=0)
    lines = {kind_colours(2)[1]}
    assert {tuple(colour) for colour in shown.tolist()} == lines | {
        kind_colours(kind)[0] for kind in range(3)
    }
    assert playback.looks(0, 0.0) == ("", UNSURE)
    assert playback.looks(0, 120.0) == ("decided kind 2 is most common", kind_colours(2)[1])
    points = scene_xml(playback, 120.0).split("<geom")
    shapes = ('"cylinder" size="0.004 0.0005"', 'euler="0 0 45"', '"box" size="0.0033 0.0033 0.0005"')
    for kind, shape in enumerate(shapes):  # discs, diamonds and squares that are 1 mm high
        rgba = " ".join(f"{part / 255.0:.6g}" for part in kind_colours(kind)[1])
        drawn = [one for one in points if rgba in one and "0.0005" in one]
        assert len(drawn) == (playback.readings == kind).sum() > 0
        assert all(shape in one for one in drawn)


def test_each_of_sixteen_kinds_has_tiles_and_samples_of_its_own_look() -> None:
    """Tiles differ by colour and lines, samples by colour and shape."""
    three = {"sensor.model": "confusion", "strategy.name": "dirichlet", "task.name": "majority"}
    made = preset("paper").with_values({**three, "floor.source": "random:0.4,0.36,0.24", "run.t_end_s": 60.0})
    playback = Playback(simulate(made, 3, [0]), 0)
    tiles, samples = set(), set()
    for kind in range(16):
        playback.readings = np.full_like(playback.readings, kind)
        samples.add(scene_xml(playback, 60.0))
        playback.floor = replace(playback.floor, tiles=np.full_like(playback.floor.tiles, kind))
        tiles.add(floor_picture(playback, 0.0).tobytes())
        assert kind < 2 or kind_colours(kind) not in map(kind_colours, (0, 1))
    assert len(tiles) == len(samples) == 16


def test_values_are_drawn_between_still_and_vibrating() -> None:
    mean = {"floor.source": "gradient:0..1", "decision.boundary_of": "tiles", "task.name": "mean"}
    hill = preset("paper").with_values({**mean, "run.t_end_s": 20.0})
    picture = floor_picture(Playback(simulate(hill, 3, [0]), 0), 0.0)
    assert len(np.unique(picture[..., 0])) > 4
    assert VIBRATING[0] <= picture[..., 0].min() < picture[..., 0].max() <= STILL[0]


def test_the_server_is_for_this_machine_only_and_prints_nothing(
    result: Result, capsys: pytest.CaptureFixture[str]
) -> None:
    server = Server(result, 2)
    try:
        port = server.server.get_port()
        assert server.url == f"http://127.0.0.1:{port}"
        for step in (0.5, 1.0):
            server.step(step)
        assert server.time.value == pytest.approx(30.0)
        assert sum(server.scene.shown.values()) == server.playback.samples_by(30.0)
        clouds = [cloud for chunk in server.scene.clouds.values() for cloud in chunk]
        assert sum(len(cloud.points) for cloud in clouds) == server.playback.samples_by(30.0)
        assert {cloud.point_shape for cloud in clouds} == {"circle", "diamond"}
        for robot, frame in enumerate(server.scene.frames):
            x_m, y_m, heading_rad = server.playback.poses(robot, 30.0)[0]
            w, x, y, z = frame.wxyz
            # Turned by the quaternion, the robot's x axis has the direction of the heading.
            ahead = (w * w + x * x - y * y - z * z, 2 * (x * y + w * z), 2 * (x * z - w * y))
            assert ahead == pytest.approx((math.cos(heading_rad), math.sin(heading_rad), 0.0))
            assert tuple(frame.position) == pytest.approx((x_m, y_m, 0.0))
        server.playing.value, server.time.value = False, 10.0  # scrubbed back
        server.step(1.0)
        assert sum(server.scene.shown.values()) == server.playback.samples_by(10.0)
        addresses = {
            str(info[4][0]) for info in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)
        }
        for address in addresses - {HOST}:
            if not address.startswith("127."):
                with socket.socket() as other:
                    other.settimeout(2.0)
                    assert other.connect_ex((address, port)) != 0
        with pytest.raises(InputError, match=f"--port: {port} is not free"):
            Server(result, 2, port)
    finally:
        server.stop()
    assert capsys.readouterr().out == ""


def test_one_server_may_stop_while_another_starts(result: Result, monkeypatch: pytest.MonkeyPatch) -> None:
    viser = pytest.importorskip("viser")
    first, output = Server(result, 2), sys.stdout
    stop, start = first.server.stop, viser.ViserServer
    stops, starts = threading.Event(), threading.Event()
    thread = threading.Thread(target=first.stop)

    def slow_stop() -> None:
        stops.set()
        starts.wait(1.0)
        stop()

    def slow_start(*arguments: Any, **options: Any) -> Any:
        starts.set()
        thread.join()
        return start(*arguments, **options)

    monkeypatch.setattr(first.server, "stop", slow_stop)
    monkeypatch.setattr(viser, "ViserServer", slow_start)
    thread.start()
    stops.wait()
    Server(result, 2).stop()
    assert sys.stdout is output


def answered(port: int, *headers: str) -> int:
    """Status of the answer to a request with these headers."""
    with socket.create_connection((HOST, port), timeout=10.0) as connection:
        lines = ("GET / HTTP/1.1", *headers, "Connection: close", "", "")
        connection.sendall("\r\n".join(lines).encode())
        return int(connection.recv(100).split()[1])


WEBSOCKET = (
    "Upgrade: websocket", "Sec-WebSocket-Version: 13", "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
)  # fmt: skip


def test_only_requests_for_this_machine_are_answered(result: Result) -> None:
    server = Server(result, 2)
    try:
        port = server.server.get_port()
        own, upgraded = f"Host: localhost:{port}", ("Connection: Upgrade", *WEBSOCKET)
        assert answered(port, own) == 200
        assert answered(port, f"Host: 127.0.0.1:{port}", f"Origin: http://127.0.0.1:{port}") == 200
        assert answered(port, "Host: localhost:9000", "Origin: http://localhost:9000") == 200, "a tunnel"
        assert answered(port, own, *upgraded) == 101
        for headers in (
            (f"Host: evil.example:{port}",), ("Host: 127.0.0.1.evil.example",),
            (f"Host: localhost:{port}@evil.example",),
            (own, "Host: evil.example"), (own, "Origin: http://evil.example"), (own, "Origin: null"),
            (own, f"Origin: http://localhost:{port + 1}"), ("X: y",),
        ):  # fmt: skip
            assert answered(port, *headers) == 403, headers
            assert answered(port, *headers, *upgraded) == 403, headers
    finally:
        server.stop()


@pytest.mark.parametrize("port", [65536, 10**9, -1, 0.5, None])
def test_numbers_that_are_no_ports(port: Any) -> None:
    with pytest.raises(InputError, match=r"--port: .* is wrong; give a whole number from 0 to 65535"):
        free_port(port)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere"], "is not a run of vibroswarm"),
        (["DIR", "--run", "7"], "there is no run 7"),
        (["DIR", "--speed", "0"], "--speed: 0 is not from 1 to 200"),
        (["DIR", "--html", "page.txt"], "does not end in .html"),
        (["DIR", "--port", "70000"], "--port: 70000 is not from 0 to 65535"),
    ],
)
def test_bad_input(
    arguments: list[str], words: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert words in refusal_of(
        capsys, "view", *(str(folder) if word == "DIR" else word for word in arguments)
    )


def test_the_file_is_whole_or_not_there(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "run.html"
    assert main(["view", str(folder), "--html", str(page), "--speed", "10"]) == 0
    said = capsys.readouterr()
    assert "Saved:" in said.out
    assert "preparing its scene" in said.err
    assert [path.name for path in tmp_path.iterdir()] == ["run.html"]
    assert "add --force to replace it" in refusal_of(capsys, "view", str(folder), "--html", str(page))


@pytest.fixture(scope="module")
def webgl() -> Iterator[Any]:
    """Chromium with WebGL in software."""
    with launched(
        "--use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader --ignore-gpu-blocklist"
    ) as found:
        yield found


def coloured(page: Any) -> int:
    """How many pixels have the grey of vibrating tiles, about."""
    pixels = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB")).astype(int)
    near: Any = (np.abs(pixels - np.array(VIBRATING)) < 12).all(axis=2)
    return int(near.sum())


def wait_for(condition: Any, seconds: float = 90.0) -> bool:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.5)
    return False


def test_frames_of_a_large_swarm_are_farther_apart(
    result: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vibroswarm.view.server.MOST_POSES", 20 * result.scenario.swarm.robots)
    assert write_html(result, 2, tmp_path / "run.html") == 21  # one at 0 s


@pytest.mark.slow
def test_the_file_plays_in_a_browser_without_network(result: Result, webgl: Any, tmp_path: Path) -> None:
    path, asked = tmp_path / "run.html", []
    assert write_html(result, 2, path, speed=10.0) == 161
    page = webgl.new_page(viewport={"width": 700, "height": 500})
    page.on("request", lambda request: asked.append(request.url))
    page.goto(path.as_uri())
    assert wait_for(lambda: coloured(page) > 5000)
    assert [url for url in asked if not url.startswith(("file:", "data:", "blob:"))] == []
    page.close()


@pytest.mark.slow
def test_the_server_shows_the_scene_in_a_browser(result: Result, webgl: Any) -> None:
    server, over = Server(result, 2), threading.Event()
    thread = threading.Thread(target=lambda: server.serve(over.is_set))
    thread.start()
    try:
        page = webgl.new_page(viewport={"width": 700, "height": 500})
        page.goto(server.url)
        assert wait_for(lambda: coloured(page) > 5000)
        assert wait_for(lambda: "samples read as still" in page.inner_text("body"))
        page.close()
    finally:
        over.set()
        thread.join()
        server.stop()
