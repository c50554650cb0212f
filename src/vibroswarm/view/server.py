"""Show a run in a browser by the library viser: a server for this machine alone, or a file that plays the run back.

The server listens on the loopback address only. The file is made by viser; it needs no server, and in it one can turn
the view, pause, and move to any time.
"""

from __future__ import annotations

import io
import socket
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from http import HTTPStatus
from pathlib import Path
from typing import Any, Final

import numpy as np

from vibroswarm.core.atomic_io import write_file
from vibroswarm.errors import InputError, RunError, whole_number_of
from vibroswarm.result import Result
from vibroswarm.view.picture import camera_of
from vibroswarm.view.scene import Playback, Scene

HOST: Final = "127.0.0.1"
"""Loopback address, which other machines cannot reach."""
NAMES: Final = (HOST, "localhost")
"""Names under which a browser on this machine may request the page."""
MOST_PORT: Final = 65535
"""Largest number of a port."""
FRAME_S: Final = 0.05
"""Real time between updates of a server."""
MOST_FRAMES: Final = 6000
"""Largest number of frames of a file after the first; frames of a longer run are farther apart."""
MOST_POSES: Final = 400_000
"""Largest number of poses of a file (frames x robots), about 20 MB: frames of a larger swarm are farther apart."""


def viser() -> Any:
    """Import and return the module ``viser``, an optional dependency.

    Raises:
        InputError: it is not installed.
    """
    try:
        import viser as module
    except ImportError:
        raise InputError(
            "needs viser, which is not installed: pip install 'vibroswarm[view]'", field="view"
        ) from None
    return module


def free_port(port: int) -> int:
    """Return ``port`` after checking that it is free; for 0, return any free port.

    Raises:
        InputError: another program uses the port, or it is not a port.
    """
    whole_number_of(port, "--port", 0, MOST_PORT)
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        # A port whose last connection was closed a moment ago counts as free.
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError:  # in use, or not allowed
            raise InputError(
                f"{port} is not free on {HOST}; choose another, or 0 for any that is free", field="--port"
            ) from None
        return int(probe.getsockname()[1])


def legend(playback: Playback) -> str:
    """Return what stands over the robots, and what the colours of robots, samples and tiles mean."""
    sensor = playback.result.scenario.sensor
    if max(sensor.kinds, sensor.readings) > 2:
        return (
            "Over each robot: its decision. Each kind has a colour: light of its tiles, dark of samples read as this "
            "kind, of robots that decided for it, and of the lines on tiles of kind 2 and above. Samples: discs of "
            "kind 0, diamonds of kind 1, squares or other shapes of others. Kind 8 has the colour of kind 2, with "
            "denser lines and samples of another shape, and so on."
        )
    of_robot = "its decision"
    if playback.has_beliefs:
        of_robot = "its belief p that less than the boundary vibrates, and its decision"
    less, more = playback.answers
    return (
        f"Over each robot: {of_robot} (blue: {less}, red: {more}). Points: samples read as still (blue discs) or "
        "vibrating (red diamonds). Dark tiles vibrate."
    )


class Server:
    """A server that shows one run, with controls for play, time and speed.

    Args:
        result: the result that has the run. run: number of the run. port: port to listen on; 0: any free port.
        speed: simulated seconds per second, 1 to 200, until the user moves the slider.
    Raises:
        InputError: viser is missing, the port is not free, there is no such run, or the run has no samples.
    """

    def __init__(self, result: Result, run: int, port: int = 0, speed: float = 20.0) -> None:
        module, self.playback = viser(), Playback(result, run)
        self.server: Any = _started(module, port)
        _aim_at_floor(self.server, result)
        self.scene = Scene(self.server.scene, self.playback)
        # Controls of the page; ``step`` reads their values.
        gui, end_s = self.server.gui, self.playback.end_s
        self.playing = gui.add_checkbox("Play", initial_value=True)
        self.time = gui.add_slider("Time, s", min=0.0, max=end_s, step=0.02, initial_value=0.0)
        self.speed = gui.add_slider("Speed", min=1.0, max=200.0, step=1.0, initial_value=speed)
        if not self.playback.is_exact:
            gui.add_markdown("Poses are known at samples only; in between robots go straight.")
        gui.add_markdown(legend(self.playback))
        self.scene.set_time(0.0)

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{HOST}:{self.server.get_port()}"

    def step(self, elapsed_s: float) -> None:
        """Advance the run by ``elapsed_s`` of real time, unless it is paused, and show its state.

        After its end the run starts again.
        """
        now_s = float(self.time.value)
        if self.playing.value:
            now_s += elapsed_s * float(self.speed.value)
            if now_s > self.playback.end_s:
                now_s = 0.0
            self.time.value = now_s
        with self.server.atomic():  # the browser gets all changes at once
            self.scene.set_time(now_s)

    def serve(self, until: Callable[[], bool] = lambda: False) -> None:
        """Play the run in real time until the function ``until`` returns true; by default until the program ends."""
        before = time.monotonic()
        while not until():
            time.sleep(FRAME_S)
            now = time.monotonic()
            self.step(now - before)
            before = now

    def stop(self) -> None:
        """End the server."""
        _stop(self.server)


