"""What a folder of results holds besides tables: a page, pictures, and the document itself, to be shown again.

The file ``printed.json`` in the folder holds what the command printed, so that ``vibroswarm show`` can print it again:
the words of the command, such as "league", and the document without its figures (``show.data``). ``show`` lays tables
out for the width of its own terminal, with all columns if ``--wide``.

The manifest of a folder that no other module fills (``core.folders``, kind "results") names the command, and a hash of
its settings. It is written before anything else, so that a command that was killed can be given again.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from vibroswarm.core.atomic_io import MANIFEST, write_files
from vibroswarm.core.folders import REPORT, has_manifest, manifest_text, read_manifest
from vibroswarm.show.data import document_from, document_values
from vibroswarm.show.document import Document

if TYPE_CHECKING:
    pass


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
