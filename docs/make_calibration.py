"""Make the table of fits in calibration.md again, and with --refit preset `calibrated`, from the study's recordings.

    python docs/make_calibration.py [--refit DIR]

DIR is the folder of the recordings. The fit takes 30 s of CPU.
"""

from __future__ import annotations

import argparse
import json
import re
from pathlib import Path
from typing import Any, Final

import vibroswarm.scenario.presets
from vibroswarm.calibrate.dataset import dataset_of
from vibroswarm.calibrate.fit import FITS, avoidance, fit
from vibroswarm.paper.columns import REAL, read_recordings
from vibroswarm.scenario.scenario import Scenario, preset

PAGE: Final = Path(__file__).with_name("calibration.md")
PRESET: Final = Path(vibroswarm.scenario.presets.__file__).parent / "calibrated.toml"
BASE: Final = "paper-empirical"


def fitted_fields(folder: Path) -> dict[str, Any]:
    """The fields that are fitted to all sessions."""
    recordings = dataset_of([read_recordings(folder, REAL)])
    fields: dict[str, Any] = fit(recordings, preset(BASE)).changed
    Scenario.from_base({"preset": BASE}).with_values(fields)
    return fields


def write_preset(fields: dict[str, Any]) -> None:
    """Write fitted values into the preset's file; its comments and its order stay.

    Raises:
        SystemExit: a fitted field is not in the file.
    """
    lines, section, left = PRESET.read_text(encoding="utf-8").splitlines(), "", dict(fields)
    for k, line in enumerate(lines):
        if named := re.match(r"\[(.+?)\]", line):
            section = named[1]
        if value := re.match(r"(\w+) = ([^#]*?)( *#.*)?$", line):
            name = f"{section}.{value[1]}"
            if name in left:
                new = left.pop(name)
                lines[k] = f"{value[1]} = {json.dumps(new)}{value[3] or ''}"
    if missing := [name for name in left if left[name] is not None]:
        raise SystemExit(f"{PRESET.name} lacks {', '.join(missing)}; add lines for them")
    PRESET.write_text("\n".join(lines) + "\n", encoding="utf-8")


def table(head: list[str], rows: list[list[str]]) -> str:
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def fits_table() -> str:
    """What each fit estimates, from which samples or intervals, with which error."""
    rows = [
        [step.__name__.lstrip("_"), (step.__doc__ or "").partition("\n")[0]] for step in (*FITS, avoidance)
    ]
    return table(["fit", "what it estimates"], rows)


def write_page() -> None:
    """Put the table between its marks."""
    text, begin = PAGE.read_text(encoding="utf-8"), "<!-- made: fits -->\n"
    first = text.index(begin) + len(begin)
    text = f"{text[:first]}\n{fits_table()}\n\n{text[text.index('<!-- end -->', first) :]}"
    PAGE.write_text(text, encoding="utf-8")


def main() -> None:
    """Write the table, and the preset if it is asked for."""
    options = argparse.ArgumentParser(description="Make the calibration again.")
    options.add_argument("--refit", type=Path, metavar="DIR")
    given = options.parse_args()
    write_page()
    print(f"wrote {PAGE}")
    if given.refit is not None:
        write_preset(fitted_fields(given.refit))
        print(f"wrote {PRESET}")


if __name__ == "__main__":
    main()
