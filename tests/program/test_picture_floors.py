"""Pictures as floors: how many tiles, and which of them vibrate."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from helpers.commands import refusal_of
from vibroswarm import Study, preset
from vibroswarm.cli import main
from vibroswarm.errors import InputError
from vibroswarm.floors.source import resolve
from vibroswarm.scenario.scenario import Scenario


@pytest.fixture
def circle(tmp_path, monkeypatch):
    """A picture in black and white whose shape does not follow any grid."""
    y, x = np.mgrid[:480, :480]
    Image.fromarray((((x - 240) ** 2 + (y - 240) ** 2 < 150**2) * 255).astype(np.uint8)).save(
        tmp_path / "circle.png"
    )
    monkeypatch.chdir(tmp_path)
    return "circle.png"


def fine(path, side):
    Image.fromarray((np.eye(side) * 255).astype(np.uint8)).save(path)


@pytest.mark.parametrize(
    "command",
    ["run", "evaluate --runs 2", "evaluate --runs 2 --vary preset=paper,text", "scenario", "floors show",
     "floors measure", "detect", "evaluate tradeoff"],
)  # fmt: skip
def test_a_large_picture_needs_tiles_before_anything_runs(circle, command, capsys, tmp_path):
    words = command.split()
    given = [circle] if words[0] == "floors" else ["--floor", circle]
    assert main([*words, *given]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert (
        "has 480 x 480 pixels, too many for one tile each (at most 10,000); add --tiles ROWSxCOLUMNS" in err
    )
    assert [path.name for path in tmp_path.iterdir()] == [circle]


def test_tiles_smaller_than_a_robot_are_made_if_they_are_meant(tmp_path):
    path = tmp_path / "fine.png"
    fine(path, 60)
    assert main(["scenario", "--floor", str(path), "--tiles", "60x60"]) == 0
    assert (
        main(["scenario", "--floor", str(path), "--set", "arena.width_m=3", "--set", "arena.height_m=3"]) == 0
    )
    with pytest.raises(InputError, match="smaller than a robot"):
        Scenario.from_toml('[floor]\nsource = "fine.png"\n', folder=tmp_path)
    assert Scenario.from_toml('[floor]\nsource = "fine.png"\nrows = 60\ncolumns = 60', folder=tmp_path)
    with pytest.raises(InputError, match="smaller than a robot"):
        _ = Study({"floor": {"source": str(path)}}, runs=1).cells
    assert Study({"floor": {"source": str(path)}, "arena": {"width_m": 2.0, "height_m": 2.0}}, runs=1).cells


def test_large_grids_in_text_are_asked_about_too(tmp_path, capsys):
    path = tmp_path / "grid.csv"
    path.write_text(",".join("01" * 60) + "\n" + (",".join("10" * 60) + "\n") * 99)
    assert "holds 100 x 120 tiles, more than 10,000; add --tiles 100x120 if so many are meant" in refusal_of(
        capsys, "floors", "measure", path
    )
    assert main(["floors", "measure", str(path), "--tiles", "100x120"]) == 0


def test_the_threshold_is_part_of_the_scenario(circle, capsys, tmp_path):
    options = ["--floor", circle, "--tiles", "16x16"]
    texts = []
    for threshold in ([], ["--image-threshold", "20%"], ["--set", "floor.image_threshold=0.2"]):
        assert main(["scenario", *options, *threshold, "--out", f"{len(texts)}.toml"]) == 0
        texts.append((tmp_path / f"{len(texts)}.toml").read_text())
    assert texts[1] == texts[2] != texts[0]
    assert "image_threshold = 0.2\n" in texts[1]
    assert "image_threshold" not in texts[0]
    (tmp_path / "short.toml").write_text(
        f'[floor]\nsource = "{circle}"\nrows = 16\ncolumns = 16\nimage_threshold = 0.2\n'
    )
    assert (
        Scenario.read(tmp_path / "short.toml").floor.tiles == Scenario.read(tmp_path / "1.toml").floor.tiles
    )
    study = Study({"floor": {"source": circle, "rows": 16, "columns": 16, "image_threshold": 0.2}}, runs=1)
    assert study.cells[0].scenario.floor.tiles == Scenario.read(tmp_path / "1.toml").floor.tiles
    assert main(["floors", "measure", circle, "--tiles", "16x16", "--image-threshold", "20%", "--json"]) == 0
    ones = sum(row.count("1") for row in Scenario.read(tmp_path / "1.toml").floor.tiles or ())
    assert f'"ones": {ones}' in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--image-threshold", "0.5"], "--image-threshold: '0.5' is not a percentage"),
        (["--image-threshold", "120%"], "--image-threshold: '120%' is not a percentage"),
        (["--set", "floor.image_threshold=2"], "floor.image_threshold: 2 is wrong"),
        (["--set", "floor.image_threshold=high"], "floor.image_threshold: 'high' is wrong"),
    ],
)
def test_wrong_thresholds(circle, options, words, capsys):
    assert words in refusal_of(capsys, "run", "--floor", circle, "--tiles", "5x5", *options)


def test_a_threshold_without_a_picture(tmp_path, capsys):
    assert preset("paper").floor.image_threshold is None
    for floor in ([], ["--floor", "diagonal:0.46"]):
        assert "--image-threshold: applies to a picture; add --floor FILE.png" in refusal_of(
            capsys, "run", *floor, "--image-threshold", "40%"
        )
    for command in ("show", "measure"):
        assert "--image-threshold: applies to a picture, not to 'random:0.4'" in refusal_of(
            capsys, "floors", command, "random:0.4", "--image-threshold", "40%"
        )


def test_tiles_given_by_set_need_no_picture(capsys):
    assert main(["scenario", "--set", 'floor.tiles=["01", "10"]']) == 0
    assert "floor.tiles" in refusal_of(capsys, "scenario", "--set", "floor.tiles=[]")


def test_a_palette_says_which_colour_is_which_kind(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:

    colours = np.array([[255, 255, 255], [0, 0, 250], [250, 10, 0]], dtype=np.uint8)
    kinds = np.array([[0, 2, 1], [1, 0, 2]])
    picture = colours[kinds].repeat(5, axis=0).repeat(5, axis=1)
    picture[0, 0] = colours[2]  # one pixel of 25
    Image.fromarray(picture).save(tmp_path / "mine.png")
    spec = f"palette:ffffff,0000ff,ff0000:{tmp_path / 'mine.png'}"
    assert resolve(spec, (2, 3))[0].tolist() == kinds.tolist()
    swapped = f"palette:ffffff,ff0000,0000ff:{tmp_path / 'mine.png'}"
    assert resolve(swapped, (2, 3))[0].tolist() == np.array([0, 2, 1])[kinds].tolist()
    assert main(["floors", "measure", spec, "--tiles", "2x3"]) == 0
    for wrong, words in (
        (f"palette:ffffff,00ff00:{tmp_path / 'mine.png'}", "near none of the palette"),
        (f"palette:ffffff,white:{tmp_path / 'mine.png'}", "as RRGGBB"),
        ("palette:ffffff,0000ff", "give the colours of the kinds"),
    ):
        assert words in refusal_of(capsys, "floors", "measure", wrong, "--tiles", "2x3")


@pytest.mark.parametrize("name", ["", "palette:000000,ffffff:", "values:"])
def test_pixels_smaller_than_a_robot_are_refused_however_a_picture_is_read(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fine(tmp_path / "mine.png", 60)
    for command in ("run", "evaluate --runs 2", "evaluate --runs 2 --vary preset=paper,text"):
        assert main([*command.split(), "--floor", f"{name}{tmp_path / 'mine.png'}"]) == 2
    (tmp_path / "one.toml").write_text(f'[floor]\nsource = "{name}mine.png"\n')
    assert main(["run", "--scenario", str(tmp_path / "one.toml")]) == 2
    (tmp_path / "s.toml").write_text(f'[grid]\n"floor.source" = ["{name}mine.png"]\n')
    assert main(["evaluate", str(tmp_path / "s.toml")]) == 2
    said = capsys.readouterr().err
    assert said.count("16.7 mm x 16.7 mm, smaller than a robot (30 mm); add --tiles ROWSxCOLUMNS") == 5
