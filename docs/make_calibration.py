"""Make the tables of figures/calibration.md again, from the study's recordings, and with --refit preset `calibrated`.

    python docs/make_calibration.py DIR --work out/calibration [--refit] [--item out/paper]

DIR is the folder of the recordings. The parts (held-out sessions, classifiers; with --refit also the fit to all
sessions and its comparison with them) take minutes and are kept in the work folder; a part that is there is not
repeated. Tables are written between `<!-- made: NAME -->` and `<!-- end -->`: without --refit those of held-out
sessions, which are of the fit of today; with it also the preset and the table that compares it. With
--item, the same item of `vibroswarm reproduce` is made too, into that folder. Fits take 30 s of CPU each, of which
there are three or four.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Final

import numpy as np

import vibroswarm.scenario.presets
from vibroswarm.calibrate.camera import Camera, seen_through
from vibroswarm.calibrate.cross_validation import folds, on_floor
from vibroswarm.calibrate.dataset import dataset_of
from vibroswarm.calibrate.drive import undisturbed
from vibroswarm.calibrate.features import FEATURES, WORDS, sessions_of
from vibroswarm.calibrate.fit import FITS, fit
from vibroswarm.calibrate.interval_classifier import other_robots, same_robots
from vibroswarm.calibrate.real_vs_simulated import compare
from vibroswarm.paper.columns import AUTHORS, EMPIRICAL, REAL, read_recordings, real_floor, scenario_of
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import simulate

PAGE: Final = Path(__file__).with_name("calibration.md")
FIGURES: Final = Path(__file__).parent / "figures" / "calibration.md"
PRESET: Final = Path(vibroswarm.scenario.presets.__file__).parent / "calibrated.toml"
BASE: Final = "paper-empirical"
SEEDS: Final = (150, 151, 152, 153)
"""Of sets of three simulated sessions."""
TOLD: Final = 6
"""Simulated sessions that each held-out one is told from."""
Values = Any


def kept(work: Path, name: str, make: Callable[[], Values]) -> Values:
    """Return the values of a part: from its file or, if there is none, made and written there."""
    path = work / f"{name}.json"
    if not path.exists():
        print(f"{name} ...", flush=True)
        path.write_text(json.dumps(make(), indent=1) + "\n", encoding="utf-8")
    return json.loads(path.read_text(encoding="utf-8"))


def fitted_on_all(folder: Path) -> Values:
    """The fit to all sessions."""
    return fit(dataset_of([read_recordings(folder, REAL)]), preset(BASE)).as_dict()


def held_out(folder: Path) -> Values:
    """Leave-one-session-out, beside the authors' simulator."""
    real, authors = (dataset_of([read_recordings(folder, names)]) for names in (REAL, AUTHORS))
    return [fold.as_dict() for fold in folds(real, preset(BASE), authors)]


def compared(folder: Path, fields: dict[str, Any]) -> Values:
    """The preset, through the camera, and the authors' simulator, against the recordings."""
    real, authors = (read_recordings(folder, names) for names in (REAL, AUTHORS))
    scenario = scenario_of("calibrated", real_floor(), parameter_set=EMPIRICAL).with_values(fields)
    return {
        "authors": [compare(real, authors, intervals=True).as_dict()],
        "calibrated": [compare(real, simulate(scenario, seed, 3)).as_dict() for seed in SEEDS],
    }


def told(folder: Path, of_folds: Values) -> Values:
    """Undisturbed intervals of each held-out session, told from simulated ones and from the other sessions."""
    real = read_recordings(folder, REAL)
    sessions = [undisturbed(samples) for samples in sessions_of(real).samples]
    rows = []
    for fold in of_folds:
        held = sessions[fold["session"]]
        scenario = on_floor(preset(BASE).with_values(fold["fields"]), real.floor(0))
        result = seen_through(simulate(scenario, SEEDS[0] + fold["session"], TOLD), Camera.of(scenario))
        simulated = [undisturbed(samples) for samples in sessions_of(result).samples]
        others = [session for k, session in enumerate(sessions) if k != fold["session"]]
        rows.append(
            {
                "session": fold["session"] + 1,
                "simulated, same robots": [same_robots(held, other) for other in simulated],
                "real, same robots": [same_robots(held, other) for other in others],
                "simulated, other robots": [other_robots(held, other) for other in simulated],
                "real, other robots": [other_robots(held, other) for other in others],
            }
        )
    return rows


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


