"""Find what is doubtful in a tracking: where, when, and what to do about it.

| kind | what is doubtful |
|---|---|
| gap | a robot was not seen for more than a second |
| jump | a position too far from those before and after it, which was dropped |
| still | a robot never left its place, while others did |
| carried | a robot seen all the time moved faster than it can drive: by hand, or the marker is another robot's |
| twice | one marker was seen at two places of a frame |
| unexpected | a marker was seen that is in no list: it moves, or it never does and is likely no marker |
| small | a robot's marker is too small to be read well |
| size | a robot's marker has another size than the file of markers states, or its two sizes do not fit each other |
| floor | a marker of the floor is not at the place that the file of markers gives, moved, or was not seen |
| frames | frames are not evenly spaced |
| sample | the log has a sample where the robot did not stop, as the video shows |
| stop | the robot stopped, and the log has no sample of it |
| late | a sample was logged during a stop, but the stop ends at another time than it should after the sample |

The log is written by the robots, with a row per sample (see ``stops``). A robot is called by its name, the number that
it has in the log.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl

from vibroswarm.core.arrays import Bools, Floats
from vibroswarm.core.numbers import number, percent, stated, verb
from vibroswarm.tracking import opencv
from vibroswarm.tracking.camera import outwards, square_errors
from vibroswarm.tracking.marker_detection import edge_lengths
from vibroswarm.tracking.picture_quality import SMALL_PX, white_places
from vibroswarm.tracking.track import FASTEST_M_S, GAP_S, Tracking
from vibroswarm.tracking.video_file import UNEVEN, uneven_frames

FLOOR_PX: Final = 1.0
"""A floor marker with a larger error of its corners (root mean square, px) is not where the file has it."""
STILL_S: Final = 10.0
"""A robot stands still if it does for all the time that it was seen, and that is longer than this."""
SIZE_SHARE: Final = 0.05
"""A marker is of another size if it differs from the stated size by more than this share."""
WIDER_PX: Final = 0.25
"""If the floor's markers are seen wider at each edge than the robots' by more than this, for the sizes that are stated,
these do not fit each other. Rendered markers of the right sizes differ by up to 0.18 px."""
TITLES: Final = {
    "gap": "Robots that were lost",
    "still": "Robots that never left their place",
    "carried": "Robots that moved too fast",
    "jump": "Positions that were dropped",
    "twice": "Markers seen twice",
    "unexpected": "Markers that are not in the file",
    "floor": "Markers of the floor that are not in their places",
    "size": "Markers of another size",
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
    "still": "If the robot was on, something else is read as its marker: look at the frame. If it was off, leave it "
    "out of the file of markers.",
    "carried": "If the robot was moved by hand, leave this stretch out. If not, two robots carry the same marker or "
    "one was read for another: give each its own, far apart in the dictionary.",
    "jump": "Dropped, nothing to do, if there are few. If there are many, the camera moves (a warning says so), "
    "another object carries this marker, or the pattern is misread: choose another marker.",
    "twice": "The one nearer to the robot's path is used, neither if it was never seen alone. Remove the second one "
    "from the picture: a spare print, a mirror, a screen.",
    "unexpected": "If it is a marker, add it to the file. If not, something in the picture is misread as one, and "
    "might be misread as a robot's: cover it, or print markers of a dictionary with more squares (6X6_250).",
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
    """The robot's name; None: the doubt is not about one robot."""
    time_s: float | None = None
    """When it happens, on the video's clock. None: it is there all the time."""
    shots: tuple[tuple[float, str], ...] = ()
    """Frames that show it: the time and a few words of each."""
    at_px: tuple[float, float] | None = None
    """Its place in the frame; None: where the robot was seen nearest in time."""
    weight: float = 0.0
    """How much it matters; doubts of a kind are sorted by descending weight."""


