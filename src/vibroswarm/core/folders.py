"""The one kind of folder that commands write: a manifest, and tables in Parquet that are checked before they are read.

Each folder has the file ``vibroswarm.json``, its manifest: a JSON object with the format, the folder's kind, and what
else the kind records. All kinds have one format number.

| kind | what the folder holds | written by |
|---|---|---|
| result, recording | tables of runs | ``result``, ``recordings.recording`` |
| study | runs (study, league, detection) | ``study.run`` |
| results | what a command printed, its page and its tables | ``report.save`` |

Tables that a longer work adds one by one (steps, fresh runs) have a description each, a manifest beside them:

    NAME.parquet        the main table
    NAME.TABLE.parquet  another table
    NAME.json           kind, size and SHA-256 of each file; written last, so that tables without it are ignored

Each file is written whole or not at all, so several writers of one folder need no coordination.

A manifest has the SHA-256 of the files that are read back.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from vibroswarm.core.atomic_io import MANIFEST
from vibroswarm.core.untrusted_files import read_json
from vibroswarm.errors import InputError

FORMAT: Final = 7
"""Number of the format of all folders."""
KINDS: Final = {
    "result": "a run",
    "recording": "a recording",
    "study": "a study",
    "search": "a search",
    "item": "an item of the reproduction",
    "results": "results of a command",
    "document": "what a command printed",
}
"""Kinds of manifests, in words."""


def manifest_text(kind: str, **values: Any) -> str:
    """Return the text of a manifest: the format, the kind (of ``KINDS``), and the values of that kind."""
    # A document may hold tables of 100,000 rows; two thirds of the file would be indents.
    indent = None if kind == "document" else 1
    return json.dumps({"format": FORMAT, "kind": kind, **values}, indent=indent, allow_nan=False) + "\n"


def read_manifest(path: Path, *kinds: str) -> dict[str, Any]:
    """Read a manifest; return its values, which are those that ``manifest_text`` was given."""
    file = path if path.suffix == ".json" and not path.is_dir() else path / MANIFEST
    if not file.exists():
        expected = KINDS[kinds[0]] if kinds else "a folder"
        raise InputError(f"is not {expected} of vibroswarm (there is no {file.name})", field=str(path))
    values = read_json(file, "a manifest")
    if (found := values.get("format")) != FORMAT:
        raise InputError(f"is of format {found}; this version reads format {FORMAT}", field=str(path))
    if kinds and values["kind"] not in kinds:
        raise InputError(f"holds {KINDS[values['kind']]}, not {KINDS[kinds[0]]}", field=str(path))
    return values  # type: ignore[no-any-return]


def kind_of(folder: Path) -> str | None:
    """Return the kind of a folder; None if it has no manifest."""
    return str(read_manifest(folder)["kind"]) if (folder / MANIFEST).exists() else None


def about_file(data: bytes) -> dict[str, Any]:
    """Return what a manifest says of a file: its size and SHA-256."""
    return {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}


def check_files(values: Mapping[str, Any], path: Path) -> dict[str, Path]:
    """Check the SHA-256 of the files that a manifest names, which lie beside it; return their paths, by table."""
    folder = path if path.is_dir() else path.parent
    files: dict[str, Path] = {}
    for name, about in values.get("files", {}).items():
        file = folder / Path(name).name  # a name with folders could lead to any file of this computer
        if not file.is_file():
            raise InputError("is missing", field=str(file))
        with file.open("rb") as stream:
            if hashlib.file_digest(stream, "sha256").hexdigest() != about["sha256"]:
                raise InputError("is damaged, not what was written", field=str(file))
        # The file of a table has its name, unless the description says another table.
        files[about.get("table", file.stem)] = file
    return files
