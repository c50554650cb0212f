"""What the documents say is so: their code runs, their commands are understood, their links lead somewhere.

Every block of code in README.md and docs/ says what it is. The blocks of a document run one after the other in a
folder of their own, which holds a copy of examples/ and the files of ``helpers.documents.YOURS``:

| block | what is done with it |
|---|---|
| ``python`` | run, with the names of the blocks before it |
| ``console`` | commands after ``$`` are run as they stand; what follows must be what they say (``...``: anything) |
| ``sh`` | commands of vibroswarm are run with small numbers of runs, Python scripts as they stand; others are not run |
| ``toml`` | read as what it is: scenario, study, search, or column map |
| ``text``, ``math`` | nothing: something to look at |

Commands in the ``sh`` blocks of README.md are only parsed here: ``test_installed.py`` runs them, from the wheel. So
are commands that a document before this one runs with the same words and files (``helpers.documents.repeats``).

``# name.toml`` (``.py``, ``.txt``) at the head of a block makes it that file for the blocks after it.

A comment ``<!-- not run: why -->`` above a block leaves running out; commands are then still parsed, Python compiled,
TOML read as TOML.
"""

from __future__ import annotations

import contextlib
import fnmatch
import io
import re
import runpy
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from helpers.documents import (
    DOCS,
    DOCUMENTS,
    ROOT,
    Block,
    blocks,
    command_of,
    exchanges,
    lay_out,
    repeats,
    shell_lines,
    small,
)
from vibroswarm import cli
from vibroswarm.cli import commands
from vibroswarm.errors import InputError

KINDS = ("python", "console", "sh", "toml", "text", "math")


def understood(command: list[str]) -> bool:
    """Whether the real parser takes the command."""
    if command == ["--version"]:
        return True
    try:
        found, rest = commands.command_in(command)
        return bool(found.parser().parse_args(rest))
    except InputError:
        return False
    except SystemExit as left:
        return left.code == 0


def run(command: list[str]) -> tuple[int, str, str]:
    """The command's exit code, and what it says on both streams; progress and plans are on the second."""
    said, besides = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(besides):
        code = cli.main(command)
    return code, said.getvalue(), besides.getvalue()


def same_words(said: str, shown: str) -> bool:
    """Whether what is shown is what was said; ``...`` on a line stands for anything, lines included."""
    plain = " ".join(said.split())
    pattern = " ".join(shown.split())
    escaped = pattern.replace("[", "[[]").replace("?", "[?]").replace("*", "[*]")
    return fnmatch.fnmatchcase(plain, re.sub(r" ?\.\.\. ?", "*", escaped))


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder as a reader of the documents has it: a copy of examples/, and files of the reader's own."""
    lay_out(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    return tmp_path


def name_of(document: Path) -> str:
    return str(document.relative_to(ROOT).with_suffix(""))


@pytest.mark.slow
@pytest.mark.usefixtures("blank_pictures")
@pytest.mark.parametrize("document", DOCUMENTS, ids=name_of)
def test_the_code_runs(document, here, monkeypatch):
    main_module = ModuleType("__main__")  # what is typed in there can be found by its name
    monkeypatch.setitem(sys.modules, "__main__", main_module)
    names: dict[str, object] = vars(main_module)
    found = blocks(document, *KINDS)
    for number, block in enumerate(found):
        named = re.match(r"# (\S+\.\w+)\n", block.text)
        if named:
            (here / named[1]).write_text(block.text, encoding="utf-8")
        if block.kind == "toml":
            check_toml(block, here)
        elif block.kind == "python":
            program = compile(block.text, document.name, "exec")
            if block.is_run:
                exec(program, names)  # noqa: S102  (our own document)
        elif block.kind == "console":
            for line, shown in exchanges(block.text):
                check_exchange(line, shown, block)
        elif block.kind == "sh":
            if document.name == "README.md":
                block = block._replace(why_not="test_installed.py runs it, from the wheel")
            lines = shell_lines(block.text)
            later = [other.text for other in found[number + 1 :]]
            for place, line in enumerate(lines, start=1):
                after = "\n".join([*lines[place:], *later])
                check_line(line, block, is_run_before=repeats(document, line, after))


def check_toml(block: Block, folder: Path) -> None:
    if block.is_run:
        assert read_as_what_it_is(block.text, folder)
    else:
        assert tomllib.loads(block.text)


def check_exchange(line: str, shown: str, block: Block) -> None:
    command = command_of(line)
    assert command is not None, f"only vibroswarm has a console: {line}"
    assert understood(command), line
    if block.is_run:
        code, said, besides = run(command)
        assert same_words(said, shown), f"{line}\n(exit code {code})\n{said}{besides}"


def check_line(line: str, block: Block, is_run_before: bool) -> None:
    command = command_of(line)
    if command is not None:
        assert understood(command), line
        if block.is_run and not is_run_before:
            code, said, besides = run(small(command))
            assert code == 0, f"{line}\n{said}{besides}"
    script = re.match(r"(\S*/)?python3? (?!-)(\S+)(.*)", line)
    if script:
        assert Path(script[2]).exists() or (ROOT / script[2]).exists(), line


def read_as_what_it_is(text: str, folder: Path) -> str:
    """What a TOML block is, found by its tables; raises where it is not right."""
    from vibroswarm import Scenario, Study
    from vibroswarm.core.read_tables import ColumnMap
    from vibroswarm.search import Search

    tables = tomllib.loads(text)
    if "columns" in tables:
        ColumnMap.model_validate(tables)
        return "column map"
    if {"space", "objective", "search"} & set(tables):
        Search.from_toml(text, folder=folder)
        return "search"
    if {"grid", "zip", "list", "random", "sobol", "runs", "until"} & set(tables):
        assert Study.from_values(tomllib.loads(text), folder=folder).cells
        return "study"
    Scenario.from_toml(text, folder=folder)
    return "scenario"


def test_the_public_names_are_there():
    import vibroswarm

    for name in vibroswarm.__all__:
        assert getattr(vibroswarm, name) is not None
    with pytest.raises(AttributeError):
        vibroswarm.nothing  # noqa: B018


def slug(heading: str) -> str:
    """The anchor of a heading, as repositories' pages and the site have it."""
    plain = re.sub(r"[`*]|\[([^\]]*)\]\([^)]*\)", lambda m: m[1] or "", heading.strip().lower())
    return re.sub(r"[^\w\- ]", "", plain).replace(" ", "-")


def anchors(document: Path) -> set[str]:
    text = re.sub(r"^```.*?^```$", "", document.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    return {slug(heading) for heading in re.findall(r"^#+ (.+)$", text, flags=re.MULTILINE)}


def dead_links(document: Path) -> Iterator[str]:
    for target in re.findall(r"\]\(([^)\s]+)\)", document.read_text(encoding="utf-8")):
        path, _, anchor = target.partition("#")
        if re.match(r"[a-z]+:", target):
            continue
        file = document.parent / path if path else document
        of_python = anchor.startswith("vibroswarm.")  # made by the site, which checks it
        if not file.exists() or (anchor and not of_python and anchor not in anchors(file)):
            yield target


def test_links_lead_somewhere():
    for name in ("make_reference", "make_commands"):  # pages that are not committed
        made = runpy.run_path(str(DOCS / f"{name}.py"))
        made["TARGET"].write_text(made["reference"](), encoding="utf-8")
    documents = [*sorted(ROOT.glob("*.md")), *sorted(DOCS.rglob("*.md"))]
    dead = {name_of(document): list(dead_links(document)) for document in documents}
    assert {name: links for name, links in dead.items() if links} == {}
