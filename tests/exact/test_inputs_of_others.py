"""Files as people have them are read with the right values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from vibroswarm.floors.floor import Floor
from vibroswarm.inspection.inspection import inspect
from vibroswarm.lab.acceleration import computed
from vibroswarm.lab.spectrum import spectra_of
from vibroswarm.lab.tracking.camera import fit_camera, outwards
from vibroswarm.lab.tracking.marker_detection import has_rim
from vibroswarm.lab.tracking.markers import corners_at, dictionary_of, usual_markers
from vibroswarm.lab.tracking.track import track
from vibroswarm.recordings.assemble_recording import recording_of
from vibroswarm.recordings.floor_fit import floor_fits, turned
from vibroswarm.recordings.read import read_log
from vibroswarm.robot.sensing import SenseProgram
from vibroswarm.scenario.scenario import preset

Case = Callable[[Path], tuple[Any, Any]]
"""Write a file into a folder, and return what is read of it, and the right value."""
TABLE = {"robot": [3, 3, 4], "time_s": [0.5, 2.5, 2.5], "x_m": [0.25, 0.5, 0.75], "y_m": [0.125, 0.25, 0.5],
         "energy": [1.5, None, 0.25]}  # fmt: skip
ROWS = [(3, 0.5, 0.25, 0.125, 1.5), (4, 2.5, 0.75, 0.5, 0.25), (3, 2.5, 0.5, 0.25, None)]
"""The samples of ``TABLE``, and then its tracked positions."""


def log(text: str, right: list[tuple[Any, ...]] = ROWS, **more: Any) -> Case:
    def case(folder: Path) -> tuple[Any, Any]:
        (folder / "log.csv").write_text(text, encoding="utf-8")
        return rows_of(folder / "log.csv", more) == right, True

    return case


def rows_of(path: Path, counts: dict[str, int]) -> list[tuple[Any, ...]]:
    found = read_log(path)
    assert {name: found.counts[name] for name in counts} == counts
    tracks = found.tracks.with_columns(energy=pl.lit(None, pl.Float64))
    return [row for part in (found.samples, tracks) for row in part.select(list(TABLE)).rows()]


def one_for_each_robot(folder: Path) -> tuple[Any, Any]:
    for name, robot in (("r10.csv", 4), ("r2.csv", 3)):
        frame = pl.DataFrame(TABLE).filter(robot=robot).drop("robot")
        frame.write_csv(folder / name)
    return rows_of(folder, {"samples": 2}), [(robot - 3, *rest) for robot, *rest in ROWS]


def changed(**columns: Any) -> str:
    return pl.DataFrame(TABLE | columns).write_csv()


def shaken(
    axes: tuple[float, float, float],
    gravity: float = 9.80665,
    hz: float = 80.0,
    rate_hz: float = 1000.0,
    stops: int = 8,
) -> pl.DataFrame:
    """Readings of stops of 0.6 s with a pause, shaken by a sine along each axis."""
    random, t = np.random.default_rng(3), np.arange(int(0.6 * rate_hz)) / rate_hz
    parts = []
    for stop in range(stops):
        wave = np.sin(2 * np.pi * (hz * t + random.random()))
        noise = 0.02 * random.standard_normal((3, t.size))
        values = np.array(axes)[:, None] * wave + noise + np.array([0.0, 0.0, gravity])[:, None]
        parts.append(
            pl.DataFrame(
                {"robot": 0, "time_s": 2.0 * stop + t, **dict(zip(("ax", "ay", "az"), values, strict=True))}
            )
        )
    return pl.concat(parts)


def spectrum(frame: pl.DataFrame, right: tuple[Any, ...] = (80, 1.0, "z", "m/s²", 1000), **how: Any) -> Case:
    """Frequency and amplitude of the only line, axis, unit and rate."""

    def case(folder: Path) -> tuple[Any, Any]:
        frame.write_csv(folder / "acceleration.csv")
        found = spectra_of(folder / "acceleration.csv", by=(), **how)
        line, *_ = found.whole.lines
        said = [word for word in how_said if word in " ".join(found.warnings)]
        rounded = (round(line.hz), round(line.amplitude, 1), found.axis, found.unit, round(found.rate_hz))
        return (rounded, said), (right, how_said)

    how_said = how.pop("said", [])
    return case


def polled(every: int) -> pl.DataFrame:
    frame = shaken((0.0, 0.0, 1.0))
    held = [pl.col(axis).gather(pl.int_range(pl.len()) // every * every) for axis in ("ax", "ay", "az")]
    return frame.with_columns(held)


def energies(frame: pl.DataFrame, right: float) -> Case:
    def case(folder: Path) -> tuple[Any, Any]:
        frame.write_csv(folder / "acceleration.csv")
        times = frame.filter(pl.col("time_s").diff().fill_null(0.0) > 1.0)["time_s"].to_list()
        ends = [time - 2.0 + 0.6 - 1 / 350.0 for time in times]
        pl.DataFrame({"robot": 0, "time_s": ends, "x_m": 0.5, "y_m": 0.5, "energy": 1.0}).write_csv(
            folder / "log.csv"
        )
        found = computed(read_log(folder / "log.csv"), folder / "acceleration.csv", SenseProgram())
        return float(found.log.samples["energy"].mean()), pytest.approx(right, rel=0.02)  # type: ignore[arg-type]

    return case


def inspected_bits(folder: Path) -> tuple[Any, Any]:
    """Rates of wrong bits by which a log of bits is inspected, and whether its map is right."""
    ground, _ = logged_bits(folder, "observation")
    recording = recording_of([read_log(folder / "log.csv")], ground, preset("paper"))
    found = inspect(recording, bits=True)
    (_, still), (vibrating, _) = found.samples.law.sensor.params.rates
    pooled = found.maps.filter(pl.col("robot").is_null())
    right = (pooled["vibrating"].to_numpy() > 0.5) == (ground.tiles.ravel() == 1)
    return ((still, vibrating), right.all()), (pytest.approx((0.2, 0.2), abs=0.05), True)


def logged_bits(folder: Path, name: str) -> tuple[Floor, pl.DataFrame]:
    ground, random = Floor.filling([[0, 1, 0], [1, 1, 0], [0, 0, 0], [1, 0, 0]]), np.random.default_rng(1)
    x_m, y_m = random.random((2, 600)) * 0.99 + 0.005
    read = ground.tiles.ravel()[ground.tile_at(x_m, y_m)] ^ (random.random(600) < 0.2)
    frame = pl.DataFrame({"time_s": np.arange(600) / 2, "x_m": x_m, "y_m": y_m, name: read})
    frame.write_csv(folder / "log.csv")
    return ground, frame


def bits(as_energies: bool, mirrored: bool) -> Case:
    """Whether a floor fits the bits that were read on it."""

    def case(folder: Path) -> tuple[Any, Any]:
        ground, _ = logged_bits(folder, "energy" if as_energies else "observation")
        tested = Floor.filling(turned(ground.tiles, "mirrored left to right")) if mirrored else ground
        samples = read_log(folder / "log.csv").samples
        fits = {fit.orientation: fit.probability for fit in floor_fits(tested, samples)}
        return fits["as it is"] < 0.01, not mirrored

    return case


def spare_print(folder: Path) -> tuple[Any, Any]:
    """Share of frames in which a robot is found, and whether its places are right, beside a print that lies still."""
    drawn, cv2 = pytest.importorskip("helpers.drawn_video"), pytest.importorskip("cv2")
    frames = drawn.frames(60)
    for k, frame in enumerate(frames):
        drawn._paste(frame[..., 0], 0, 0.3, 0.5, 30)
        if 20 < k < 30:  # somebody's hand
            frame[280:350, 150:260] = 90
        frame[..., 1] = frame[..., 2] = frame[..., 0]
    drawn.write(folder / "spare.avi", frames)
    found = track(folder / "spare.avi", replace(drawn.MARKERS, floor_size_m=0.05))
    own = found.positions.filter(robot=0)
    right = 0.2 + (own["time_s"] * drawn.RATE) / drawn.PX_PER_M
    return own.height > 45, float((own["x_m"] - right).abs().max()) < 0.002 and cv2 is not None  # type: ignore[arg-type]


def floor_without_rims(folder: Path) -> tuple[Any, Any]:
    """Whether the stated error covers the true one, of a camera straight above: edges of the floor's markers shrink."""
    cv2, markers = pytest.importorskip("cv2"), usual_markers(5, 1.0, 1.0)
    matrix = np.array([[1100.0, 0.0, 639.5], [0.0, 1100.0, 479.5], [0.0, 0.0, 1.0]])

    def seen(points_m: Any) -> Any:
        turn, shift = np.array([np.pi, 0.0, 0.0]), np.array([-0.5, 0.5, 1.4])
        return cv2.projectPoints(points_m.reshape(-1, 1, 3), turn, shift, matrix, np.zeros(5))[0].reshape(
            -1, 4, 2
        )

    random = np.random.default_rng(4)
    floor_m = np.concatenate([markers.floor_corners(marker) for marker in markers.floor])
    robots_m = np.stack([corners_at(*random.uniform(0.05, 0.95, 2), 1.0, 0.022, 0.03) for _ in range(60)])
    floor_px, robots_px = seen(floor_m), seen(robots_m)
    covered = []
    for shift_px, rims in ((0.0, True), (-0.4, False), (0.4, False), (-0.4, True)):
        moved_px = (floor_px + shift_px * outwards(floor_px)).reshape(-1, 2)
        found = fit_camera((1280, 960), floor_m, moved_px, robots_px, 0.022, 0.03, have_rims=rims)
        places = found.at_height(robots_px.mean(axis=1), 0.03) - robots_m[..., :2].mean(axis=1)
        covered.append(bool(np.linalg.norm(places, axis=1).max() <= found.place_error_m))
    picture = np.full((200, 200), 90, np.uint8)
    picture[60:140, 60:140] = cv2.aruco.generateImageMarker(dictionary_of("4X4_50"), 7, 80)
    rimmed = np.pad(picture[60:140, 60:140], 60, constant_values=235)
    corners = np.array([[60, 60], [139, 60], [139, 139], [60, 139]], float)
    return [covered, has_rim(picture, corners), has_rim(rimmed, corners)], [
        [True, True, True, False],
        False,
        True,
    ]