def doubts_of(
    tracking: Tracking, samples: pl.DataFrame | None = None, lone_stops: pl.DataFrame | None = None
) -> list[Doubt]:
    """Return what is doubtful in a tracking, in the order of ``TITLES``; doubts of a kind by descending weight.

    Args:
        samples: the log's samples with the stops that they match, ``stops.SAMPLES_MATCHED``; None without a log.
        lone_stops: the stops that no sample matches, ``stops.STOPS``; None without a log.
    """
    found = [
        *_gaps(tracking), *_still(tracking), *_moved(tracking), *_dropped(tracking), *_twice(tracking),
        *_unexpected(tracking), *_floor(tracking), *_floor_moved(tracking), *_floor_never_seen(tracking),
        *_sizes(tracking), *_frames(tracking),
    ]  # fmt: skip
    if samples is not None and lone_stops is not None:
        found += _unmatched(tracking, samples, lone_stops)
    order = list(TITLES)
    return sorted(found, key=lambda doubt: (order.index(doubt.kind), -doubt.weight))


def _gaps(tracking: Tracking) -> Iterator[Doubt]:
    """Yield a doubt for each gap in which a robot was not seen."""
    first_s, last_s = tracking.span_s
    white = _white_around(tracking)
    for robot, start_s, end_s in tracking.gaps().iter_rows():
        # A gap at the beginning of the video has no frame with the robot before it; one at the end, none after it.
        # The gap of a robot that was never seen is the whole video, and has neither.
        shots = [(start_s, "seen last")] if start_s > first_s else []
        shots += [((start_s + end_s) / 2, "in between")]
        shots += [(end_s, "seen again")] if end_s < last_s else []
        words = (
            f"Robot {robot} was not seen from {number(start_s, 1)} to {number(end_s, 1)} s "
            f"({number(end_s - start_s, 1)} s)."
        )
        ends = [place_px(tracking, robot, at_s) for at_s in (start_s, end_s)]
        if any(end is not None and is_in(white, end[0]) for end in ends):
            words += " It was lost or found again where the picture is white, as in a reflection."
        yield Doubt("gap", words, robot=robot, time_s=start_s, shots=tuple(shots), weight=end_s - start_s)


def is_in(area: Bools, at_px: Floats) -> bool:
    """Return whether a place, (2,), px, is in an area of the picture, (height, width)."""
    column, row = np.clip(at_px.astype(int), 0, np.array(area.shape[::-1]) - 1)
    return bool(area[row, column])


def _white_around(tracking: Tracking) -> Bools:
    """Return whether each pixel, (height, width), is at most a marker's edge from a place that is white throughout."""
    seen = tracking.detections
    found = np.zeros(seen.size_px[::-1], dtype=np.uint8)
    edge_px = float(np.nanmedian(seen.edge_px()))
    for place in white_places(seen.samples, edge_px) if seen.samples else []:
        found |= place
    around = np.ones((2 * round(edge_px) + 1,) * 2, dtype=np.uint8)
    return np.asarray(opencv().dilate(found, around) > 0)


def _still(tracking: Tracking) -> Iterator[Doubt]:
    """Yield a doubt for each robot that stayed within half a marker, if another robot did not."""
    least_m = tracking.markers.size_m / 2
    rows = tracking.positions.group_by("robot", maintain_order=True).agg(
        span_s=pl.col("time_s").max() - pl.col("time_s").min(),
        time_s=pl.col("time_s").first(),
        width_m=pl.col("x_m").max() - pl.col("x_m").min(),
        height_m=pl.col("y_m").max() - pl.col("y_m").min(),
    )
    rows = rows.with_columns(moves=pl.max_horizontal("width_m", "height_m") > least_m)
    stood = rows.filter(pl.col("moves").any(), ~pl.col("moves"), pl.col("span_s") > STILL_S)
    for robot, span_s, time_s in stood.select("robot", "span_s", "time_s").iter_rows():
        words = f"Robot {robot} never left its place in the {number(span_s, 0)} s in which it was seen."
        yield Doubt("still", words, robot=robot, time_s=time_s, shots=((time_s, "it stands"),), weight=span_s)


