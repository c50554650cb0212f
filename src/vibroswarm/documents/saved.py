"""What a folder of results holds besides tables: a page, pictures, and the document itself, to be shown again.

The file ``printed.json`` in the folder holds what the command printed, so that ``vibroswarm show`` can print it again:
the words of the command, such as "league", and the document without its figures (``show.data``). ``show`` lays tables
out for the width of its own terminal, with all columns if ``--wide``.

The manifest of a folder that no other module fills (``core.folders``, kind "results") names the command, and a hash of
its settings. It is written before anything else, so that a command that was killed can be given again.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from vibroswarm.core.atomic_io import MANIFEST, write_files
from vibroswarm.core.folders import REPORT, check_files, has_manifest, manifest_text, read_manifest
from vibroswarm.errors import InputError, shown, warn_once
from vibroswarm.show.data import document_from, document_values
from vibroswarm.show.document import Document

if TYPE_CHECKING:
    from vibroswarm.scenario.scenario import Scenario


def save(
    document: Document,
    folder: Path,
    command: str,
    work: str = "",
    *,
    page: str | None = REPORT,
    files: Mapping[str, Any] | None = None,
) -> None:
    """Write the page of a document into a folder, and the document itself, so that ``show`` can print it again.

    Args:
        command, work: as of ``begin``, which is called first.
        files: what ``printed.json`` says of the command's tables (``study.summary.write_table``).
    Raises:
        InputError, RunError: the folder cannot be written.
    """
    from vibroswarm.show.page import write_page

    begin(folder, command, work)
    if page is not None:
        write_page(folder / page, document)
    values = {"command": command, "document": document_values(document), "files": files or {}}
    write_files(folder, {PRINTED: manifest_text("document", **values)})


def begin(folder: Path, command: str, work: str = "") -> None:
    """Write into the manifest of a folder, made if needed, which command fills it; a study's stays as it is.

    Args:
        command: the words of the command, such as "lab import".
        work: hash of the command's settings (``hash_of``), by which ``refuse_other`` knows the folder again; empty if
            the folder is known by its own manifest, such as that of a study.
    Raises:
        InputError, RunError: the manifest cannot be read or written.
    """
    values = {"command": command, "work": work}
    if not has_manifest(folder):
        write_files(folder, {MANIFEST: manifest_text("results", **values)})
    elif work:
        there = read_manifest(folder)
        del there["format"]
        write_files(folder, {MANIFEST: manifest_text(there.pop("kind"), **there | values)})


def refuse_other(folder: Path, command: str, work: str = "") -> None:
    """Refuse a folder unless its manifest states the same command and the same settings (``begin``).

    Raises:
        InputError: the folder is refused.
    """
    if all(path.name.startswith(".") for path in folder.iterdir()):
        return  # killed before it had written its manifest, or locked
    there = read_manifest(folder)
    if not there.get("command"):
        raise InputError(f"exists already but holds no results of '{command}'", field=str(folder))
    if there["command"] != command:
        raise InputError(f"exists already and holds results of {shown(there['command'])}", field=str(folder))
    if there.get("work") != work:
        raise InputError(
            f"exists already and holds results of '{command}' with other settings", field=str(folder)
        )


def refuse_other_run(folder: Path, scenario: Scenario, seed: int, motion: str) -> None:
    """Refuse a folder unless it holds the result of the same run, made by the same version of the code.

    A run is the same if scenario, seed and motion source are equal.

    Raises:
        InputError: the folder is refused.
    """
    from vibroswarm.core.jit import source_hash

    try:
        there = read_manifest(folder, "result")
    except InputError as error:
        raise InputError(f"exists already: {error.reason}", field=str(folder)) from None
    if there["versions"].get("code") != source_hash():
        raise InputError("exists already and was made by another version of vibroswarm", field=str(folder))
    if there["scenario_hash"] != scenario.hash:
        raise InputError("exists already and holds a run of another scenario", field=str(folder))
    if (there["seed"], there["source"]) != (seed, motion):
        what = f"a run with seed {there['seed']} by '{there['source']}'"
        raise InputError(f"exists already and holds {what}", field=str(folder))
    try:
        check_files(there, folder)
    except InputError as error:
        warn_once(f"{error}; it is computed again")


PRINTED: Final = "printed.json"
"""Name of the file with what a command printed."""


class Shown(NamedTuple):
    """What a folder holds."""

    documents: tuple[Document, ...] = ()
    """The state of a study or search, if there is one, and the results."""
    command: str = ""
    """The command whose results were saved; empty: not known."""
    state: Mapping[str, Any] = MappingProxyType({})
    """Of a study or search: how much is done, for JSON; otherwise empty."""


def hash_of(*parts: object) -> str:
    """Return 16 hexadecimal digits that identify a command's work: the hash of its settings.

    Args:
        parts: the settings. Their ``repr`` must be the same in every process.
    """
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]


def read_printed(folder: Path) -> Shown | None:
    """Read ``printed.json`` of a folder; None if the folder has no such file.

    Raises:
        InputError: the file is damaged, of a newer format, or no plain file.
    """
    path = folder / PRINTED
    if not os.path.lexists(path):  # what is there but is no plain file is refused below
        return None
    values = read_manifest(path, "document")
    return Shown((document_from(values["document"], str(path)),), values["command"])