def folds_table(of_folds: Values) -> str:
    """Similarities and energy distances of held-out sessions: means over the folds."""
    names = ("fitted", "other_simulator", "other_sessions")
    rows = []
    for place, feature in enumerate(FEATURES):
        scores = [fold["scores"][place] for fold in of_folds]
        alike = {name: float(np.mean([score[name] for score in scores])) for name in names}
        apart = {
            name: float(np.mean([score[f"distance_{name.removeprefix('other_')}"] for score in scores]))
            for name in names
        }
        level = alike["fitted"] >= alike["other_simulator"]
        rows.append(
            [WORDS[feature], *(f"{alike[name]:.3f}" for name in names[:2]),
             "yes" if level else f"{alike['other_simulator'] - alike['fitted']:.3f} short",
             f"{alike['other_sessions']:.3f}", *(f"{apart[name]:.4f}" for name in names)]
        )  # fmt: skip
    head = ["feature", "fitted", "authors'", "at least that", "other two real", "energy distance, fitted",
            "authors'", "real"]  # fmt: skip
    return table(head, rows)


def compared_table(found: Values) -> str:
    """Similarities of the preset, through the camera: means over sets of three sessions, with their range."""
    rows = []
    for place, feature in enumerate(FEATURES):
        through = [one["similarities"][place]["at_equal_counts"] for one in found["calibrated"]]
        authors = found["authors"][0]["similarities"][place]["at_equal_counts"]
        of_preset = f"{np.mean(through):.3f} ({min(through):.3f}-{max(through):.3f})"
        rows.append([WORDS[feature], of_preset, f"{authors:.3f}"])
    return table(["feature", "calibrated, camera applied", "authors'"], rows)


def told_table(rows: Values) -> str:
    """Shares of undisturbed intervals that are told, by held-out session."""
    kinds = [name for name in rows[0] if name != "session"]
    return table(
        ["undisturbed intervals distinguished from", *(f"session {row['session']}" for row in rows)],
        [[kind, *(f"{np.mean(row[kind]):.2f}" for row in rows)] for kind in kinds],
    )


def fits_table() -> str:
    """What each fit estimates, from which intervals, with which error."""
    rows = []
    for source in FITS:
        sections: dict[str, list[str]] = {}
        for name in source.fields:
            section, _, field = name.rpartition(".")
            sections.setdefault(section, []).append(field)
        fields = "; ".join(f"`[{section}]` {', '.join(own)}".rstrip() for section, own in sections.items())
        rows.append([source.name, fields, source.intervals, source.error])
    return table(["fit", "fields", "from which intervals between samples", "error"], rows)


TABLES: Final[dict[str, Callable[[Values], str]]] = {
    "folds": folds_table,
    "told": told_table,
    "compared": compared_table,
}
"""The tables of the page, by the part that they show."""


def write_page(page: Path, named: Iterable[tuple[str, str]]) -> None:
    """Put tables between their marks."""
    text = page.read_text(encoding="utf-8")
    for name, piece in named:
        begin = f"<!-- made: {name} -->\n"
        first = text.index(begin) + len(begin)
        text = f"{text[:first]}\n{piece}\n\n{text[text.index('<!-- end -->', first) :]}"
    page.write_text(text, encoding="utf-8")


def main() -> None:
    """Make all parts, then write preset and page."""
    options = argparse.ArgumentParser(description="Make the calibration again.")
    options.add_argument("recordings", type=Path)
    options.add_argument("--work", type=Path, required=True)
    options.add_argument("--refit", action="store_true")
    options.add_argument("--item", type=Path, default=None)
    given = options.parse_args()
    given.work.mkdir(parents=True, exist_ok=True)
    folder = given.recordings
    found = {"folds": kept(given.work, "folds", lambda: held_out(folder))}
    found["told"] = kept(given.work, "told", lambda: told(folder, found["folds"]))
    if given.refit:
        found["fit"] = kept(given.work, "fit", lambda: fitted_on_all(folder))
        fields = found["fit"]["fields"]
        Scenario.from_base({"preset": BASE}).with_values(fields)
        found["compared"] = kept(given.work, "compared", lambda: compared(folder, fields))
        write_preset(fields)
        print(f"wrote {PRESET}")
    write_page(FIGURES, [(name, made(found[name])) for name, made in TABLES.items() if name in found])
    write_page(PAGE, [("fits", fits_table())])
    print(f"wrote {PAGE} and {FIGURES}")
    if given.item is not None:
        command = [
            "reproduce",
            "--only",
            "calibration",
            "--recordings",
            str(folder),
            "--out",
            str(given.item),
        ]
        subprocess.run([sys.executable, "-m", "vibroswarm", *command], check=True)


if __name__ == "__main__":
    main()
