"""``vibroswarm view`` shows what the tables say; its page works in a browser, and is for this machine only."""

from __future__ import annotations

import math
import socket

import numpy as np
import pytest

from vibroswarm import preset, simulate
from vibroswarm.errors import InputError
from vibroswarm.motion.pose import pose
from vibroswarm.result import Result
from vibroswarm.view.scene import (
    Playback,
)
from vibroswarm.view.server import HOST, Server

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
