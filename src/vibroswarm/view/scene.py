"""Show a run at a time as a scene: floor, walls, samples, and robots with their poses and beliefs.

``Playback`` looks these up in the tables of a result. ``Scene`` shows them in a browser by the library viser.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from vibroswarm.analysis.verdict import answers_of
from vibroswarm.core.numbers import number
from vibroswarm.errors import InputError
from vibroswarm.motion.physics.sources import WHEELS
from vibroswarm.motion.physics.wheels_model import (
    BASE_M,
    CLEARANCE_M,
    HALF_WHEEL_M,
    HEIGHT_M,
    LENGTH_M,
    TRACK_M,
    WHEEL_M,
    WIDTH_M,
)
from vibroswarm.motion.physics.wheels_model import WHEELS as WHEELS_AT
from vibroswarm.motion.pose import ARC, on_arcs
from vibroswarm.result import Result
from vibroswarm.scenario.fields import Arena

Floats = NDArray[np.float64]
Colour = tuple[int, int, int]

UNKNOWN: Final = 0.5
"""Belief before the first sample."""


class Playback:
    """One run of a result, with its state at any time.

    ``sample_s`` (samples,), ``places`` (samples, 2) and ``readings`` (samples,) are time (s), place (x and y, m) and
    reading (a kind of tile) of all samples, in the order of time. ``end_s`` is the end of the run, ``robots``
    the number of robots.

    Args:
        result: with segments (the arcs of the robots' paths) if possible; without, robots are shown going straight from
            sample to sample.
        run: number of the run.
    Raises:
        InputError: there is no such run, or it has no samples.
    """

    def __init__(self, result: Result, run: int) -> None:
        self.result, self.run, self.floor = result, run, result.floor(run)
        of_run = pl.col("run") == run
        self.robots = result.scenario.swarm.robots
        # Each run has rows in ``ends``; ``or 0.0`` is there for the type only, since ``max`` of no rows is None.
        self.end_s = float(result.ends.filter(of_run)["end_s"].max() or 0.0)  # type: ignore[arg-type]
        samples = result.motion.filter(of_run)
        if samples.is_empty():
            raise InputError(f"run {run} has no sample", field="run")
        key = ["run", "robot", "sample"]
        samples = samples.join(result.observations, on=key).join(result.inference, on=key).sort("time_s")
        self.sample_s = samples["time_s"].to_numpy()
        self.places = samples.select("x_m", "y_m").to_numpy()
        self.readings = samples["observation"].cast(pl.Int64).to_numpy()
        self.has_beliefs = samples["belief_below"].null_count() < samples.height
        self.answers = (
            ("less", "more") if result.scenario.task.name == "fill_ratio" else answers_of(result.scenario)
        )
        # Columns of samples and of segments by robot; no segments if the result has none.
        samples = samples.with_columns(pl.col("decision").fill_null(-1))
        self._samples = _by_robot(samples, self.robots, ("time_s", "x_m", "y_m", "belief_below", "decision"))
        segments = None if result.segments is None else result.segments.filter(of_run)
        self._segments = None if segments is None else _by_robot(segments, self.robots, ARC)

    @property
    def is_exact(self) -> bool:
        """Whether poses are known at all times, rather than at samples only."""
        return self._segments is not None

    def poses(self, robot: int, time_s: ArrayLike) -> Floats:
        """Return x, y (m) and heading (rad) of a robot at times, (times, 3).

        With segments, see ``motion.pose.on_arcs``. Without, places are interpolated linearly between samples, and the
        heading is that of the straight line between them; before its first and after its last sample, the robot stands
        at the place of that sample; and all values are nan for a robot without samples.

        Raises:
            InputError: with segments, if the robot has none, or a time is before its first segment.
        """
        times = np.atleast_1d(np.asarray(time_s, dtype=np.float64))
        if self._segments is not None:
            arcs = self._segments[robot]
            if not arcs["start_s"].size or times.min() < arcs["start_s"][0]:
                raise InputError(
                    f"there is no segment of robot {robot} at {times.min():g} s", field="segments"
                )
            return on_arcs(arcs, times)
        taken_s, x, y = (self._samples[robot][name] for name in ("time_s", "x_m", "y_m"))
        if not taken_s.size:
            return np.full((times.size, 3), np.nan)
        # Indices of the samples before and after each time: before the first sample, those of the first two samples;
        # after the last, those of the last two. A single sample is both.
        before = np.clip(np.searchsorted(taken_s, times, side="right") - 1, 0, max(taken_s.size - 2, 0))
        after = np.minimum(before + 1, taken_s.size - 1)
        heading = np.arctan2(y[after] - y[before], x[after] - x[before])
        return np.stack([np.interp(times, taken_s, x), np.interp(times, taken_s, y), heading], axis=1)

    def belief(self, robot: int, time_s: float) -> tuple[float, int]:
        """Return a robot's belief that the fill ratio is below the boundary, and its decision (-1: none), at a time.

        Both are those after the robot's last sample up to this time, s. Before its first sample, or where a recording
        lacks them, the belief is ``UNKNOWN`` and the decision -1.
        """
        own = self._samples[robot]
        k = int(np.searchsorted(own["time_s"], time_s, side="right")) - 1
        if k < 0:
            return UNKNOWN, -1
        belief = float(own["belief_below"][k])  # nan: null
        return UNKNOWN if math.isnan(belief) else belief, int(own["decision"][k])

    def looks(self, robot: int, time_s: float) -> tuple[str, Colour]:
        """Return the text over a robot at a time, and its colour: that of its belief, or else of its decision."""
        belief, decision = self.belief(robot, time_s)
        if self.has_beliefs:
            return words_of(belief, decision, self.answers), colour_of(belief)
        return words_of(None, decision, self.answers), UNSURE if decision < 0 else kind_colours(decision)[1]

    def samples_by(self, time_s: float) -> int:
        """Return how many samples the swarm has taken up to a time."""
        return int(np.searchsorted(self.sample_s, time_s, side="right"))


def _by_robot(table: pl.DataFrame, robots: int, columns: Sequence[str]) -> list[dict[str, NDArray[Any]]]:
    """Return some columns of a table for each robot from 0 to ``robots`` - 1, as arrays."""
    parts = table.partition_by("robot", as_dict=True, maintain_order=True)
    none = table.clear()
    return [{name: parts.get((i,), none)[name].to_numpy() for name in columns} for i in range(robots)]


STILL: Final = (232, 232, 228)
"""Colour (RGB) of still tiles: light grey."""
VIBRATING: Final = (176, 176, 170)
"""Colour (RGB) of vibrating tiles: dark grey."""
LESS: Final = (33, 102, 172)
"""Colour (RGB) of the answer "less" (belief near 1), and of samples read as still: blue."""
MORE: Final = (178, 24, 43)
"""Colour (RGB) of the answer "more" (belief near 0), and of samples read as vibrating: red."""
KINDS: Final = (
    (STILL, LESS),
    (VIBRATING, MORE),
    ((200, 224, 200), (29, 122, 58)),
    ((220, 204, 234), (122, 63, 160)),
    ((238, 228, 176), (138, 109, 0)),
    ((190, 220, 228), (0, 112, 127)),
    ((238, 200, 214), (168, 41, 92)),
    ((206, 196, 184), (77, 77, 77)),
)
"""Colours of tiles of each kind, and of readings and decisions; see ``look_of``."""
UNSURE: Final = (247, 247, 247)
"""Colour (RGB) of a belief of 1/2: nearly white."""
INK: Final = (60, 60, 60)
"""Colour of walls and of the robots' fronts."""
WALL_M: Final = 0.03
"""Height of the walls."""
THICK_M: Final = 0.005
"""Thickness of the walls."""
ROBOT_HEIGHT_M: Final = 0.025
"""Height of a robot that is a disc."""
SAMPLE_M: Final = 0.008
"""Diameter of a sample."""
POINTS: Final = ("circle", "diamond", "square", "sparkle", "rounded")
"""Shapes of samples by their reading, as viser names them; see ``shape_of``."""
CHUNK: Final = 64
"""Samples whose clouds of points are replaced together: only the latest change when a sample is added."""
PIXELS: Final = 400
"""Pixels of the floor's picture along the longer side of the arena."""


def walls(arena: Arena) -> dict[str, tuple[tuple[float, float], tuple[float, float]]]:
    """Return middle (x, y) and size (x, y) of each wall by its name, m; walls stand just outside the arena."""
    width_m, height_m = arena.width_m, arena.height_m
    return {
        "left": ((-THICK_M / 2, height_m / 2), (THICK_M, height_m)),
        "right": ((width_m + THICK_M / 2, height_m / 2), (THICK_M, height_m)),
        "low": ((width_m / 2, -THICK_M / 2), (width_m, THICK_M)),
        "high": ((width_m / 2, height_m + THICK_M / 2), (width_m, THICK_M)),
    }


class Part(NamedTuple):
    """A part of a robot as it is drawn."""

    kind: str
    """"box" or "cylinder"."""
    size_m: tuple[float, ...]
    """Lengths of a box along the robot's axes (ahead, to the left, up), or radius and height of a cylinder."""
    at_m: tuple[float, float, float]
    """Its middle in the robot's frame, whose origin is on the floor."""


def robot_parts(result: Result) -> list[Part]:
    """Return the parts of a robot: its body, which has the colour of its belief, and dark ones.

    A robot on wheels is the one that MuJoCo moves, with what its wheels stick out below; every other one is a disc. A
    dark bar on top shows the front.
    """
    if result.source == WHEELS.name:
        length, width, height = LENGTH_M, WIDTH_M, HEIGHT_M
        middle = (height + CLEARANCE_M) / 2
        body = Part("box", (length, width, height - CLEARANCE_M), (0.0, 0.0, middle))
        chord = 2 * math.sqrt(WHEEL_M**2 - (WHEEL_M - CLEARANCE_M) ** 2)  # of a wheel, at the chassis
        wheels = [
            Part(
                "box",
                (chord, 2 * HALF_WHEEL_M, CLEARANCE_M),
                (x * BASE_M / 2, y * TRACK_M / 2, CLEARANCE_M / 2),
            )
            for _, x, y, _ in WHEELS_AT
        ]
    else:
        length = 2 * result.scenario.robot.body_radius_m
        height, wheels = ROBOT_HEIGHT_M, []
        body = Part("cylinder", (length / 2, height), (0.0, 0.0, height / 2))
    front = Part("box", (length / 2, length / 6, height / 3), (length / 4, 0.0, height))
    return [body, front, *wheels]


def kind_colours(kind: int) -> tuple[Colour, Colour]:
    """Return the colour of tiles of a kind, and that of readings of it and of robots that decided for it."""
    return KINDS[look_of(kind, len(KINDS))]


def look_of(kind: int, looks: int) -> int:
    """Return the index of a kind's look among so many: further kinds use those from the third on again."""
    return kind if kind < looks else 2 + (kind - 2) % (looks - 2)


def shape_of(kind: int) -> int:
    """Return the index in ``POINTS`` of the shape of samples read as a kind; where colours repeat, shapes do not."""
    return look_of(kind + max(kind - 2, 0) // (len(KINDS) - 2), len(POINTS))


def colour_of(belief: float) -> Colour:
    """Return the colour (RGB) of a belief in the answer "less", from red (0) over pale (0.5) to blue (1)."""
    end = LESS if belief > 0.5 else MORE
    share = 2.0 * abs(belief - 0.5)
    red, green, blue = (round(pale + share * (full - pale)) for pale, full in zip(UNSURE, end, strict=True))
    return red, green, blue


def words_of(belief: float | None, decision: int, answers: tuple[str, ...]) -> str:
    """Return the text over a robot: its belief p, if it has one, and its decision if it has decided."""
    words = "" if belief is None else f"p {number(belief, 2)}"
    return words if decision < 0 else f"{words} decided {answers[decision]}".lstrip()


LINES: Final = ((1, 1), (1, -1), (0, 1), (1, 0), (1, 2), (2, 1))
"""The lines on tiles of kind 2, 3 and so on have one value of p * row + q * column, with these p and q, which are used
again for further kinds, with denser lines."""
LINES_APART: Final = 12
"""The difference of that value from one line to the next, pixels; half of it from kind 8 on, a third from 14 on."""


def _on_line(kind: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return 1 for pixels on a line of their kind of tile, else 0, (rows, columns) as ``kind``."""
    p, q = np.array(LINES)[(kind - 2) % len(LINES)].transpose(2, 0, 1)
    row, column = np.indices(kind.shape)
    apart = LINES_APART // (1 + np.maximum(kind - 2, 0) // len(LINES))
    is_on_line = (kind > 1) & ((p * row + q * column) % apart == 0)
    return np.asarray(is_on_line, dtype=np.intp)


def floor_picture(playback: Playback, time_s: float) -> NDArray[np.uint8]:
    """Return the floor of the arena at a time as RGB pixels, top row first, (rows, columns, 3); white off all tiles.

    Tiles of kinds beside still and vibrating have lines in the colour of their readings.
    """
    arena, floor = playback.result.scenario.arena, playback.floor.at(time_s)
    pixel_m = max(arena.width_m, arena.height_m) / PIXELS
    # Coordinates of the middles of pixels, and the tile that each lies on.
    x = (np.arange(max(round(arena.width_m / pixel_m), 1)) + 0.5) * pixel_m
    y = arena.height_m - (np.arange(max(round(arena.height_m / pixel_m), 1)) + 0.5) * pixel_m
    x_m, y_m = np.meshgrid(x, y)
    tile = floor.tile_at(x_m, y_m)
    # Pixels off all tiles get some tile here, and become white below.
    kind = floor.tiles.astype(np.intp).ravel()[tile]
    of_kind = np.array([kind_colours(one) for one in range(kind.max() + 1)])[kind, _on_line(kind)]
    between = np.array(STILL) + floor.contrast_at(x_m, y_m)[..., None] * (
        np.array(VIBRATING) - np.array(STILL)
    )
    picture = np.where((kind > 1)[..., None], of_kind, between.round()).astype(np.uint8)
    picture[tile < 0] = 255
    return picture


class Scene:
    """Floor, walls, robots and samples of a run in a viser server.

    Args:
        api: ``viser.SceneApi`` of a server. playback: the run.
    """

    def __init__(self, api: Any, playback: Playback) -> None:
        self.api, self.playback = api, playback
        arena = playback.result.scenario.arena
        width_m, height_m = arena.width_m, arena.height_m
        api.set_up_direction("+z")
        api.configure_environment_map(None)  # no surroundings, only the ambient light of the next line
        api.add_light_ambient("/light", intensity=1.2)
        # viser draws an image with its first row at low y; half a turn about the x axis puts it at high y.
        self.floor_image = api.add_image(
            "/floor", np.ascontiguousarray(floor_picture(playback, 0.0)), width_m, height_m, format="png",
            position=(width_m / 2, height_m / 2, 0.0), wxyz=(0.0, 1.0, 0.0, 0.0), receive_shadow=False,
        )  # fmt: skip
        for name, (at, size) in walls(arena).items():
            place = (*at, WALL_M / 2)
            api.add_box(f"/walls/{name}", INK, (*size, WALL_M), opacity=0.35, position=place)
        parts = robot_parts(playback.result)
        top_m = 2 * parts[0].at_m[2]
        self.frames, self.bodies, self.labels = [], [], []
        for robot in range(playback.robots):
            path = f"/robots/{robot}"
            self.frames.append(api.add_frame(path, show_axes=False))
            drawn = [self._draw(f"{path}/{k}", part, INK if k else UNSURE) for k, part in enumerate(parts)]
            self.bodies.append(drawn[0])
            self.labels.append(
                api.add_label(
                    f"{path}/belief", "", position=(0.0, 0.0, top_m + 0.03), anchor="bottom-center",
                    font_screen_scale=0.7,
                )
            )  # fmt: skip
        # Samples are shown in chunks of ``CHUNK``. By index of a chunk: its clouds of points, and the number of samples
        # that they show.
        self.stage = 0  # number of changes of the floor that are shown
        self.clouds: dict[int, list[Any]] = {}
        self.shown: dict[int, int] = {}
        # By robot: the pose and the text that are shown.
        self._poses: dict[int, tuple[float, ...]] = {}
        self._words: dict[int, str] = {}

    def _draw(self, path: str, part: Part, colour: tuple[int, int, int]) -> Any:
        """Add a part of a robot; return viser's handle of it."""
        if part.kind == "box":
            return self.api.add_box(path, colour, part.size_m, position=part.at_m)
        return self.api.add_cylinder(path, *part.size_m, colour, position=part.at_m)

    def set_time(self, time_s: float) -> None:
        """Show the state of the run at a time, s; only what differs from the state shown is sent to the browser."""
        for robot in range(self.playback.robots):
            self._place(robot, time_s)
        stage = int(np.searchsorted(self.playback.floor.changes.times_s, time_s, side="right"))
        if stage != self.stage:
            self.stage = stage
            self.floor_image.image = np.ascontiguousarray(floor_picture(self.playback, time_s))
        self._show_samples(self.playback.samples_by(time_s))

    def _place(self, robot: int, time_s: float) -> None:
        """Show one robot's pose, belief and decision at a time, s; hide it if its place is not known."""
        x_m, y_m, heading_rad = self.playback.poses(robot, time_s)[0].tolist()
        is_known = math.isfinite(x_m)
        if self.frames[robot].visible != is_known:
            self.frames[robot].visible = is_known
        if not is_known:
            return
        if self._poses.get(robot) != (x_m, y_m, heading_rad):
            self._poses[robot] = (x_m, y_m, heading_rad)
            self.frames[robot].position = (x_m, y_m, 0.0)
            # Rotation about the vertical axis, as a quaternion.
            self.frames[robot].wxyz = (math.cos(heading_rad / 2), 0.0, 0.0, math.sin(heading_rad / 2))
        words, colour = self.playback.looks(robot, time_s)
        # The colour changes only with the text: changes of the belief that its two decimals do not show are not sent.
        if self._words.get(robot) != words:
            self._words[robot] = words
            self.labels[robot].text = f"{robot}: {words}" if words else str(robot)
            self.bodies[robot].color = colour

    def _show_samples(self, count: int) -> None:
        """Show the first ``count`` samples in the colours and shapes of their readings.

        Samples are shown in chunks of up to ``CHUNK``, with a cloud of points for each reading. A cloud cannot be
        changed once it is made, so the clouds of a chunk whose number of samples must change are replaced.
        """
        chunks = -(-len(self.playback.sample_s) // CHUNK)  # rounded up
        for chunk in range(chunks):
            first = chunk * CHUNK
            shown = min(max(count - first, 0), CHUNK)
            if self.shown.get(chunk, 0) == shown:
                continue
            self.shown[chunk] = shown
            for old in self.clouds.pop(chunk, ()):
                old.remove()
            rows = slice(first, first + shown)
            readings = self.playback.readings[rows]
            self.clouds[chunk] = [
                self._cloud(f"/samples/{chunk}/{kind}", self.playback.places[rows][readings == kind], kind)
                for kind in np.unique(readings).tolist()
            ]

    def _cloud(self, path: str, places: Floats, kind: int) -> Any:
        """Add samples that were read as one kind at their places, (samples, 2); return viser's handle of them."""
        heights = np.full((len(places), 1), SAMPLE_M / 2)
        return self.api.add_point_cloud(
            path,
            np.hstack([places, heights]).astype(np.float32),
            kind_colours(kind)[1],
            point_size=SAMPLE_M,
            point_shape=POINTS[shape_of(kind)],
            point_shading="flat",
            precision="float32",
        )
