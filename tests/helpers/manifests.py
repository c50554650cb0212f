"""Folders that are changed on purpose, so that tests reach the checks behind those of hashes."""

from __future__ import annotations

import json
from pathlib import Path

from vibroswarm.core.folders import about_file, manifest_text


def resealed(manifest: Path) -> None:
    """Write a manifest as if its values, and the files that it names, had been written as they are now."""
    values = json.loads(manifest.read_text(encoding="utf-8"))
    for name, about in values.get("files", {}).items():
        about |= about_file((manifest.parent / name).read_bytes())
    values = {key: value for key, value in values.items() if key not in ("format", "kind")}
    kind = json.loads(manifest.read_text(encoding="utf-8"))["kind"]
    manifest.write_text(manifest_text(kind, **values), encoding="utf-8")
