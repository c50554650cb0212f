"""What is doubtful in a tracking, and the page that shows it: each doubt is there with its cause, and not without."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from helpers.video_writer import VideoWriter
from vibroswarm.documents.tracking import tracking_document
from vibroswarm.show.page import page_html
from vibroswarm.tracking import track
from vibroswarm.tracking.camera import Camera, Lens, matrix_of, outwards
from vibroswarm.tracking.doubt_frames import FRAMES_UP_TO, chosen, shots_of
from vibroswarm.tracking.doubts import ADVICE, TITLES, Doubt, doubts_of
from vibroswarm.tracking.marker_detection import Detections
from vibroswarm.tracking.markers import Markers, corners_at, usual_markers
from vibroswarm.tracking.stops import ClockOffset, match_samples, stops_of
from vibroswarm.tracking.track import POSITIONS, TrackedLog, Tracking

cv2 = pytest.importorskip("cv2")
SIZE, RATE, SECONDS = (640, 480), 10.0, 20.0
LENS = Lens(matrix_of(560.0, np.array([319.5, 239.5])), np.zeros(5), 0.1)
CAMERA = Camera(LENS, np.diag([1.0, -1.0, -1.0]), np.array([0.5, 0.5, 1.4]), 0.2, True)
MARKERS = usual_markers(2, 1.0, 1.0, size_mm=60, height_mm=30)


OF_DETECTIONS = ("floor_seen", "twice", "unexpected", "samples")


def floor_moving(by_px: Mapping[int, Sequence[float]]) -> dict[int, list[tuple[int, Any]]]:
    """Floor markers in frames 0, 4, ..., some of them to the right of their place by so many pixels in each frame."""
    at = {marker: CAMERA.project(MARKERS.floor_corners(marker)) for marker in MARKERS.floor}
    return {
        marker: [(4 * k, four + np.array([px, 0.0])) for k, px in enumerate(by_px.get(marker, [0.0]))]
        for marker, four in at.items()
    }


def tracking_of(
    folder: Path,
    change: Callable[[np.ndarray[Any, Any]], None] = lambda corners: None,
    *,
    markers: Markers = MARKERS,
    time_s: np.ndarray[Any, Any] | None = None,
    **more: Any,
) -> Tracking:
    """Two robots that drive to the right at 3 cm/s and stand from 5 to 8 s, as a camera straight above saw them."""
    time_s = np.arange(0.0, SECONDS, 1 / RATE) if time_s is None else time_s
    driven_s = time_s - np.clip(time_s - 5, 0, 3)
    corners = np.stack(
        [
            np.stack(
                [
                    CAMERA.project(corners_at(0.1 + 0.03 * s, 0.3 + 0.3 * robot, np.pi / 2, 0.06, 0.03))
                    for robot in range(2)
                ]
            )
            for s in driven_s.tolist()
        ]
    )
    change(corners)
    seen = Detections(SIZE, time_s, corners, floor_moving({}), 5)
    seen = replace(seen, **{k: v for k, v in more.items() if k in OF_DETECTIONS})
    tables, stops = [], []
    for robot in range(2):
        there = np.isfinite(corners[:, robot, 0, 0])
        at = CAMERA.at_height(corners[there, robot].mean(axis=1), 0.03)
        columns = [np.full(there.sum(), robot), time_s[there], at[:, 0], at[:, 1], np.zeros(there.sum())]
        tables.append(pl.DataFrame(dict(zip(POSITIONS, columns, strict=True)), schema=POSITIONS))
        stops.append(stops_of(robot, time_s[there], at[:, 0], at[:, 1], np.zeros(there.sum())))
    dropped = more.get("dropped", pl.DataFrame(schema=POSITIONS))
    video = folder / "the <b>video.avi"
    return Tracking(video, markers, CAMERA, seen, pl.concat(tables), pl.concat(stops), dropped)


def kinds_of(tracking: Tracking) -> list[str]:
    return list(dict.fromkeys(doubt.kind for doubt in doubts_of(tracking)))


def test_a_tracking_without_problems_has_no_doubts(tmp_path: Path) -> None:
    good = tracking_of(tmp_path)
    assert kinds_of(good) == []
    assert tracking_document(good).answer[1] == "Nothing is doubtful."
    assert good.stops.height == 2


def test_places_that_depend_on_the_sizes_of_markers_are_warned_of(tmp_path: Path) -> None:
    good = tracking_of(tmp_path)
    assert good.warnings() == []
    (words,) = replace(good, camera=replace(CAMERA, place_error_m=0.0054, calibrated=False)).warnings()
    assert words.startswith("Robots' places may be off by 5 mm")
    assert "--camera-height" in words
    height = "If the camera is not that high, check the stated sizes and heights of the markers."
    assert height not in tracking_document(good).parts[0].words
    assert height in tracking_document(replace(good, camera=replace(CAMERA, calibrated=False))).parts[0].words
    (words,) = replace(good, camera=replace(CAMERA, place_error_m=0.0054)).warnings()
    assert "known no better by the 4 floor markers seen" in words


def hide(corners: np.ndarray[Any, Any]) -> None:
    corners[100:130, 1] = np.nan


def stand(corners: np.ndarray[Any, Any]) -> None:
    corners[:, 1] = corners[0, 1]


def carry(corners: np.ndarray[Any, Any]) -> None:
    corners[150:, 0] += np.array([120.0, 0.0])


def shrink(corners: np.ndarray[Any, Any]) -> None:
    centre = corners.mean(axis=2, keepdims=True)
    corners[:] = centre + 0.6 * (corners - centre)


UNEVEN = np.concatenate([np.arange(0, 10, 0.1), np.arange(10.5, 20, 0.1)])
AWAY = floor_moving({46: [5.7]})
KICKED = floor_moving({marker: [0.0] * 4 + [9.0 * (marker == 47)] * 3 for marker in MARKERS.floor})
LARGER = replace(MARKERS, size_m=0.07)
WIDER = {
    marker: [(0, seen[0][1] + 0.6 * outwards(seen[0][1][None])[0])]
    for marker, seen in floor_moving({}).items()
}
DROPPED = pl.DataFrame([(1, 3.0, 0.9, 0.9, 0.0)], schema=POSITIONS, orient="row")


GLARE = np.full((480, 640), 200, dtype=np.uint8)
GLARE[:, 200:320] = 255


AT = CAMERA.project(corners_at(0.5, 0.5, 0.0, 0.06, 0.0))
STILL, MOVING = ({17: [(0, AT), (75, AT + away_px)]} for away_px in (1.0, 90.0))


@pytest.mark.parametrize(
    ("kinds", "given", "words"),
    [
        (["gap"], {"change": hide}, "Robot 1 was not seen from 9.9 to 13.0 s"),
        (
            ["gap"],
            {"change": hide, "samples": (GLARE, GLARE)},
            "where the picture is white, as in a reflection",
        ),
        (["still"], {"change": stand}, "Robot 1 never left its place in the 20 s in which it was seen"),
        (["carried"], {"change": carry}, "Robot 0 moved 2"),
        (["size", "small"], {"change": shrink}, "Robot 0's marker measures 36.0 mm"),
        (["size"], {"markers": LARGER}, "-14 % from the 70 mm"),
        (["size"], {"floor_seen": WIDER}, "with them, the floor's are 0.6 px wider at each edge"),
        (["floor"], {"floor_seen": AWAY}, "Marker 46 of the floor is 5.7 px"),
        (
            ["floor"],
            {"floor_seen": KICKED},
            "up to 9.0 px (22.5 mm) from its usual place in 3 of 7 frames, first at 1.6 s",
        ),
        (["floor"], {"floor_seen": {46: floor_moving({})[46]}}, "Never seen: markers 47, 48, 49"),
        (["frames"], {"time_s": UNEVEN}, "the longest is 600 ms, at 9.9 s"),
        (["twice"], {"twice": ((30, 1), (31, 1))}, "robot 1's marker 1 two were seen at once in 2"),
        (["unexpected"], {"unexpected": STILL}, "2 of 5 frames searched whole, always at the same place"),
        (["unexpected"], {"unexpected": MOVING}, "2 of 5 frames searched whole, at several places"),
        ([], {"unexpected": {17: STILL[17][:1]}}, ""),
        (["jump"], {"dropped": DROPPED}, "Robot 1 was read at (0.900, 0.900) m at 3.0 s"),
    ],
)
def test_each_doubt_is_found_with_its_place(tmp_path: Path, kinds: list[str], given: Any, words: str) -> None:
    tracking = tracking_of(tmp_path, **given)
    found = doubts_of(tracking)
    assert list(dict.fromkeys(doubt.kind for doubt in found)) == kinds
    assert any(words in doubt.words for doubt in found) or not kinds, [doubt.words for doubt in found]
    assert all(doubt.kind in ADVICE and doubt.kind in TITLES for doubt in found)


def test_a_robot_that_is_seen_late_has_a_gap_before(tmp_path: Path) -> None:
    def hide_first(corners: np.ndarray[Any, Any]) -> None:
        corners[:30, 1] = np.nan

    tracking = tracking_of(tmp_path, hide_first)
    assert tracking.gaps().rows() == [(1, 0.0, pytest.approx(3.0))]
    assert tracking.share_found() == pytest.approx(1.0 - 30 / 400)


def test_the_smallest_marker_is_named_first(tmp_path: Path) -> None:
    def shrink_one_more(corners: np.ndarray[Any, Any]) -> None:
        shrink(corners)
        shrink(corners[:, 1:])

    found = doubts_of(tracking_of(tmp_path, shrink_one_more))
    assert [doubt.robot for doubt in found if doubt.kind == "small"] == [1, 0]


def test_dropped_positions_are_linked_to_a_camera_that_moves(tmp_path: Path) -> None:
    pushed = [floor_moving(dict.fromkeys(MARKERS.floor, [0.0] * 40 + [px] * 4)) for px in (0.2, 2.0)]
    fixed, moving = (tracking_of(tmp_path, floor_seen=floor, dropped=DROPPED) for floor in pushed)
    dropped = "1 position dropped because a robot cannot move so fast"
    assert f"{dropped}." in tracking_document(fixed).answer[0]
    assert "(by 2.0 px, most at 16.0 s): the camera moves" in moving.warnings()[0]
    assert f"{dropped} (but the camera moves)." in tracking_document(moving).answer[0]


def test_samples_and_stops_are_matched_once_each_and_the_others_are_named(tmp_path: Path) -> None:
    tracking = tracking_of(tmp_path)
    ends = tracking.stops["end_s"].to_list()
    offset = ClockOffset(100.0, 0.01, 2, 4)
    taken = [102.0, 100 + ends[0] + 0.02, 100 + ends[0] + 0.3, 106.5]
    samples = pl.DataFrame({"robot": [0, 0, 0, 1], "time_s": taken})
    matched, lone = match_samples(tracking.stops, samples, offset)
    assert matched.drop_nulls().select("robot", "stop_end_s").rows() == [(0, ends[0])]
    assert matched.drop_nulls()["residual_s"][0] == pytest.approx(0.02)
    due_sooner, _ = match_samples(
        tracking.stops, samples, ClockOffset(100.02, 0.01, 2, 4, control_period_s=0.02)
    )
    assert due_sooner.drop_nulls()["residual_s"][0] == pytest.approx(0.02)
    assert lone["robot"].to_list() == [1]
    found = {doubt.kind: doubt.words for doubt in doubts_of(tracking, matched, lone)}
    assert found["late"].startswith("Robot 1 logged a sample at 6.5 s, in a stop that was seen to end at 8.")
    assert [
        doubt.time_s for doubt in doubts_of(tracking, matched, lone) if doubt.kind == "sample"
    ] == pytest.approx([2.0, ends[0] + 0.3])
    assert "stop" not in found
    matched, lone = match_samples(tracking.stops, samples.filter(pl.col("time_s") != 106.5), offset)
    assert {doubt.kind for doubt in doubts_of(tracking, matched, lone)} == {"sample", "stop"}
    around = pl.DataFrame({"robot": [0, 0], "time_s": [101.0, 119.0]})
    matched, lone = match_samples(tracking.stops, around, offset)
    shorter = lone.with_columns(pl.col("start_s") + pl.when(pl.col("robot") == 0).then(1.0).otherwise(0.0))
    found = doubts_of(tracking, matched, shorter)
    assert [doubt.robot for doubt in found if doubt.kind == "stop"] == [1, 0]  # the longest first


def test_samples_get_the_places_that_the_camera_saw_and_none_in_gaps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Taken before the video, at 16 cm, halfway between two frames, in a gap of 2 s, and after the video."""
    tracking = tracking_of(tmp_path)
    hidden = pl.col("time_s").is_between(12.0, 14.0) & (pl.col("robot") == 1)
    west = pl.Series(np.resize([3.1, -3.1], tracking.positions.height))
    positions = tracking.positions.with_columns(heading_rad=west).filter(~hidden)
    tracking = replace(tracking, positions=positions)
    monkeypatch.setattr(track, "clock_offset", lambda *_: ClockOffset(100.0, 0.01, 2, 4))
    samples = pl.DataFrame({"robot": 1, "time_s": [99.0, 102.0, 103.05, 113.0, 121.0], "energy": 1.0})
    found = track.with_positions(tracking, samples, "log.csv")
    assert (found.outside, found.unseen) == (2, 1)
    assert found.log.samples["time_s"].to_list() == [102.0, 103.05]
    assert found.log.samples["x_m"].to_list() == pytest.approx([0.16, 0.1915], abs=1e-6)
    assert found.log.samples["y_m"].to_list() == pytest.approx([0.6, 0.6], abs=1e-6)
    assert found.log.samples["heading_rad"].abs().min() > 3.0
    assert found.log.tracks["time_s"].min() == pytest.approx(100.0)  # by the log's clock


