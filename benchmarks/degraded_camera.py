"""Degrade a rendered video as phones do, and print what is found of it, how well, and what the user is told.

    PYTHONPATH=tests python benchmarks/degraded_camera.py --seconds 20

Rows of a table: the share of robots' markers found by OpenCV's detector alone and by ``lab track``, the error of
places, and the kinds of doubts and warnings. It needs the extra ``camera`` alone. Where PyAV is installed too (``pip
install av``), videos are H.264; otherwise they are MPEG-4, as OpenCV writes them, and rows of H.264's rates are left
out.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from importlib import import_module
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from helpers.mp4_boxes import units_per_s, with_steps
from helpers.rehearsal import write_chessboard
from helpers.scene import Look, Scene, poses_at, scene_of
from helpers.video_writer import VideoWriter
from vibroswarm import preset, simulate
from vibroswarm.errors import InputError
from vibroswarm.result import Result
from vibroswarm.tracking.camera import lens_from_chessboard
from vibroswarm.tracking.doubts import doubts_of
from vibroswarm.tracking.markers import Markers, dictionary_of, usual_markers
from vibroswarm.tracking.track import Tracking, track
from vibroswarm.tracking.video_file import frames_of

Floats = NDArray[np.float64]
Gray = NDArray[np.uint8]
RATE = 15.0
LOOK = Look(size_px=(1280, 720), frames_per_s=RATE, hands_per_min=0.0)
AV: Any = import_module("av") if find_spec("av") else None
USUAL_CRF = 18
INSTANTS = 7
"""Instants of a long exposure at which robots are drawn."""
BANDS = 4
"""Parts of a frame that a rolling shutter takes one after the other."""


@dataclass(frozen=True)
class Bad:
    """What is bad about a video."""

    name: str
    look: Look = LOOK
    change: Callable[[Gray, np.random.Generator], Gray] = lambda frame, chance: frame
    crf: int = USUAL_CRF
    """H.264's constant rate factor; a phone's own file is about 20."""
    readout_s: float = 0.0
    """Time from the first to the last row of a rolling shutter."""
    uneven: bool = False
    """Whether frames are left out, and the others are late, at random."""


def shaken(frame: Gray, chance: np.random.Generator, most_px: float = 4.0) -> Gray:
    """Blur a frame along a line in a random direction, as an exposure with an unsteady camera does."""
    length, angle = most_px, chance.uniform(0.0, np.pi)
    kernel = np.zeros((15, 15), dtype=np.float32)
    for at in np.linspace(-0.5, 0.5, 61):
        x, y = 7 + at * length * np.cos(angle), 7 + at * length * np.sin(angle)
        kernel[round(y), round(x)] += 1.0
    return np.asarray(cv2.filter2D(frame, -1, kernel / kernel.sum()))


def wobbling(frame: Gray, chance: np.random.Generator, most_px: float = 2.0) -> Gray:
    """Shift each row of a frame as a rolling shutter does of a camera that vibrates."""
    rows, columns = np.indices(frame.shape, dtype=np.float32)
    wave = most_px * np.sin(2 * np.pi * (rows / frame.shape[0] + chance.uniform()))
    return np.asarray(cv2.remap(frame, columns + wave.astype(np.float32), rows, cv2.INTER_LINEAR))


def glaring(frame: Gray, chance: np.random.Generator) -> Gray:
    """Add the reflections of three lamps on glossy markers and floor; they stay where they are."""
    rows, columns = np.indices(frame.shape)
    bright = frame.astype(np.float64)
    for across, down in ((0.4, 0.35), (0.6, 0.5), (0.45, 0.75)):
        away = np.hypot(columns - across * frame.shape[1], rows - down * frame.shape[0])
        bright += 400.0 * np.exp(-0.5 * (away / (0.05 * frame.shape[0])) ** 2)
    return np.clip(bright, 0, 255).astype(np.uint8)


def dark(frame: Gray, chance: np.random.Generator) -> Gray:
    """Take light off a frame, down to a tenth, and add the noise of a sensor in the dark."""
    return np.clip(0.1 * frame + chance.normal(0.0, 4.0, frame.shape), 0, 255).astype(np.uint8)


def bad_phone(frame: Gray, chance: np.random.Generator) -> Gray:
    """Do several of these at once."""
    return shaken(glaring(wobbling(frame, chance, 1.0), chance), chance, 3.0)


CASES = (
    Bad("as rendered"),
    Bad("exposed for 60 ms", replace(LOOK, exposure_s=0.06)),
    Bad("motion blur: camera moves by 4 px in an exposure", change=shaken),
    Bad("the same, by 6 px", change=lambda frame, chance: shaken(frame, chance, 6.0)),
    Bad("rolling shutter of 30 ms", readout_s=0.03),
    Bad("the same, camera vibrates by 2 px", readout_s=0.03, change=wobbling),
    Bad("reflections of three lamps", change=glaring),
    Bad("H.264 at crf 30", crf=30),
    Bad("H.264 at crf 38", crf=38),
    Bad("H.264 at crf 45", crf=45),
    Bad("variable frame rate", uneven=True),
    Bad("out of focus by 1.5 px", replace(LOOK, blur_px=1.5)),
    Bad("out of focus by 3 px", replace(LOOK, blur_px=3.0)),
    Bad("a tenth of the light", change=dark),
    Bad("640 x 360", replace(LOOK, size_px=(640, 360))),
    Bad("motion 3 px, glare, shutter, crf 30, uneven", change=bad_phone, readout_s=0.03, crf=30, uneven=True),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--marker-mm", type=float, default=34.0)
    parser.add_argument("--case", default="", help="only cases whose name has these words")
    given = parser.parse_args()
    scenario = preset("paper").with_values({"run.t_end_s": given.seconds, "floor.source": "random:0.48"})
    result = simulate(scenario, given.seed, 1, poses=True)
    markers = usual_markers(scenario.swarm.robots, 1.0, 1.0, size_mm=given.marker_mm)
    print("| | detector alone | found | place, median | 95 % | what is told |")
    print("|---|---|---|---|---|---|")
    for case in (case for case in CASES if given.case in case.name and (AV or case.crf == USUAL_CRF)):
        with TemporaryDirectory() as folder:
            print(f"| {case.name} | {row(case, result, markers, Path(folder))} |", flush=True)


def row(case: Bad, result: Result, markers: Markers, folder: Path) -> str:
    """Render, degrade and track a video; return the cells of its row."""
    scene = scene_of(result, 0, markers, case.look, seed=1)
    write_chessboard(scene, folder / "board.avi")
    lens, _ = lens_from_chessboard(folder / "board.avi", (9, 6))
    video = folder / "session.mp4"
    times_s, poses = write_video(case, scene, result, video)
    alone = by_detector_alone(video, markers)
    try:
        tracking = track(video, markers, lens=lens)
    except InputError as error:
        return f"{alone:.1%} | - | - | - | {str(error).split(': ', 1)[1]}"
    assert tracking.detections.time_s.size == times_s.size
    away_mm = 1000 * errors_m(tracking, times_s, poses)
    return (
        f"{alone:.1%} | {tracking.share_found():.1%} | {np.median(away_mm):.2f} mm | "
        f"{np.quantile(away_mm, 0.95):.2f} mm | {told(tracking)}"
    )


def write_video(case: Bad, scene: Scene, result: Result, video: Path) -> tuple[Floats, Floats]:
    """Write the degraded video; return the frames' times, s, and the poses (frames, robots, 3) at these times."""
    chance = np.random.default_rng(7)
    end_s = float(result.ends["end_s"].max() or 0.0)  # type: ignore[arg-type]
    times_s = np.arange(0.1, end_s - 0.2, 1.0 / RATE)
    if case.uneven:
        times_s = times_s[chance.random(times_s.size) > 0.3]
        times_s = times_s + chance.uniform(0.0, 0.4 / RATE, times_s.size)
    robots = len(scene.markers.robots)
    pictures = (case.change(drawn(case, scene, result, time_s), chance) for time_s in times_s.tolist())
    write = write_h264 if AV else write_mpeg4
    write(pictures, times_s - times_s[0], case, video)
    return times_s - times_s[0], poses_at(result, 0, robots, times_s)