def _moved(tracking: Tracking) -> Iterator[Doubt]:
    """Yield a doubt (kind ``carried``) for each step of a robot that is too fast to be driven.

    Only steps between positions at most ``GAP_S`` apart are judged: in a longer gap the robot was not seen.
    """
    for (robot,), own in tracking.positions.group_by("robot", maintain_order=True):
        time_s, x_m, y_m = (own[name].to_numpy() for name in ("time_s", "x_m", "y_m"))
        step_s, step_m = np.diff(time_s), np.hypot(np.diff(x_m), np.diff(y_m))
        for k in np.flatnonzero((step_s <= GAP_S) & (step_m > FASTEST_M_S * step_s)).tolist():
            words = (
                f"Robot {robot} moved {number(1000 * step_m[k], 0)} mm in {number(1000 * step_s[k], 0)} ms at "
                f"{number(time_s[k], 1)} s."
            )
            shots = ((float(time_s[k]), "before"), (float(time_s[k + 1]), "after"))
            yield Doubt(
                "carried",
                words,
                robot=int(robot),
                time_s=float(time_s[k]),
                shots=shots,
                weight=float(step_m[k]),
            )


def _dropped(tracking: Tracking) -> Iterator[Doubt]:
    """Yield a doubt (kind ``jump``) for each position that tracking dropped, since it was too far from the others."""
    for robot, time_s, x_m, y_m in tracking.dropped.select("robot", "time_s", "x_m", "y_m").iter_rows():
        words = (
            f"Robot {robot} was read at ({number(x_m, 3)}, {number(y_m, 3)}) m at {number(time_s, 1)} s, far from "
            f"its path."
        )
        yield Doubt("jump", words, robot=robot, time_s=time_s, shots=((time_s, "dropped"),))


def _twice(tracking: Tracking) -> Iterator[Doubt]:
    """Yield a doubt for each marker that was seen at two places of a frame."""
    seen = tracking.detections
    frames_of: dict[int, list[int]] = {}  # by marker
    for frame, marker in seen.twice:
        frames_of.setdefault(marker, []).append(frame)
    for marker, frames in frames_of.items():
        robot = tracking.markers.robots.get(marker)  # None: a marker of the floor, or an unknown one
        name = f"robot {robot}'s marker {marker}" if robot is not None else f"marker {marker}"
        time_s = float(seen.time_s[frames[0]])
        words = (
            f"Of {name} two were seen at once in {len(frames)} of the frames searched, first at "
            f"{number(time_s, 1)} s."
        )
        yield Doubt(
            "twice", words, robot=robot, time_s=time_s, shots=((time_s, "first"),), weight=len(frames)
        )


def _unexpected(tracking: Tracking) -> Iterator[Doubt]:
    """Yield a doubt for each marker that is in no list and was seen in two whole frames or more.

    It moves if the middles of its places are farther apart than its edge.
    """
    seen = tracking.detections
    for marker, places in seen.unexpected.items():
        if len(places) < 2:
            continue
        frame, first = places[0]
        middles = np.array([four.mean(axis=0) for _, four in places])
        moves = float(np.linalg.norm(np.ptp(middles, axis=0))) > float(np.linalg.norm(first[1] - first[0]))
        how = "at several places" if moves else "always at the same place"
        words = (
            f"Marker {marker}, which is neither a robot's nor the floor's, was seen in {len(places)} of "
            f"{seen.whole_frames} frames searched whole, {how}."
        )
        time_s, at = float(seen.time_s[frame]), first.mean(axis=0)
        shots, at_px = ((time_s, f"marker {marker}"),), (float(at[0]), float(at[1]))
        yield Doubt("unexpected", words, time_s=time_s, shots=shots, at_px=at_px, weight=len(places))


def _floor(tracking: Tracking) -> Iterator[Doubt]:
    """Yield a doubt for each marker of the floor that is more than ``FLOOR_PX`` from its place in the file."""
    for marker, error in floor_errors_px(floor_residuals(tracking)).items():
        if error <= FLOOR_PX:
            continue
        at = tracking.detections.floor_px[marker].mean(axis=0)  # centre of the marker, px
        words = (
            f"Marker {marker} of the floor is {number(error, 1)} px ({number(error * mm_per_px(tracking), 1)} mm) "
            f"from where the "
            "file and the other markers have it."
        )
        first_frame = (0.0, f"marker {marker}")  # the marker does not move, so any frame shows it
        at_px = (float(at[0]), float(at[1]))
        yield Doubt("floor", words, shots=(first_frame,), at_px=at_px, weight=error)


