"""Markup in the texts that a user gives stays text, and what a terminal would act on is not printed.

Texts are names of studies, cells, floors, entries, files, folders, logs, code and its reports, units, answers, numbers.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path

import pytest

from helpers.markup import Markup
from helpers.recordings import TILES
from vibroswarm import sensors, strategies, tasks
from vibroswarm.cli import main
from vibroswarm.documents import study
from vibroswarm.recordings.recording import Recording
from vibroswarm.result import Result

SCRIPT, IMAGE, ENTITY = "<script>alert(1)<!--", "<img src=x onerror=alert(2)>", "&lt;b&gt;\"'`{{7*7}}</b"
TEXTS = (SCRIPT, IMAGE, ENTITY)
CONTROL = "\x1b[31mred\x07\x9b2J"
"""What a terminal acts on."""
SHORT = ["--set", "run.t_end_s=60", "--robots", "2"]
ROWS = ["10", "01"]
SMALL_SEARCH = Path(__file__).parents[1] / "helpers" / "small_search.toml"


def in_a_file_name(text: str) -> str:
    return text.replace("/", "|")


def check(folder: Path, plain: Path, text: str) -> None:
    """Fail if a page or picture below a folder has scripts or handlers that its twin with plain texts does not have."""
    pages = sorted(path.relative_to(folder) for path in folder.rglob("*") if path.suffix in (".html", ".svg"))
    assert pages
    assert any(text in Markup((folder / page).read_text(encoding="utf-8")).text for page in pages), (
        "it is shown"
    )
    check_alike(folder, plain, pages)


def check_alike(folder: Path, plain: Path, pages: Sequence[Path]) -> None:
    for page in pages:
        hostile, harmless = (Markup((root / page).read_text(encoding="utf-8")) for root in (folder, plain))
        assert hostile.tags.count("script") == harmless.tags.count("script")
        assert hostile.tags.count("img") == harmless.tags.count("img")
        assert {name for name, _ in hostile.attributes} <= {name for name, _ in harmless.attributes}


def evaluated(folder: Path, texts: Sequence[str]) -> Path:
    """The outcome of a study in whose title, file and floor all of these texts are, and whose labels are these."""
    title, out = " ".join(texts), folder / "out"
    path = folder / f"{in_a_file_name(title)}.toml"
    cells = [f'[[list]]\nlabel = {json.dumps(text)}\n"strategy.name" = "none"\n' for text in texts]
    path.write_text(
        f"name = {json.dumps(title)}\nruns = 4\n[scenario]\nrun.t_end_s = 60.0\nswarm.robots = 2\n"
        f"[floors]\n{json.dumps(title)} = {json.dumps(ROWS)}\n{''.join(cells)}"
        f'[grid]\n"floor.source" = [{json.dumps(title)}]\n',
        encoding="utf-8",
    )
    assert main(["evaluate", str(path), "--no-confirm", "-q", "--out", str(out)]) == 0
    return out


DRAWN = (
    "outcomes",
    "decision_time_s",
    "incidence-robots",
    "consensus-box",
    "belief",
    "compared-decision-time-s",
)


@pytest.fixture
def drawn_alike_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the pictures of a study that the same code draws, with other numbers, a report has one."""
    for name in ("outcome_figures", "time_figures", "comparison_figures"):
        whole = getattr(study, name)
        some = lambda outcome, whole=whole: [one for one in whole(outcome) if one.name in DRAWN]  # noqa: E731
        monkeypatch.setattr(study, name, some)


@pytest.mark.usefixtures("svg_alone", "without_layout", "drawn_alike_once")
def test_a_study(tmp_path: Path) -> None:
    (tmp_path / "hostile").mkdir()
    (tmp_path / "plain").mkdir()
    hostile = evaluated(tmp_path / "hostile", TEXTS)
    plain = evaluated(tmp_path / "plain", ["name", "another", "a third"])
    for text in TEXTS:
        check(hostile, plain, text)


def test_a_run_on_a_floor_from_a_file(tmp_path: Path) -> None:
    texts = in_a_file_name(" ".join(TEXTS))
    for root, name in (("hostile", texts), ("plain", "name")):
        folder = tmp_path / root / name
        folder.mkdir(parents=True)
        floor = folder / f"{name}.txt"
        floor.write_text("\n".join(ROWS), encoding="utf-8")
        assert main(["run", *SHORT, "--floor", str(floor), "-q", "--out", str(tmp_path / root / "out")]) == 0
    check(tmp_path / "hostile" / "out", tmp_path / "plain" / "out", texts)