def write_h264(pictures: Iterator[Gray], times_s: Floats, case: Bad, video: Path) -> None:
    """Write frames with the rate of the case, at their times in whole ms."""
    with AV.open(str(video), "w") as file:
        stream = file.add_stream("libx264", rate=1000, options={"crf": str(case.crf)})
        stream.width, stream.height = case.look.size_px
        stream.pix_fmt, stream.time_base = "yuv420p", Fraction(1, 1000)
        for picture, time_s in zip(pictures, times_s.tolist(), strict=True):
            frame = AV.VideoFrame.from_ndarray(picture, format="gray").reformat(format="yuv420p")
            frame.pts, frame.time_base = round(1000 * time_s), Fraction(1, 1000)
            file.mux(stream.encode(frame))
        file.mux(stream.encode())


def write_mpeg4(pictures: Iterator[Gray], times_s: Floats, case: Bad, video: Path) -> None:
    """Write frames at an even rate, then say in the file how long each lasts."""
    rate = (times_s.size - 1) / times_s[-1]
    with VideoWriter(video, case.look.size_px, rate) as writer:
        for picture in pictures:
            writer.write(picture)
    if case.uneven:
        data = video.read_bytes()
        ticks = np.round(np.append(times_s, times_s[-1] + 1 / rate) * units_per_s(data)).astype(int)
        video.write_bytes(with_steps(data, np.diff(ticks).tolist()))


