"""The one kind of folder that commands write: a manifest, and tables in Parquet that are checked before they are read.

Each folder has the file ``vibroswarm.json``, its manifest: a JSON object with the format, the folder's kind, and what
else the kind records. All kinds have one format number.

| kind | what the folder holds | written by |
|---|---|---|
| result, recording | tables of runs | ``result``, ``recordings.recording`` |
| study | batches of runs (study, sweep, league, detection, grid) | ``study.store`` |
| search | steps and fresh runs of a search | ``optimize.steps`` |
| item | tables of an item of the reproduction | ``paper.item`` |
| results | what a command printed, its page and its tables | ``documents.saved`` |

Tables that a longer work adds one by one (batches, steps, fresh runs) have a description each, a manifest beside them:

    NAME.parquet        the main table
    NAME.TABLE.parquet  another table
    NAME.json           kind, size and SHA-256 of each file; written last, so that tables without it are ignored

Each file is written whole or not at all, so several writers of one folder need no coordination.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from vibroswarm.core.atomic_io import MANIFEST, write_files
from vibroswarm.core.untrusted_files import entry, read_json
from vibroswarm.errors import InputError, check_format, shown

FORMAT: Final = 6
"""Number of the format of all folders."""
KINDS: Final = {
    "result": "a run",
    "recording": "a recording",
    "study": "a study",
    "search": "a search",
    "item": "an item of the reproduction",
    "results": "results of a command",
    "batch": "a batch of runs",
    "step": "a step of a search",
    "fresh": "fresh runs of a search",
    "failure": "a failed batch",
    "document": "what a command printed",
}
"""Kinds of manifests, in words."""
OLDER: Final = ("result.json", "recording.json", "study.json", "search.json", "item.json", "printed.json")
"""Files of folders before format 6, when each kind had its own manifest, of which a folder without manifest has one."""


def manifest_text(kind: str, **values: Any) -> str:
    """Return the text of a manifest: the format, the kind (of ``KINDS``) and the values of that kind."""
    assert kind in KINDS
    return json.dumps({"format": FORMAT, "kind": kind, **values}, indent=1, allow_nan=False) + "\n"


def read_manifest(path: Path, *kinds: str) -> dict[str, Any]:
    """Read a manifest; return its values.

    Args:
        path: folder, or file of a description. kinds: those that are expected, the first of which names the others in
            errors; any if none is given.
    Raises:
        InputError: there is no manifest, or it is damaged, of another format or of another kind.
    """
    file = path
    if path.suffix != ".json" or path.is_dir():
        file = path / MANIFEST
        if not os.path.lexists(file):
            check_not_older(path)
            expected = KINDS[kinds[0]] if kinds else "a folder"
            raise InputError(f"is not {expected} of vibroswarm (there is no {MANIFEST})", field=str(path))
    values = read_json(file, "a manifest")
    check_format(entry(values, "format", int, file), FORMAT, str(path))
    kind = entry(values, "kind", str, file)
    if kind not in KINDS:
        raise InputError(f"is damaged: 'kind' is {shown(kind)}", field=str(file))
    if kinds and kind not in kinds:
        raise InputError(f"holds {KINDS[kind]}, not {KINDS[kinds[0]]}", field=str(path))
    return dict(values)


def check_not_older(folder: Path) -> None:
    """Refuse a folder that was written before all kinds of folders had one manifest.

    Raises:
        InputError: the folder has a manifest of ``OLDER``.
    """
    if any((folder / name).is_file() for name in OLDER):
        raise InputError(
            f"has no {MANIFEST}: it is damaged, or of an older format (before {FORMAT}), which this version does not "
            "read; recreate it",
            field=str(folder),
        )


def has_manifest(folder: Path) -> bool:
    """Return whether a folder has a manifest, readable or not."""
    return os.path.lexists(folder / MANIFEST)


def kind_of(folder: Path) -> str | None:
    """Return the kind of a folder; None if it has no manifest.

    Raises:
        InputError: the manifest is damaged or of another format, or the folder is of an older format.
    """
    if not has_manifest(folder):
        check_not_older(folder)
        return None
    return str(read_manifest(folder)["kind"])


def described_files(name: str, tables: Mapping[str, bytes]) -> dict[str, dict[str, Any]]:
    """Return what a manifest says of the files of tables, by name of the file: table, size, and SHA-256.

    Args:
        name: beginning of the files' names. tables: Parquet files as bytes, by table; the first is the main table.
    """
    main = next(iter(tables))
    return {
        f"{name}.parquet" if table == main else f"{name}.{table}.parquet": {
            "table": table,
            "bytes": len(data),
            "sha256": hashlib.sha256(data).hexdigest(),
        }
        for table, data in tables.items()
    }


def write_described(
    folder: Path, name: str, kind: str, tables: Mapping[str, bytes], **values: Any
) -> dict[str, Path]:
    """Write tables with their description, which comes last; make the folder if needed.

    Args:
        name: beginning of the files' names. kind: of the description. tables: as of ``described_files``.
        values: what else the description says.
    Returns: the path of each table.
    Raises:
        InputError: a file cannot be created. RunError: the disk is full or failed.
    """
    files = described_files(name, tables)
    contents: dict[str, str | bytes] = dict(zip(files, tables.values(), strict=True))
    contents[f"{name}.json"] = manifest_text(kind, **values, files=files)
    write_files(folder, contents)
    return {about["table"]: folder / file for file, about in files.items()}


def read_described(path: Path, kind: str) -> tuple[dict[str, Any], dict[str, Path]]:
    """Read the description of tables; check size and SHA-256 of their files, which lie beside it.

    Args:
        path: of the description, or the folder whose manifest it is. kind: of the description.
    Returns: the values of the description, and the path of each table.
    Raises:
        InputError: the description cannot be read, or a file is missing, elsewhere, cut off or changed.
    """
    values = read_manifest(path, kind)
    folder = path if path.is_dir() else path.parent
    files: dict[str, Path] = {}
    for name, about in entry(values, "files", dict, path).items():
        # A name that is a path could lead to any file of this computer.
        if Path(name).name != name:
            raise InputError(f"names a file elsewhere: {shown(name)}", field=str(path))
        size, sha256 = entry(about, "bytes", int, path), entry(about, "sha256", str, path)
        _check(folder / name, size, sha256)
        files[entry(about, "table", str, path)] = folder / name
    return values, files


def _check(path: Path, size: int, sha256: str) -> None:
    """Refuse a file that is missing, or has not the size and the content that its description gives."""
    if not path.is_file():
        raise InputError("is missing or not a plain file", field=str(path))
    found = path.stat().st_size
    if found != size:
        how = "is cut off" if found < size else "was added to"
        raise InputError(f"{how}: {found} bytes of {size}", field=str(path))
    with path.open("rb") as stream:
        if hashlib.file_digest(stream, "sha256").hexdigest() != sha256:
            raise InputError("is not what was written", field=str(path))
