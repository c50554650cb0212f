"""Pictures as floors: how many tiles, and which of them vibrate."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from vibroswarm import Study
from vibroswarm.cli import main
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