def _floor_moved(tracking: Tracking) -> Iterator[Doubt]:
    """Yield a doubt for each floor marker that moved while the others did not; none if the camera moves."""
    if tracking.camera_moves():
        return
    seen = tracking.detections
    for marker, shifts in seen.floor_shifts_px().items():
        away = {frame: shift for frame, shift in shifts.items() if shift > FLOOR_PX}
        if not away:
            continue
        farthest, frame = max(away.values()), min(away)
        time_s, at = float(seen.time_s[frame]), dict(seen.floor_seen[marker])[frame].mean(axis=0)
        words = (
            f"Marker {marker} of the floor was seen up to {number(farthest, 1)} px "
            f"({number(farthest * mm_per_px(tracking), 1)} mm) from its usual place in {len(away)} of {len(shifts)} "
            f"frames, first at {number(time_s, 1)} s."
        )
        shots, at_px = ((time_s, f"marker {marker}"),), (float(at[0]), float(at[1]))
        yield Doubt("floor", words, time_s=time_s, shots=shots, at_px=at_px, weight=farthest)


def _floor_never_seen(tracking: Tracking) -> Iterator[Doubt]:
    """Yield one doubt about all markers of the floor that were never seen; none if all were seen."""
    missing = [marker for marker in tracking.markers.floor if marker not in tracking.detections.floor_px]
    if missing:
        markers = "marker" if len(missing) == 1 else "markers"
        listed = ", ".join(map(str, missing))
        yield Doubt("floor", f"Never seen: {markers} {listed} of the floor, which the file lists.")


def _sizes(tracking: Tracking) -> Iterator[Doubt]:
    """Yield doubts about robots' markers: those of another size than stated, and those too small in the picture.

    A marker that was never seen has no doubt: its size is NaN, for which no comparison is true. If the lens is fitted
    to the video itself, robots' markers measure what is stated: a wrong size then shows in the floor's markers.
    """
    seen = tracking.detections
    wider_px = floor_wider_px(tracking)
    if abs(wider_px) > WIDER_PX:
        words = (
            f"The sizes stated for the markers of robots and floor do not fit each other: with them, the floor's are "
            f"{number(abs(wider_px), 1)} px {'wider' if wider_px > 0 else 'narrower'} at each edge."
        )
        yield Doubt("size", words, weight=abs(wider_px))
    sizes_m = marker_sizes_m(tracking)
    for i, ((robot, measured_m), edge_px) in enumerate(zip(sizes_m.items(), seen.edge_px(), strict=True)):
        difference = measured_m / tracking.markers.size_m - 1.0  # as a share of the stated size
        if abs(difference) > SIZE_SHARE:
            words = (
                f"Robot {robot}'s marker measures {number(1000 * measured_m, 1)} mm at its stated height, "
                f"{percent(difference, 0, sign=True)} from the {stated(1000 * tracking.markers.size_m)} mm of the file."
            )
            yield Doubt("size", words, robot=robot, weight=abs(difference))
        if edge_px < SMALL_PX:
            # The shot is the frame in which the marker's top edge is shortest.
            frames = np.flatnonzero(np.isfinite(seen.corners_px[:, i, 0, 0]))  # in which the marker was seen
            tops_px = np.linalg.norm(seen.corners_px[frames, i, 1] - seen.corners_px[frames, i, 0], axis=1)
            time_s = float(seen.time_s[frames[int(np.argmin(tops_px))]])
            size = f"{number(edge_px, 1)} px wide (median)"
            words = f"Robot {robot}'s marker is {size}; from {stated(SMALL_PX)} px on it is read well."
            shots = ((time_s, f"{number(tops_px.min(), 0)} px wide"),)
            yield Doubt("small", words, robot=robot, shots=shots, weight=SMALL_PX - edge_px)


