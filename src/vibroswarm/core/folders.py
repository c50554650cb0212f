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

A manifest has the SHA-256 of its own values (``SEAL``), and size and SHA-256 of the files that are read back. Manifests
of version 0.2 lack some of them; what they do not say is not checked.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Final

from vibroswarm.core.atomic_io import MANIFEST, write_files
from vibroswarm.core.untrusted_files import entry, read_json, texts
from vibroswarm.errors import InputError, check_format, shown

REPORT: Final = "report.html"
"""Name of the page in a folder of results."""
PICTURES: Final = "pictures"
"""Name of the folder of pictures in a folder of results."""
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
OF_FILES: Final = ("batch", "step", "fresh", "failure", "document")
"""Kinds of manifests that no folder has: they describe files beside them."""
OLDER: Final = ("result.json", "recording.json", "study.json", "search.json", "item.json", "printed.json")
"""Files of folders before format 6, when each kind had its own manifest, of which a folder without manifest has one."""


SEAL: Final = "sha256"
"""Key of the hash of a manifest's other values."""


def manifest_text(kind: str, **values: Any) -> str:
    """Return the text of a manifest: the format, the kind (of ``KINDS``), the values of that kind, and their hash."""
    assert kind in KINDS
    values = {"format": FORMAT, "kind": kind, **values}
    # A document may hold tables of 100,000 rows; two thirds of the file would be indents.
    indent = None if kind == "document" else 1
    return json.dumps({**values, SEAL: seal_of(values)}, indent=indent, allow_nan=False) + "\n"


def seal_of(values: Mapping[str, Any]) -> str:
    """Return the SHA-256 of the values of a manifest, in the order in which they are written.

    Raises:
        ValueError, RecursionError: JSON cannot hold the values.
    """
    return hashlib.sha256(json.dumps(values, allow_nan=False).encode()).hexdigest()


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
    if kind not in KINDS or (file != path and kind in OF_FILES):
        raise InputError(f"is damaged: 'kind' is {shown(kind)}", field=str(file))
    if kinds and kind not in kinds:
        raise InputError(f"holds {KINDS[kind]}, not {KINDS[kinds[0]]}", field=str(path))
    seal = values.pop(SEAL, None)
    if seal is not None and seal != _seal_found(values):
        raise InputError(f"{DAMAGED}: its values were changed", field=str(file))
    return dict(values)


def read_definition(folder: Path, kind: str) -> dict[str, Any]:
    """Read the manifest of a study or a search, whose ``hash`` is a text, and whose ``versions`` are texts by name.

    Raises:
        InputError: as of ``read_manifest``, or these are missing or something else.
    """
    values, path = read_manifest(folder, kind), folder / MANIFEST
    entry(values, "hash", str, path)
    texts(entry(values, "versions", dict, path), "versions", path)
    return values


DAMAGED: Final = "is damaged, not what was written"
"""Beginning of messages about files that were changed."""


def _seal_found(values: Mapping[str, Any]) -> str:
    """Return the hash of values from a file of any content; empty if they have none."""
    try:
        return seal_of(values)
    except (ValueError, RecursionError):
        return ""


def check_definition(
    file: Path, found: str, saved: str, made_by: Mapping[str, str], *, same_text: bool = True
) -> None:
    """Refuse a scenario, study or search in a folder that is not the one for which the folder was made.

    Args:
        file: that has it. found: its hash. saved: the hash that the manifest names.
        made_by: versions that made the folder: others may make other hashes, as they know other fields.
        same_text: whether its text is as it was, which decides for other versions.
    Raises:
        InputError: it is another one.
    """
    from vibroswarm.core.jit import source_hash  # which takes a while, and is rarely needed

    if found != saved and (not same_text or made_by.get("code") == source_hash()):
        raise InputError(
            f"is not that for which the folder was made (hash {saved}); restore it", field=str(file)
        )


def check_not_older(folder: Path) -> None:
    """Refuse a folder that was written before all kinds of folders had one manifest.

    Raises:
        InputError: the folder has a manifest of ``OLDER``, or cannot be read.
    """
    if any(path.name in OLDER and path.is_file() for path in matching(folder, "*.json")):
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


def about_file(data: bytes) -> dict[str, Any]:
    """Return what a manifest says of a file: its size and SHA-256."""
    return {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}


