"""The hash of the code changes with what code does, and with nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest

from vibroswarm.core import code_version
from vibroswarm.core.code_version import code_hash, syntax_hash
from vibroswarm.core.jit import cache_folder, compiles, source_hash

BEFORE = '''"""What this is."""

LIMIT = 3
"""A limit."""


def add(a, b=1):
    """Add."""
    return a + b  # both
'''


def hash_of(folder: Path, text: str, name: str = "a.py") -> str:
    (folder / name).write_text(text, encoding="utf-8")
    return syntax_hash(folder, [folder / name])


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("What this is.", "Something else, said better."),
        ('    """Add."""\n', ""),
        ("A limit.", "The limit."),
        ("  # both", ""),
        ("\n\n\n", "\n\n\n\n# A line more.\n"),
        ("a + b", "(a\n        + b)"),
    ],
)
def test_words_and_layout_change_nothing(tmp_path: Path, old: str, new: str) -> None:
    assert old in BEFORE
    assert hash_of(tmp_path, BEFORE) == hash_of(tmp_path, BEFORE.replace(old, new))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("LIMIT = 3", "LIMIT = 4"),
        ("LIMIT = 3", "LIMIT = 0.0"),
        ("LIMIT = 3", "LIMIT = -0.0"),
        ("a + b", "b + a"),
        ("a + b", "a - b"),
        ("a + b", "(lambda: a + b)()"),
        ("a + b", "a in {'x', 'y'}"),
        ("b=1", "b=1.0"),
        ("b=1", "b=True"),
        ("b=1", "*, b=1"),
        ("def add", "def sum_"),
    ],
)
def test_code_changes_it(tmp_path: Path, old: str, new: str) -> None:
    assert old in BEFORE
    assert hash_of(tmp_path, BEFORE) != hash_of(tmp_path, BEFORE.replace(old, new))


def test_a_files_name_changes_it(tmp_path: Path) -> None:
    assert hash_of(tmp_path, BEFORE) != hash_of(tmp_path, BEFORE, "b.py")


@pytest.mark.skipif(not compiles(), reason="nothing is kept")
def test_it_is_kept_and_a_damaged_file_is_written_again(monkeypatch: pytest.MonkeyPatch) -> None:
    folder = cache_folder()
    assert folder is not None
    found = code_hash()
    path = folder / f"syntax-hash-{source_hash()}.txt"
    text = path.read_text(encoding="ascii")
    assert text.startswith(found)
    # Not computed again: it takes half a second.
    monkeypatch.setattr(code_version, "syntax_hash", lambda package, sources: found)
    other = "1" if found[0] == "0" else "0"
    for damaged in (b"\xff half a fi", text.replace(found[0], other, 1).encode(), found.encode(), b""):
        path.write_bytes(damaged)
        code_hash.cache_clear()
        assert code_hash() == found
        assert path.read_text(encoding="ascii") == text
