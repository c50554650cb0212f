"""What is doubtful in a tracking: where, when, and what to do about it.

| kind | doubtful |
|---|---|
| gap | a robot was not seen for more than a second |
| jump | a position too far from its neighbours, which was dropped |
| carried | a robot that was seen on, but moved faster than it can drive: moved by hand, or another one's marker |
| twice | one marker seen at two places of a frame |
| small | a robot's marker is too small to be read well |
| size | robots' markers do not measure what the file states |
| floor | a marker of the floor that is not where the file has it, or that was not seen |
| frames | frames that are not evenly spaced |
| sample | a sample in the log while the robot, as seen, did not stop |
| stop | a stop without a sample in the log |
| late | a sample logged during a stop that ends at another time |
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.tracking.camera import outwards, square_errors
from vibroswarm.tracking.stitch import Stitched
from vibroswarm.tracking.track import FASTEST_M_S, GAP_S, SMALL_PX, Tracking
from vibroswarm.tracking.video_file import UNEVEN, uneven_frames

Floats = NDArray[np.float64]

FLOOR_PX: Final = 1.0
"""A floor marker whose corners are further off (root mean square) is not where the file has it."""
SIZE_SHARE: Final = 0.05
"""Robots' markers that measure so much more or less than stated."""
TITLES: Final = {
    "gap": "Robots that were lost",
    "carried": "Robots that moved too fast",
    "jump": "Positions that were dropped",
    "twice": "Markers seen twice",
    "floor": "Markers of the floor that are not in their places",
    "size": "Robots' markers of another size",
    "small": "Markers that are too small",
    "sample": "Samples without a stop",
    "stop": "Stops without a sample",
    "late": "Stops that end at another time than their samples",
    "frames": "Uneven frames",
}
"""Kinds in the order in which they matter, with their headings."""
ADVICE: Final = {
    "gap": "Nothing is filled in there. Look what hides the marker: a hand, a cable, glare, a dark corner, the edge of "
    "the picture. If it is read badly everywhere, print it larger or on matt paper.",
    "carried": "If the robot was moved by hand, leave this stretch out. If not, two robots carry the same marker or "
    "one was read for another: give each its own, far apart in the dictionary.",
    "jump": "Dropped, nothing to do, if there are few. If there are many, another object carries this marker, or "
    "the pattern is misread: choose another marker.",
    "twice": "Neither is used. Remove the second one from the picture: a spare print, a mirror, a screen.",
    "floor": "Measure its place again (centre, mm, from the lower left corner of the arena, y upwards), and look "
    "whether it was moved, lies flat, and is of the size stated. If that cannot be found out, remove it from the file.",
    "size": "Measure the edge of the black square and the height of the marker above the floor; a wrong height "
    "shifts positions outwards or inwards.",
    "small": "Bring the camera nearer, film at a higher resolution, or print larger markers.",
    "sample": "Few of these are stops that the camera missed. Many: the log is of another session, or the robots' "
    "names in the markers' file are not those of the log.",
    "stop": "Few of these are robots that stood for another reason. Many: rows of the log are missing.",
    "late": "The place is right, the time of the log is used. If there are many, the robot stands after its sample, or "
    "its clock drifts: look at the clocks below.",
    "frames": "Times are those of the file, which is right for a phone that films slower in the dark: use more light. "
    "If the file was converted, track the original.",
}
"""What to do about each kind."""


@dataclass(frozen=True)
class Doubt:
    """One doubtful moment."""

    kind: str
    words: str
    """A sentence: who, when, what."""
    robot: int | None = None
    time_s: float | None = None
    """On the video's clock; None: all the time."""
    shots: tuple[tuple[float, str], ...] = ()
    """Times of frames that show it, each with a few words."""
    at_px: tuple[float, float] | None = None
    """Where in the frame; None: where the robot was seen nearest in time."""
    weight: float = 0.0
    """Of two doubts of a kind, the heavier is shown first."""
    camera: int = 0
    """Whose video shows it; times of the frames are that camera's."""