def write_described(
    folder: Path, name: str, kind: str, tables: Mapping[str, bytes], **values: Any
) -> dict[str, Path]:
    """Write tables with their description, which comes last; make the folder if needed.

    Args:
        name: beginning of the files' names. kind: of the description.
        tables: Parquet files as bytes, by table; the first is the main table.
        values: what else the description says.
    Returns: the path of each table.
    Raises:
        InputError: a file cannot be created. RunError: the disk is full or failed.
    """
    main = next(iter(tables))
    names = {table: f"{name}.parquet" if table == main else f"{name}.{table}.parquet" for table in tables}
    files = {names[table]: {"table": table, **about_file(data)} for table, data in tables.items()}
    contents: dict[str, str | bytes] = {names[table]: data for table, data in tables.items()}
    contents[f"{name}.json"] = manifest_text(kind, **values, files=files)
    write_files(folder, contents)
    return {table: folder / file for table, file in names.items()}


def matching(folder: Path, pattern: str) -> list[Path]:
    """Return what in a folder has a name of a pattern, sorted; nothing if there is no such folder.

    Raises:
        InputError: the folder cannot be read; ``Path.glob`` would find nothing in it.
    """
    try:
        found = list(folder.iterdir()) if folder.is_dir() else []
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}", field=str(folder)) from None
    return sorted(path for path in found if fnmatchcase(path.name, pattern))


def check_is_folder(folder: Path) -> None:
    """Raise an InputError if something other than a folder has the name of a folder of tables."""
    if os.path.lexists(folder) and not folder.is_dir():
        raise InputError("is not a folder; move it away", field=str(folder))


def check_places(folder: Path) -> None:
    """Refuse a file in the place of a folder of tables, and a folder, pipe or device in the place of one of its files.

    Damaged files are written again, but nothing that somebody put in the place of one is removed for that.

    Raises:
        InputError: there is one; the message names it.
    """
    check_is_folder(folder)
    for path in matching(folder, "[!.]*"):
        if path.suffix in (".json", ".parquet") and path.exists() and not path.is_file():
            raise InputError("is in the place of a file: move it away", field=str(path))


def read_described(path: Path, kind: str) -> tuple[dict[str, Any], dict[str, Path]]:
    """Read the description of tables; check size and SHA-256 of their files, which lie beside it.

    Args:
        path: of the description, or the folder whose manifest it is. kind: of the description.
    Returns: the values of the description, and the path of each table.
    Raises:
        InputError: the description cannot be read, or a file is missing, elsewhere, cut off or changed.
    """
    values = read_manifest(path, kind)
    entry(values, "files", dict, path)
    return values, check_files(values, path)


def check_files(values: Mapping[str, Any], path: Path) -> dict[str, Path]:
    """Check size and SHA-256 of the files that a manifest names, which lie beside it; return their paths, by table.

    Args:
        values: of the manifest. path: of the manifest, or the folder whose manifest it is.
    Raises:
        InputError: a file is missing, elsewhere, cut off or changed.
    """
    folder = path if path.is_dir() else path.parent
    files: dict[str, Path] = {}
    for name, about in entry({"files": {}, **values}, "files", dict, path).items():
        # A name that is a path could lead to any file of this computer; one of another description, to its table.
        if Path(name).name != name or (path != folder and name.partition(".")[0] != path.stem):
            raise InputError(f"names a file elsewhere: {shown(name)}", field=str(path))
        size, sha256 = entry(about, "bytes", int, path), entry(about, "sha256", str, path)
        _check(folder / name, size, sha256)
        # The file of a table has its name, unless the description says another table.
        files[entry({"table": Path(name).stem, **about}, "table", str, path)] = folder / name
    return files


def check_written(path: Path, *manifests: str) -> None:
    """Check a file of a folder, if a manifest there names it.

    Args:
        manifests: names of the files that may name it, besides the folder's manifest and its description.
    Raises:
        InputError: the file is cut off or changed.
    """
    for name in (MANIFEST, f"{path.name.partition('.')[0]}.json", *manifests):
        try:
            files = read_manifest(path.with_name(name)).get("files", {})
        except InputError:  # another file of this name, or none
            continue
        if path.name in files:
            check_files({"files": {path.name: files[path.name]}}, path.parent)


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
            raise InputError(DAMAGED, field=str(path))
