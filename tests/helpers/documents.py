"""Blocks of code in README.md and docs/, their commands, and how these are made small for tests."""

from __future__ import annotations

import re
import shlex
import shutil
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
"""The folder of the checkout."""
DOCS = ROOT / "docs"
DOCUMENTS = [ROOT / "README.md", *sorted(DOCS.glob("*.md"))]
BLOCK = re.compile(
    r"^(?:<!-- not run: (?P<why>[^>]+) -->\n+)?```(?P<kind>[^\n]*)\n(?P<text>.*?)^```$",
    flags=re.DOTALL | re.MULTILINE,
)

SMALL = {
    "inspect --plan": ["--runs", "4", "--plates", "10", "--minutes", "5"],
    "inspect --damage": ["--sizes", "20", "--replicates", "99"],
    "inspect --out damage": ["--sizes", "14,28", "--contrasts", "1,0.5", "--replicates", "99"],
    "optimize sensitivity": ["--budget", "1120"],
    "evaluate": ["--runs", "4", "--no-pictures"],
    "league": ["--runs", "4", "--patterns", "stripe", "--fills", "0.48", "--strategy", "none,soft"],
    "detect": ["--runs", "4"],
    "optimize": ["--budget", "600", "--fresh", "20", "--no-pictures"],
    "reproduce": ["--runs", "4", "--no-pictures"],
    "lab replay": ["--draws", "4"],
    "calibrate fit": ["--candidates", "40"],
}
"""What is put in place of what a command says that has these words, so that it takes a moment and not minutes."""


YOURS = {
    "study.toml": "runs = 4\n[scenario]\nrun = { t_end_s = 60 }\n[grid]\n'strategy.name' = ['none', 'soft']\n",
    "search.toml": "examples/search.toml",
    "world.txt": "examples/lab/floor.txt",
    "my floor.txt": "examples/lab/floor.txt",
    "day1.csv": "examples/lab/session-1.csv",
    "day2.csv": "examples/lab/session-2.csv",
}
"""Files that documents take for the reader's own: what is in them, or of which example they are a copy."""


class Block(NamedTuple):
    kind: str
    text: str
    why_not: str
    """Why it is not run; empty where it is."""

    @property
    def is_run(self) -> bool:
        return not self.why_not


def blocks_of(text: str) -> list[Block]:
    return [Block(m["kind"].split(" ")[0], m["text"], (m["why"] or "").strip()) for m in BLOCK.finditer(text)]


def blocks(document: Path, *kinds: str) -> list[Block]:
    return [block for block in blocks_of(document.read_text(encoding="utf-8")) if block.kind in kinds]


def command_of(line: str) -> list[str] | None:
    """The words after ``vibroswarm`` where the line calls it."""
    if not re.match(r"(\S*/)?vibroswarm\s", line + " "):
        return None
    return shlex.split(line, comments=True)[1:]


def shell_lines(text: str) -> list[str]:
    return [line.strip() for line in text.replace("\\\n", " ").splitlines() if line.strip()]


def exchanges(text: str) -> Iterator[tuple[str, str]]:
    """Commands of a console, and what each says."""
    for part in re.split(r"^\$ ", text.replace("\\\n", " "), flags=re.MULTILINE)[1:]:
        line, _, said = part.partition("\n")
        yield line, said


def small(command: list[str]) -> list[str]:
    """The command with small numbers of runs."""
    of_it = (name for name in SMALL if name.split()[0] == command[0] and set(name.split()) <= set(command))
    name = next(of_it, "")
    changes = SMALL.get(name, [])
    if name == "reproduce" and "--only" not in command:
        changes = [*changes, "--columns", "paper"]
    dropped = {"--until", *(word for word in changes if word.startswith("--"))}
    kept: list[str] = []
    skip = False
    for word in command:
        if not skip and word not in dropped:
            kept.append(word)
        skip = word in dropped and not word.startswith("--no-")
    return kept + changes


def repeats(document: Path, line: str, after: str) -> bool:
    """Whether a command is run, as small and with the same files, for a document before this one, and nothing uses it.

    Args:
        after: the rest of the document, which may use what the command writes.
    """
    command = command_of(line)
    if command is None or any(re.search(r"\.\w+(:|$)", word) for word in command if "examples/" not in word):
        return False  # files of the reader's own differ from document to document
    before = DOCUMENTS[: DOCUMENTS.index(document)]
    written = re.search(r"--out (\S+)", line)
    is_used = written is not None and written[1] in after
    return not is_used and any(_without_out(command) in _alone(one) for one in before)


@cache
def _alone(document: Path) -> list[list[str]]:
    """The commands of a document's ``sh`` blocks that read nothing that another of them has written, small."""
    lines = [line for block in blocks(document, "sh") if block.is_run for line in shell_lines(block.text)]
    folders = {found[1] for line in lines if (found := re.search(r"--out (\S+)", line))}
    commands = [_without_out(command) for line in lines if (command := command_of(line))]
    return [command for command in commands if not folders & set(command)]


def _without_out(command: list[str]) -> list[str]:
    """The command, small, wherever it writes."""
    words = small(command)
    k = words.index("--out") if "--out" in words else len(words)
    return words[:k] + words[k + 2 :]


def lay_out(folder: Path) -> None:
    """Give a folder what a reader of the documents has: a copy of examples/, and files of the reader's own."""
    shutil.copytree(ROOT / "examples", folder / "examples")
    for name, source in YOURS.items():
        text = (ROOT / source).read_text(encoding="utf-8") if source.startswith("examples/") else source
        (folder / name).write_text(text, encoding="utf-8")