def doubts_of(
    session: Stitched, samples: pl.DataFrame | None = None, lone_stops: pl.DataFrame | None = None
) -> list[Doubt]:
    """Return what is doubtful in a session, most important first.

    Args:
        samples: ``stops.SAMPLES_MATCHED``. lone_stops: stops that no sample matches.
    """
    found = _gaps(session)
    for number, tracking in enumerate(session.cameras):
        own = [
            *_moved(tracking), *_dropped(tracking), *_twice(tracking), *_floor(tracking),
            *_sizes(tracking), *_frames(tracking),
        ]  # fmt: skip
        name = f"{tracking.video.name}: " if len(session.cameras) > 1 else ""
        found += [replace(doubt, camera=number, words=name + doubt.words) for doubt in own]
    found += _floor_never_seen(session)
    if samples is not None and lone_stops is not None:
        found += _unmatched(session, samples, lone_stops)
    order = list(TITLES)
    return sorted(found, key=lambda doubt: (order.index(doubt.kind), -doubt.weight))


def _shown_by(session: Stitched, robot: int, at_s: float) -> int:
    """Return the camera that saw a robot nearest to a time."""
    apart = []
    for number, camera in enumerate(session.cameras):
        own = camera.positions.filter(pl.col("robot") == robot)["time_s"].to_numpy()
        apart.append(float(np.abs(own + session.offset_s(number) - at_s).min()) if own.size else np.inf)
    return int(np.argmin(apart))


def _gaps(session: Stitched) -> list[Doubt]:
    first_s, last_s = session.span_s
    spans = [
        (c.span_s[0] + session.offset_s(k), c.span_s[1] + session.offset_s(k))
        for k, c in enumerate(session.cameras)
    ]
    all_begun_s, none_ended_s = max(first for first, _ in spans), min(last for _, last in spans)
    found = []
    for robot, start_s, end_s in session.gaps().iter_rows():
        if len(session.cameras) > 1 and (end_s <= all_begun_s + GAP_S or start_s >= none_ended_s - GAP_S):
            words = (
                f"Robot {robot} was not seen from {start_s:.1f} to {end_s:.1f} s, while not every camera ran."
            )
            found.append(Doubt("gap", words, robot, start_s))
            continue
        camera = _shown_by(session, robot, start_s if start_s > first_s else end_s)
        shots = ((start_s, "seen last"), ((start_s + end_s) / 2, "in between"), (end_s, "seen again"))
        shown = tuple(
            (at_s - session.offset_s(camera), words)
            for (at_s, words), fits in zip(shots, (start_s > first_s, True, end_s < last_s), strict=True)
            if fits
        )
        words = f"Robot {robot} was not seen from {start_s:.1f} to {end_s:.1f} s ({end_s - start_s:.1f} s)."
        found.append(Doubt("gap", words, robot, start_s, shown, None, end_s - start_s, camera))
    return found


def _moved(tracking: Tracking) -> list[Doubt]:
    """Return a doubt for each step between kept positions, at most ``GAP_S`` apart, that is too fast for a robot."""
    found = []
    for (robot,), own in tracking.positions.group_by("robot", maintain_order=True):
        time_s, x_m, y_m = (own[name].to_numpy() for name in ("time_s", "x_m", "y_m"))
        step_s, step_m = np.diff(time_s), np.hypot(np.diff(x_m), np.diff(y_m))
        for k in np.flatnonzero((step_s <= GAP_S) & (step_m > FASTEST_M_S * step_s)).tolist():
            words = f"Robot {robot} moved {1000 * step_m[k]:.0f} mm in {1000 * step_s[k]:.0f} ms at {time_s[k]:.1f} s."
            shots = ((float(time_s[k]), "before"), (float(time_s[k + 1]), "after"))
            found.append(Doubt("carried", words, int(robot), float(time_s[k]), shots, None, float(step_m[k])))
    return found


def _dropped(tracking: Tracking) -> list[Doubt]:
    return [
        Doubt(
            "jump", f"Robot {robot} was read at ({x_m:.3f}, {y_m:.3f}) m at {time_s:.1f} s, far from its path.",
            robot, time_s, ((time_s, "dropped"),),
        )
        for robot, time_s, x_m, y_m in tracking.dropped.select("robot", "time_s", "x_m", "y_m").iter_rows()
    ]  # fmt: skip


def _twice(tracking: Tracking) -> list[Doubt]:
    """Return one doubt for each marker that was seen twice."""
    seen = tracking.detections
    frames: dict[int, list[int]] = {}
    for frame, marker in seen.twice:
        frames.setdefault(marker, []).append(frame)
    found = []
    for marker, where in frames.items():
        robot = tracking.markers.robots.get(marker)
        name = f"robot {robot}'s marker {marker}" if robot is not None else f"marker {marker}"
        time_s = float(seen.time_s[where[0]])
        words = f"Of {name} two were seen at once in {len(where)} of the frames searched, first at {time_s:.1f} s."
        found.append(Doubt("twice", words, robot, time_s, ((time_s, "first"),), None, len(where)))
    return found