def _frames(tracking: Tracking) -> Iterator[Doubt]:
    """Yield one doubt if the times between frames are uneven; else none."""
    time_s = tracking.detections.time_s
    if uneven_frames(time_s) is None:
        return
    steps = np.diff(time_s)
    usual = float(np.median(steps))
    odd = int((np.abs(steps - usual) > UNEVEN * usual).sum())
    longest = int(np.argmax(steps))
    words = (
        f"{odd} of {steps.size} steps between frames {verb(odd, 'differ')} from the usual {number(1000 * usual, 0)} ms "
        f"by more than a fifth; "
        f"the longest is {number(1000 * steps[longest], 0)} ms, at {number(time_s[longest], 1)} s."
    )
    yield Doubt("frames", words, time_s=float(time_s[longest]), weight=float(steps[longest]))


def _unmatched(tracking: Tracking, samples: pl.DataFrame, lone_stops: pl.DataFrame) -> Iterator[Doubt]:
    """Yield doubts about samples and stops that do not match: the kinds sample, late and stop.

    There is no doubt about a sample at a time at which the robot was not seen, about a stop whose end was not seen, and
    about a stop that ends before the first or after the last sample of the log, which may not cover these times.

    Args:
        samples: the log's samples with the stops that they match, ``stops.SAMPLES_MATCHED``.
        lone_stops: the stops that no sample matches, ``stops.STOPS``.
    """
    explained = set()  # robot and end of each stop during which a late sample was logged
    for robot, time_s in samples.filter(pl.col("stop_end_s").is_null()).select("robot", "time_s").iter_rows():
        seen_s = tracking.positions.filter(pl.col("robot") == robot)["time_s"]
        nearest_s = (seen_s - time_s).abs().min()
        if nearest_s is None or float(nearest_s) > GAP_S:
            continue  # before or after the video, or in a gap, which has a doubt of its own
        during = lone_stops.filter(
            (pl.col("robot") == robot) & (pl.col("start_s") <= time_s) & (pl.col("end_s") >= time_s)
        )
        if during.height:
            end_s = float(during["end_s"][0])
            explained.add((robot, end_s))
            words = (
                f"Robot {robot} logged a sample at {number(time_s, 1)} s, in a stop that was seen to end at "
                f"{number(end_s, 1)} s."
            )
            shots_of_late = ((time_s, "the sample"), (end_s, "the end"))
            yield Doubt("late", words, robot=robot, time_s=time_s, shots=shots_of_late)
            continue
        words = f"Robot {robot} logged a sample at {number(time_s, 1)} s, where no stop was seen."
        yield Doubt("sample", words, robot=robot, time_s=time_s, shots=((time_s, "the sample"),))
    # When the first and the last sample of the log were taken; an empty log has no times (None), for which 0 is taken.
    first_s, last_s = (samples["time_s"].min() or 0.0), (samples["time_s"].max() or 0.0)
    for robot, start_s, end_s in (
        lone_stops.filter("end_seen").select("robot", "start_s", "end_s").iter_rows()
    ):
        if first_s <= end_s <= last_s and (robot, end_s) not in explained:
            words = (
                f"Robot {robot} stood from {number(start_s, 1)} to {number(end_s, 1)} s, and the log has no sample "
                f"of it."
            )
            shots = (((start_s + end_s) / 2, "it stands"),)
            yield Doubt("stop", words, robot=robot, time_s=start_s, shots=shots, weight=end_s - start_s)


def floor_residuals(tracking: Tracking) -> dict[int, Floats]:
    """Return the errors of the corners, (4, 2), px, of each floor marker that was seen, by its number.

    An error is the pixel at which a corner was seen minus the pixel to which the fitted camera projects it.
    """
    return {
        # ``sharp_corners`` takes several markers: here it takes one, and gives one back.
        marker: sharp_corners(tracking, corners[None])[0]
        - tracking.camera.project(tracking.markers.floor_corners(marker))
        for marker, corners in tracking.detections.floor_px.items()
    }