def drawn(case: Bad, scene: Scene, result: Result, time_s: float) -> Gray:
    """Draw the frame at a time, band after band if the shutter rolls; its middle row is of that time."""
    robots, half_s = len(scene.markers.robots), case.look.exposure_s / 2
    # A scene draws a moving robot at both ends of an exposure; long ones are put together from shorter ones.
    many = 2 if case.look.exposure_s <= LOOK.exposure_s else INSTANTS
    bands = BANDS if case.readout_s else 1
    parts = []
    for band in range(bands):
        middle_s = time_s + case.readout_s * ((band + 0.5) / bands - 0.5)
        instants = poses_at(result, 0, robots, np.linspace(middle_s - half_s, middle_s + half_s, many))
        taken = [scene.frame(time_s, begin, end)[0] for begin, end in pairwise(instants)]
        parts.append(np.array_split(np.mean(taken, axis=0).astype(np.uint8), bands)[band])
    return np.concatenate(parts)


def by_detector_alone(video: Path, markers: Markers) -> float:
    """Return the share of robots' markers that OpenCV's detector finds, with its default settings."""
    detector = cv2.aruco.ArucoDetector(dictionary_of(markers.dictionary))
    seen = [detector.detectMarkers(frame)[1] for _, frame in frames_of(video)]
    return float(np.mean([[ids is not None and marker in ids for marker in markers.robots] for ids in seen]))


def errors_m(tracking: Tracking, times_s: Floats, poses: Floats) -> Floats:
    """Return the distances of the positions found from the true ones, (positions,), m."""
    frame = np.searchsorted(tracking.detections.time_s, tracking.positions["time_s"].to_numpy())
    true = poses[frame, tracking.positions["robot"].to_numpy()]
    return np.hypot(*(tracking.positions.select("x_m", "y_m").to_numpy() - true[:, :2]).T)


def told(tracking: Tracking) -> str:
    """Return what the user is told: kinds of doubts with their numbers, and the beginnings of warnings."""
    kinds = doubts_of(tracking)["kind"].to_list()
    counted = [f"{kind} ({kinds.count(kind)})" for kind in dict.fromkeys(kinds)]
    warned = [words.split(": ")[0].split("; ")[0] for words in tracking.warnings()]
    return "; ".join(counted + warned) or "nothing is doubtful"


if __name__ == "__main__":
    main()