def test_robots_head_where_their_markers_say(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The markers' upper edges point up, and the robots drive to the right, clockwise from there."""
    seen = tracking_of(tmp_path).detections
    monkeypatch.setattr(track, "detect", lambda *_, **__: seen)
    monkeypatch.setattr(track, "fit_camera", lambda *_, **__: CAMERA)
    found = track.track(tmp_path / "video.avi", replace(MARKERS, forward_rad=-np.pi / 2)).positions
    assert found["heading_rad"].to_numpy() == pytest.approx(0.0, abs=1e-6)


def test_frames_are_bounded_and_every_kind_has_some() -> None:
    doubts = [Doubt("gap", "", 0, 1.0, ((1.0, "a"), (2.0, "b"))) for _ in range(100)]
    doubts += [Doubt("stop", "", 0, 1.0, ((1.0, "a"),)) for _ in range(100)] + [Doubt("floor", "")]
    found = chosen(doubts)
    assert sum(len(doubts[number].shots) for number in found) <= FRAMES_UP_TO
    assert {doubts[number].kind for number in found} == {"gap", "stop"}
    assert [number for number in found if number < 4] == [0, 1, 2, 3]


def white_video(path: Path, frames: int) -> None:
    with VideoWriter(path, SIZE, RATE) as writer:
        for k in range(frames):
            writer.write(np.full(SIZE[::-1], k, dtype=np.uint8))


def test_frames_are_cut_where_they_should_be(tmp_path: Path) -> None:
    tracking = tracking_of(tmp_path, hide)
    white_video(tracking.video, 200)
    doubts = doubts_of(tracking)
    shots = shots_of(tracking, doubts)
    assert [shot.words for shot in shots] == ["9.9 s, seen last", "11.4 s, in between", "13.0 s, seen again"]
    for shot, grey in zip(shots, (99, 114, 130), strict=True):
        picture = cv2.imdecode(np.frombuffer(shot.jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
        assert picture.shape == (300, 300)
        assert abs(int(np.median(picture)) - grey) <= 3  # the grey level is the frame's number
    tracking.video.unlink()
    assert shots_of(tracking, doubts) == []


@pytest.mark.usefixtures("empty_pictures")
def test_the_page_begins_with_the_answer_and_escapes_names(tmp_path: Path) -> None:
    tracking = tracking_of(tmp_path, hide)
    white_video(tracking.video, 200)
    samples = pl.DataFrame({"robot": [0, 1], "time_s": [108.0, 108.0]})
    log: Any = None
    tracked = TrackedLog(log, ClockOffset(100.0, 4e-6, 2, 2), 0, 0)
    document = tracking_document(tracking, tracked, samples)
    assert document.data["doubts"]["kind"].to_list() == ["gap"]
    page = page_html(document)
    assert "<b>video" not in page
    assert page.count("<img ") == page.count("data:image/jpeg;base64,") == 3
    assert document.answer[1] == "Doubtful: robots that were lost (1)."
    first = page[page.index("<h1>") : page.index("<h2")]
    assert first.index("Doubtful: robots that were lost (1).") < first.index("clock is +100.000")
    clock = "(standard error 0.1 ms, to which the time from a sample to the robot's start adds some 20 ms)"
    assert clock in unescape(first).replace("\N{NO-BREAK SPACE}", " ")
    assert "before time 0" not in first
    early = replace(
        tracked, offset=ClockOffset(-5.0, 4e-6, 2, 2)
    )  # as with timestamps: the log begins at 5 s
    words = page_html(tracking_document(tracking, early, samples))
    assert "and the video's first 5.0 s, before time 0" in unescape(words).replace("\N{NO-BREAK SPACE}", " ")
    for words in (
        "What to do:",
        "Where robots were seen",
        "When robots were seen",
        "Clocks of",
        "Lens and markers",
    ):
        assert words in page
    assert page.count('class="drawing"') == 4
