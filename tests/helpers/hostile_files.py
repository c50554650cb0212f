"""A working folder with files that have the names of modules, each of which notes that it was executed."""

from __future__ import annotations

from pathlib import Path

NAMES = (
    "signal",
    "numpy",
    "selectors",
    "threading",
    "sitecustomize",
    "usercustomize",
    "lazy_loader",
    "polars",
)
TEXT = """
import builtins
with builtins.open({mark!r}, "a") as file:
    file.write(__name__ + "\\n")
raise RuntimeError("hostile file of the working folder")
"""


def hostile_folder(below: Path) -> Path:
    """Make such a folder in a folder, and return it."""
    folder = below / "working folder"
    folder.mkdir()
    for name in (*NAMES, "vibroswarm"):
        (folder / f"{name}.py").write_text(TEXT.format(mark=str(below / "executed")))
    return folder


def executed(folder: Path) -> list[str]:
    """Names under which files of the folder were executed."""
    mark = folder.parent / "executed"
    return mark.read_text().split() if mark.exists() else []