def floor_errors_px(residuals_px: Mapping[int, Floats]) -> dict[int, float]:
    """Return the root mean square of the errors of each floor marker's corners (``floor_residuals``), px."""
    return {marker: float(np.sqrt((each**2).sum(axis=1).mean())) for marker, each in residuals_px.items()}


def floor_wider_px(tracking: Tracking) -> float:
    """Return by how much the edges of the floor's markers are seen farther outwards than fitted, px: their median."""
    wider = [
        # A corner moves by ``outwards`` if edges do by a pixel; the square of this vector's length is 2.
        float((residuals_px * outwards(tracking.detections.floor_px[marker][None])[0]).sum(axis=1).mean() / 2)
        for marker, residuals_px in floor_residuals(tracking).items()
    ]
    return float(np.median(wider))


def sharp_corners(tracking: Tracking, corners_px: Floats) -> Floats:
    """Return corners, (markers, 4, 2), px, with the edges moved inwards, as blur and thresholds moved them outwards."""
    return np.asarray(corners_px - tracking.camera.edge_px * outwards(corners_px))


def marker_sizes_m(tracking: Tracking) -> dict[int, float]:
    """Return the median edge of each robot's marker, m, as measured in the video; NaN if the marker was never seen.

    The marker is assumed to be at its stated height.

    Returns: edges by the robot's name, in the order of ``markers.robots``.
    """
    seen, found = tracking.detections.corners_px, {}
    for i, name in enumerate(tracking.markers.robots.values()):
        own = seen[np.isfinite(seen[:, i]).all(axis=(1, 2)), i]
        found[name] = float("nan")
        if len(own):
            corners = tracking.camera.at_height(sharp_corners(tracking, own), tracking.markers.height_m)
            found[name] = float(np.median(edge_lengths(corners)))
    return found


def square_residuals(tracking: Tracking, most: int = 400) -> tuple[Floats, Floats]:
    """Return where robots' markers were seen, and how far their corners are from squares of the median size.

    There is at least one detection: ``marker_detection.detect`` refuses a video without any.

    Args:
        most: how many detections are taken at most.
    Returns: centres, (detections, 2), px, and root mean square errors of their corners, (detections,), mm.
    """
    seen = tracking.detections.corners_px
    corners_px = seen[np.isfinite(seen).all(axis=(2, 3))]
    # Every n-th detection. As n is rounded down, up to twice ``most`` are left; the last ones are then cut off.
    corners_px = corners_px[:: max(len(corners_px) // most, 1)][:most]
    corners = tracking.camera.at_height(corners_px, tracking.markers.height_m)
    errors = square_errors(corners, float(np.median(edge_lengths(corners))))
    return corners_px.mean(axis=1), 1000 * np.sqrt((errors**2).sum(axis=2).mean(axis=1))


def mm_per_px(tracking: Tracking) -> float:
    """Return the width of floor, mm, that a pixel in the middle of the picture covers."""
    width, height = tracking.detections.size_px
    # Two points, a pixel apart, and the places on the floor that are seen there.
    middle = np.array([[width / 2, height / 2], [width / 2 + 1.0, height / 2]])
    at = tracking.camera.at_height(middle, 0.0)
    return 1000 * float(np.linalg.norm(at[1] - at[0]))


def place_px(tracking: Tracking, robot: int, time_s: float) -> tuple[Floats, float] | None:
    """Return the centre, (2,), px, and the top edge, px, of a robot's marker where it was seen nearest in time.

    Args:
        time_s: on the clock of this video.
    Returns: None if the robot was never seen.
    """
    names = list(tracking.markers.robots.values())
    if robot not in names:
        return None
    own = tracking.detections.corners_px[:, names.index(robot)]
    there = np.flatnonzero(np.isfinite(own).all(axis=(1, 2)))
    if not there.size:
        return None
    nearest = own[there[int(np.argmin(np.abs(tracking.detections.time_s[there] - time_s)))]]
    return nearest.mean(axis=0), float(np.linalg.norm(nearest[1] - nearest[0]))