CASES: dict[str, Case] = {
    "columns with our names": log(changed()),
    "semicolons, decimal commas": log(changed().replace(",", ";").replace(".", ",")),
    "tabs, decimal commas": log(changed().replace(",", "\t").replace(".", ",")),
    "byte order mark": log("\ufeff" + changed()),
    "blanks and capitals": log(changed().replace("robot,time_s,x_m", " Robot , TIME S ,X m")),
    "units": log("robot,time_ms,x_mm,y_cm,energy\n3,500,250,12.5,1.5\n3,2500,500,25,\n4,2500,750,50,0.25\n"),
    "units in parentheses": log(
        "Robot,Time (µs),X (mm),Y [cm],Energy\n3,5e5,250,12.5,1.5\n3,25e5,500,25,\n4,25e5,750,50,.25\n"
    ),
    "one robot": log("time_s,x_m,y_m,energy\n1,0.5,0.25,2\n", [(0, 1.0, 0.5, 0.25, 2.0)]),
    "robots with names": log(changed(robot=["r2", "r2", "r10"]), [(robot - 3, *rest) for robot, *rest in ROWS]),
    "a file for each robot": one_for_each_robot,
    "missing places": log(changed() + "4,3.0,nan,0.5,1.0\n4,3.5,,,\n", missing=2),
    "with gravity": spectrum(shaken((0.0, 0.0, 1.0)), (80, 1.0, "magnitude", "m/s²", 1000)),
    "without gravity": spectrum(shaken((0.3, 0.0, 1.0), 0.0), said=["gravity is not in the readings"]),
    "counts": spectrum(
        shaken((0.0, 0.0, 1.0)).with_columns(pl.col("ax", "ay", "az") * 16384 / 9.80665),
        (80, pytest.approx(16384 / 9.80665, rel=0.01), "magnitude", "", 1000),
    ),
    "in g": spectrum(
        shaken((0.0, 0.0, 1.0))
        .with_columns(pl.col("ax", "ay", "az") / 9.80665)
        .rename({"ax": "ax (g)", "ay": "ay (g)", "az": "az (g)"}),
        (80, 1.0, "magnitude", "m/s²", 1000),
    ),
    "polled": spectrum(polled(4), (80, 1.0, "magnitude", "m/s²", 250), said=["the sensor is polled at 1000 Hz"]),
    "clipped": spectrum(
        shaken((0.0, 0.0, 1.0)).with_columns(pl.col("az").clip(upper_bound=10.7)),
        (80, 1.0, "magnitude", "m/s²", 1000), said=["at the end of the sensor's range"],
    ),
    "one axis": spectrum(shaken((0.0, 0.0, 1.0)).drop("ax", "ay"), (80, 1.0, "magnitude", "m/s²", 1000)),
    "continuous": spectrum(
        shaken((0.0, 0.0, 1.0)).with_columns(time_s=pl.int_range(pl.len()) / 1000.0),
        (80, 1.0, "magnitude", "m/s²", 1000), stop_s=0.6,
    ),
    "equal times": spectrum(
        shaken((0.0, 0.0, 1.0)).with_columns((pl.col("time_s") * 100).floor() / 100),
        (80, 1.0, "magnitude", "m/s²", 1000), rate_hz=1000.0,
    ),
    "missing readings": spectrum(
        shaken((0.0, 0.0, 1.0)).with_columns(pl.when(pl.int_range(pl.len()) % 97 != 5).then("az").alias("az")),
        (80, 1.0, "magnitude", "m/s²", 1000), said=["50 readings missing"],
    ),
    "energies with gravity": energies(shaken((0.0, 0.0, 2.0), rate_hz=350.0), 1.124),
    "energies without gravity": energies(shaken((0.0, 0.0, 2.0), 0.0, rate_hz=350.0), 1.124),
    "spare print": spare_print,
    "floor without rims": floor_without_rims,
    "bits, inspected": inspected_bits,
    "bits": bits(as_energies=False, mirrored=False),
    "bits, mirrored": bits(as_energies=False, mirrored=True),
    "bits as energies": bits(as_energies=True, mirrored=False),
    "bits as energies, mirrored": bits(as_energies=True, mirrored=True),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_what_people_have_is_read_right(name: str, tmp_path: Path) -> None:
    found, right = CASES[name](tmp_path)
    assert found == right