def printed_plainly(capsys: pytest.CaptureFixture[str]) -> str:
    """What was printed since the last call, of which a terminal acts on nothing but line feeds."""
    out, err = capsys.readouterr()
    assert all(c.isprintable() or c == "\n" for c in out + err), ascii(out + err)
    return out


HOSTILE = f"{IMAGE}{CONTROL}"


def imported(logs: list[Path], below: Path) -> dict[str, Path]:
    """Import logs and floors with hostile and with plain names into folders with such names."""
    found = {}
    for root, name in (("hostile", in_a_file_name(HOSTILE)), ("plain", "name")):
        folder = below / root
        folder.mkdir()
        log, floor = folder / f"{name}.csv", folder / f"{name}.txt"
        log.write_bytes(logs[0].read_bytes())
        floor.write_text("\n".join(TILES), encoding="utf-8")
        given = ["--floor", str(floor), "--tiles", "5x5"]
        found[root] = folder / f"out {name}"
        assert main(["lab", "import", str(log), *given, "--any-floor", "--out", str(found[root])]) == 0
    return found


def test_a_recording(logs: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folders = imported(logs, tmp_path)
    printed_plainly(capsys)
    folder = str(folders["hostile"])
    assert main(["show", folder]) == 0
    assert IMAGE.replace("/", "|") in printed_plainly(capsys)
    check(folders["hostile"], folders["plain"], IMAGE.replace("/", "|"))
    for words in (["lab", "replay", folder, "--draws", "5"], ["lab", "threshold", folder]):
        assert main(words) == 0
        printed_plainly(capsys)
    Markup(Recording.read(folder)._repr_html_()).check_inert()


@pytest.mark.usefixtures("svg_alone", "without_layout")
def test_the_columns_and_names_of_a_csv(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folders = {}
    for root, text in (("hostile", HOSTILE), ("plain", "name")):
        folder, name = tmp_path / root, in_a_file_name(text)
        folder.mkdir()
        samples, law = folder / f"{name}.csv", folder / f"law {name}.csv"
        rows = [f"{k % 3},{k},{37 * k % 1000},{71 * k % 1000},{1 + 13 * k % 7 / 7},0" for k in range(120)]
        samples.write_text("\n".join([f'robot,time_s,x_mm,y_mm,value,"{text}"', *rows]), encoding="utf-8")
        energies = [
            f"{kind},{low + k % 11 / 20}"
            for k in range(60)
            for kind, low in (("still", 1.0), ("vibrating", 1.6))
        ]
        law.write_text("\n".join(["kind,energy", *energies]), encoding="utf-8")
        given = ["--laws", str(law), "--size", "1x1", "--tiles", "5x5"]
        folders[root] = tmp_path / root / "out"
        assert main(["inspect", str(samples), *given, "-q", "--out", str(folders[root])]) == 0
        printed_plainly(capsys)
    check(folders["hostile"], folders["plain"], IMAGE.replace("/", "|"))


def test_a_column_of_a_csv_that_is_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "table.csv"
    table.write_text(f'"{HOSTILE}"\n"{HOSTILE}"\n', encoding="utf-8")
    assert main(["show", str(table)]) == 0
    assert printed_plainly(capsys).count(IMAGE) == 2


OWN = """
import numpy as np
from vibroswarm.sensors import SensorModel
from vibroswarm.strategies import Report, strategy_in
from vibroswarm.tasks import Task

class State:
    own: int
    seen: float
    decision: int

def begin(s, a, d, p, w):
    s.decision = -1

def on_sample(s, a, x, out, d, p, w):
    s.own, s.seen = s.own + 1, s.seen + x.reading
    if s.own > 5:
        s.decision = 1
    out.bit = x.reading
    return True

def decision(s, a, p, w):
    return s.decision

def truth(floor, asked, p):
    return 1

def sense(samples, p):
    return np.stack([samples.x_m, samples.y_m], axis=1)

def reading(value, p):
    return (value[:, 0] > 0.5).astype(int)

def numbers(p):
    return "energy", "".join(filter(str.isprintable, TEXT))

def warnings(p):
    return [TEXT]

TEXT = {text!r}
felt = SensorModel(name="felt", sense=sense, reading=reading, numbers=numbers, warnings=warnings, about=TEXT)
mine = strategy_in(__name__, "mine", about=TEXT, reports=(Report("seen", unit=TEXT),))
asked = Task(name="asked", truth=truth, answers=(TEXT, TEXT + "!"), about=TEXT)
"""


@pytest.mark.usefixtures("svg_alone", "without_layout", "drawn_alike_once")
def test_code_with_its_reports_units_answers_and_what_it_is_about(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folders = {}
    for root, text in (("hostile", HOSTILE), ("plain", "name")):
        code = tmp_path / f"{root}.py"
        code.write_text(OWN.format(text=text), encoding="utf-8")
        named = [
            "--strategy",
            f"{code}:mine",
            "--task",
            f"{code}:asked",
            "--set",
            f"sensor.model={code}:felt",
        ]
        try:
            for words, out in ((["run"], "run"), (["evaluate", "--runs", "4", "--no-confirm"], "study")):
                folder = tmp_path / root / out
                assert main([*words, *SHORT, *named, "-q", "--trust", "--out", str(folder)]) == 0
                printed_plainly(capsys)
            Markup(Result.read(tmp_path / root / "run")._repr_html_()).check_inert()
            for words in (["strategies"], ["tasks"], ["sensors"], ["show", str(tmp_path / root / "run")]):
                assert main(words) == 0
                assert IMAGE in printed_plainly(capsys) or root == "plain"
        finally:
            strategies.base.forget("mine")
            tasks.base.forget("asked")
            sensors.base.forget("felt")
        folders[root] = tmp_path / root
    check(folders["hostile"], folders["plain"], IMAGE)


@pytest.mark.usefixtures("svg_alone", "without_layout")
def test_a_search(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    body = SMALL_SEARCH.read_text(encoding="utf-8")
    for root, text in (("hostile", HOSTILE), ("plain", "name")):
        file = tmp_path / f"{root}.toml"
        begin, rest = f"name = {json.dumps(text)}\n", "[search]\nbudget = 30\nfresh = 10\n"
        file.write_text(f"{begin}{body}{rest}", encoding="utf-8")
        assert main(["optimize", str(file), "-q", "--out", str(tmp_path / root)]) == 0
        printed_plainly(capsys)
        for words in (["show", str(tmp_path / root)], ["show", str(file)]):
            assert main(words) == 0
            printed_plainly(capsys)
    check(tmp_path / "hostile", tmp_path / "plain", IMAGE)


LEAGUE = ["--patterns", "stripe", "--fills", "0.48", "--runs", "3", "--belief-runs", "2", "--fault-runs", "2"]


def league_played(folder: Path, text: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Play a league in whose code, file of settings and labels of entries a text is, and show all of it."""
    folder.mkdir()
    name = in_a_file_name(text)
    code, settings, out = folder / f"{name}.py", folder / f"{name}.toml", folder / "out"
    code.write_text(OWN.format(text=text), encoding="utf-8")
    tables = {"mine": '"decision.credible_threshold" = 0.9', text: '"decision.min_observations" = 9'}
    settings.write_text(
        f"# {in_a_comment(text)}\n" + "".join(f"[{json.dumps(key)}]\n{row}\n" for key, row in tables.items()),
        encoding="utf-8",
    )
    players = ["--strategy", f"none,{code}:mine", "--settings", str(settings)]
    varied = ["--vary", f"none:task.name={code}:asked"]
    try:
        assert main(["league", *SHORT, *LEAGUE, *players, *varied, "--trust", "-q", "--out", str(out)]) == 0
        printed_plainly(capsys)
        for shown in (out, settings):
            for how in ([], ["--wide"], ["--json"]):
                assert main(["show", str(shown), *how]) == 0
                printed_plainly(capsys)
        assert main(["league", *LEAGUE, *players, "--trust", "--reference", text]) == 2
        printed_plainly(capsys)
    finally:
        strategies.base.forget("mine")
        tasks.base.forget("asked")
        sensors.base.forget("felt")


def in_a_comment(text: str) -> str:
    return "".join(filter(str.isprintable, text))


@pytest.mark.usefixtures("svg_alone", "without_layout")
def test_a_league(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    league_played(tmp_path / "hostile", f"{' '.join(TEXTS)}{CONTROL}", capsys)
    league_played(tmp_path / "plain", "name", capsys)
    for text in TEXTS:
        check(tmp_path / "hostile" / "out", tmp_path / "plain" / "out", in_a_file_name(text))


def test_the_check_sees_markup_that_is_not_escaped(tmp_path: Path) -> None:
    """Negative control."""
    for root, body in (("hostile", f"<p>{IMAGE}</p>{IMAGE.replace('<', '&lt;')}"), ("plain", "<p>name</p>")):
        (tmp_path / root).mkdir()
        (tmp_path / root / "page.html").write_text(body, encoding="utf-8")
    with pytest.raises(AssertionError):
        check(tmp_path / "hostile", tmp_path / "plain", IMAGE)
    assert re.search("onerror", (tmp_path / "hostile" / "page.html").read_text())