def _floor(tracking: Tracking) -> list[Doubt]:
    found = []
    for marker, residual_px in floor_residuals(tracking).items():
        error = float(np.sqrt((residual_px**2).sum(axis=1).mean()))
        if error <= FLOOR_PX:
            continue
        at = tracking.detections.floor_px[marker].mean(axis=0)
        words = (
            f"Marker {marker} of the floor is {error:.1f} px ({error * mm_per_px(tracking):.1f} mm) from where the "
            "file and the other markers have it."
        )
        at_px = (float(at[0]), float(at[1]))
        found.append(Doubt("floor", words, None, None, ((0.0, f"marker {marker}"),), at_px, error))
    return found


def _floor_never_seen(session: Stitched) -> list[Doubt]:
    seen = {marker for camera in session.cameras for marker in camera.detections.floor_px}
    missing = [marker for marker in session.markers.floor if marker not in seen]
    if not missing:
        return []
    listed = ", ".join(map(str, missing))
    return [Doubt("floor", f"Never seen: markers {listed} of the floor, which the file lists.")]


def _sizes(tracking: Tracking) -> list[Doubt]:
    """Return markers that are small in the picture, and a size that differs from the file's."""
    seen = tracking.detections
    found = []
    for (name, measured_m), edge in zip(marker_sizes_m(tracking).items(), seen.edge_px(), strict=True):
        share = measured_m / tracking.markers.size_m - 1.0
        if abs(share) > SIZE_SHARE:
            words = (
                f"Robot {name}'s marker measures {1000 * measured_m:.1f} mm at its stated height, "
                f"{100 * share:+.0f} % from the {1000 * tracking.markers.size_m:g} mm of the file."
            )
            found.append(Doubt("size", words, name, None, (), None, abs(share)))
        if edge < SMALL_PX:
            i = list(tracking.markers.robots.values()).index(name)
            there = np.flatnonzero(np.isfinite(seen.corners_px[:, i, 0, 0]))
            edges = np.linalg.norm(seen.corners_px[there, i, 1] - seen.corners_px[there, i, 0], axis=1)
            time_s = float(seen.time_s[there[int(np.argmin(edges))]])
            words = f"Robot {name}'s marker is {edge:.1f} px wide (median); from {SMALL_PX:g} px on it is read well."
            shots = ((time_s, f"{edges.min():.0f} px wide"),)
            found.append(Doubt("small", words, name, None, shots, None, SMALL_PX - edge))
    return found


def _frames(tracking: Tracking) -> list[Doubt]:
    time_s = tracking.detections.time_s
    uneven = uneven_frames(time_s)
    if uneven is None:
        return []
    steps = np.diff(time_s)
    usual = float(np.median(steps))
    odd = int((np.abs(steps - usual) > UNEVEN * usual).sum())
    longest = int(np.argmax(steps))
    words = (
        f"{odd} of {steps.size} steps between frames differ from the usual {1000 * usual:.0f} ms by more than a fifth; "
        f"the longest is {1000 * steps[longest]:.0f} ms, at {time_s[longest]:.1f} s."
    )
    return [Doubt("frames", words, None, float(time_s[longest]), (), None, float(steps[longest]))]


def _unmatched(session: Stitched, samples: pl.DataFrame, lone_stops: pl.DataFrame) -> list[Doubt]:
    """Return samples without a stop while the robot was seen, and stops without a sample."""
    found, explained = [], set()
    for robot, time_s in samples.filter(pl.col("stop_end_s").is_null()).select("robot", "time_s").iter_rows():
        own = session.positions.filter(pl.col("robot") == robot)["time_s"]
        if (own - time_s).abs().min() is None or float((own - time_s).abs().min()) > GAP_S:
            continue  # before or after the video, or in a gap, which is shown as such
        during = lone_stops.filter(
            (pl.col("robot") == robot) & (pl.col("start_s") <= time_s) & (pl.col("end_s") >= time_s)
        )
        if during.height:
            end_s = float(during["end_s"][0])
            explained.add((robot, end_s))
            words = f"Robot {robot} logged a sample at {time_s:.1f} s, in a stop that was seen to end at {end_s:.1f} s."
            found.append(Doubt("late", words, robot, time_s, ((time_s, "the sample"), (end_s, "the end"))))
            continue
        words = f"Robot {robot} logged a sample at {time_s:.1f} s, where no stop was seen."
        found.append(Doubt("sample", words, robot, time_s, ((time_s, "the sample"),)))
    found = [_on_camera(session, doubt) for doubt in found]
    first_s, last_s = (samples["time_s"].min() or 0.0), (samples["time_s"].max() or 0.0)
    for robot, start_s, end_s in (
        lone_stops.filter("end_seen").select("robot", "start_s", "end_s").iter_rows()
    ):
        if first_s <= end_s <= last_s and (robot, end_s) not in explained:
            words = (
                f"Robot {robot} stood from {start_s:.1f} to {end_s:.1f} s, and the log has no sample of it."
            )
            shots = (((start_s + end_s) / 2, "it stands"),)
            found.append(
                _on_camera(session, Doubt("stop", words, robot, start_s, shots, None, end_s - start_s))
            )
    return found