def write_html(result: Result, run: int, path: Path, speed: float = 20.0, frame_s: float = 0.25) -> int:
    """Write an HTML file that plays a run back; return the number of frames.

    Args:
        run: number of the run. path: of the file. speed: simulated seconds per second.
        frame_s: simulated time between frames, s; it is made longer if there would be more than ``MOST_FRAMES``, or
            more than ``MOST_POSES``.
    Raises:
        InputError: viser is missing, there is no such run, or the run has no samples.
        RunError: the disk is full or failed.
    """
    playback = Playback(result, run)
    server = _started(viser(), port=0)  # any free port; the server only makes the file
    try:
        _aim_at_floor(server, result)
        scene = Scene(server.scene, playback)
        scene.set_time(0.0)
        serializer = server.get_scene_serializer()
        frame_s = max(frame_s, playback.end_s / min(MOST_FRAMES, MOST_POSES / playback.robots))
        # The serializer records the changes of the scene, and the pauses between them. The frame at time 0 is set
        # above; ``times`` has the others. ``np.arange`` stops half a step beyond the end, so the last time is within
        # half a step of the end. If it lies beyond the end, the frame shows the end.
        times = np.arange(frame_s, playback.end_s + frame_s / 2, frame_s)
        for time_s in times.tolist():
            serializer.insert_sleep(frame_s / speed)
            scene.set_time(min(time_s, playback.end_s))
        text = serializer.as_html()
    finally:
        _stop(server)
    write_file(path, text)
    return times.size + 1  # with the frame at time 0


def _started(module: Any, port: int) -> Any:
    """Start and return a viser server without its printed messages.

    It answers requests for its own names only (``is_own_request``). viser has no option for that, so the function of
    the library websockets with which it starts its server is replaced while it starts.

    Raises:
        RunError: this version of viser starts its server in another way.
    """
    from websockets.asyncio import server as sockets

    serve = sockets.serve
    checked = False

    def serve_own(*arguments: Any, process_request: Any = None, **options: Any) -> Any:
        nonlocal checked
        checked = True

        def answer(connection: Any, request: Any) -> Any:
            hosts, origins = (request.headers.get_all(name) for name in ("Host", "Origin"))
            if not is_own_request(hosts, origins):
                return connection.respond(HTTPStatus.FORBIDDEN, "This page is for this machine only.\n")
            return None if process_request is None else process_request(connection, request)

        return serve(*arguments, process_request=answer, **options)

    with _starting, redirect_stdout(io.StringIO()):
        sockets.serve = serve_own  # type: ignore[assignment,misc]
        try:
            started = module.ViserServer(HOST, free_port(port), verbose=False)
        finally:
            sockets.serve = serve  # type: ignore[misc]
    if not checked:
        _stop(started)
        raise RunError("this version of viser does not let its requests be checked; install viser 1.1")
    return started


_starting: Final = threading.Lock()
"""Held while a server starts or stops: the function and the standard output that are replaced meanwhile are one for all
threads."""


def is_own_request(hosts: Sequence[str], origins: Sequence[str]) -> bool:
    """Return whether a request is for this machine's own names, and from a page of the same server.

    A page of another site may have the browser request this server: under a name of its own that leads to the loopback
    address (DNS rebinding), or by a WebSocket, which browsers open across sites.

    Args:
        hosts, origins: values of the request's headers ``Host`` and ``Origin``. The port may be another one, as through
            a tunnel.
    """
    if len(hosts) != 1 or len(origins) > 1:
        return False
    name, _, port = hosts[0].partition(":")
    # A page's own requests have its address as origin, or none.
    own = (f"http://{hosts[0]}", f"https://{hosts[0]}")
    return name.lower() in NAMES and (port.isdecimal() or not port) and (not origins or origins[0] in own)


def _stop(server: Any) -> None:
    with _starting, redirect_stdout(io.StringIO()):
        server.stop()


def _aim_at_floor(server: Any, result: Result) -> None:
    arena = result.scenario.arena
    server.initial_camera.position = tuple(camera_of(result)[0].tolist())
    server.initial_camera.look_at = (arena.width_m / 2, arena.height_m / 2, 0.0)