def _on_camera(session: Stitched, doubt: Doubt) -> Doubt:
    """Return a doubt with the camera that saw its robot nearest in time, its frames' times on that camera's clock."""
    if doubt.robot is None or doubt.time_s is None:
        return doubt
    camera = _shown_by(session, doubt.robot, doubt.time_s)
    shots = tuple((at_s - session.offset_s(camera), words) for at_s, words in doubt.shots)
    return replace(doubt, camera=camera, shots=shots)


def floor_residuals(tracking: Tracking) -> dict[int, Floats]:
    """Return for each floor marker seen by how much its corners differ from the fitted camera's, (4, 2), px."""
    return {
        marker: sharp_corners(tracking, corners[None])[0]
        - tracking.camera.project(tracking.markers.floor_corners(marker))
        for marker, corners in tracking.detections.floor_px.items()
    }


def sharp_corners(tracking: Tracking, corners_px: Floats) -> Floats:
    """Return corners, (markers, 4, 2), px, with edges moved back by what blur and thresholds moved them outwards."""
    found: Floats = corners_px - tracking.camera.edge_px * outwards(corners_px)
    return found


def marker_sizes_m(tracking: Tracking) -> dict[int, float]:
    """Return the median edge, m, of each robot's marker at its stated height, by robot's name; NaN if never seen."""
    seen, found = tracking.detections.corners_px, {}
    for i, name in enumerate(tracking.markers.robots.values()):
        own = seen[np.isfinite(seen[:, i]).all(axis=(1, 2)), i]
        found[name] = float("nan")
        if len(own):
            corners = tracking.camera.at_height(sharp_corners(tracking, own), tracking.markers.height_m)
            edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=-1)
            found[name] = float(np.median(edges))
    return found


def square_residuals(tracking: Tracking, most: int = 400) -> tuple[Floats, Floats]:
    """Return where robots' markers were seen, and how far they are from squares of their median size.

    Args:
        most: detections, evenly chosen.
    Returns: centres, (detections, 2), px, and root mean square errors of their corners, (detections,), mm.
    """
    seen = tracking.detections.corners_px
    corners_px = seen[np.isfinite(seen).all(axis=(2, 3))]
    corners_px = corners_px[:: max(len(corners_px) // most, 1)][:most]
    corners = tracking.camera.at_height(corners_px, tracking.markers.height_m)
    sizes = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=-1)
    errors = square_errors(corners, float(np.median(sizes)))
    return corners_px.mean(axis=1), 1000 * np.sqrt((errors**2).sum(axis=2).mean(axis=1))


def mm_per_px(tracking: Tracking) -> float:
    """Return how many mm of the floor a pixel in the middle of the picture covers."""
    width, height = tracking.detections.size_px
    middle = np.array([[width / 2, height / 2], [width / 2 + 1.0, height / 2]])
    at = tracking.camera.at_height(middle, 0.0)
    return 1000 * float(np.linalg.norm(at[1] - at[0]))


def place_px(tracking: Tracking, robot: int, time_s: float) -> tuple[Floats, float] | None:
    """Return the centre, (2,), px, and the edge of a robot's marker where it was seen nearest in time; None: never."""
    names = list(tracking.markers.robots.values())
    if robot not in names:
        return None
    own = tracking.detections.corners_px[:, names.index(robot)]
    there = np.flatnonzero(np.isfinite(own).all(axis=(1, 2)))
    if not there.size:
        return None
    nearest = own[there[int(np.argmin(np.abs(tracking.detections.time_s[there] - time_s)))]]
    return nearest.mean(axis=0), float(np.linalg.norm(nearest[1] - nearest[0]))
