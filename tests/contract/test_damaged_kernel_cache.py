"""No state of the folder of kept kernels stops a start or runs what is not a kernel's: it is said, once."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path

import pytest

import vibroswarm
from helpers.numba_programs import NumbaPrograms
from vibroswarm.core import kernel_cache
from vibroswarm.core.jit import PLAIN
from vibroswarm.core.kernel_cache import _Files

pytestmark = pytest.mark.skipif(PLAIN, reason="nothing is compiled")
needs_modes = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="no such modes")

KERNELS = """
from vibroswarm.core.jit import kernel

@kernel
def twice(x):
    return 2.0 * x

@kernel
def thrice(x):
    return 3.0 * x
"""
CALL = """
import two_kernels as k

print(k.twice(2.0), k.thrice(2.0), sum(sum(one.stats.cache_hits.values()) for one in (k.twice, k.thrice)))
"""


class Started:
    """Programs that use two kernels, begun one after the other with a cache of their own."""

    def __init__(self, folder: Path, programs: NumbaPrograms) -> None:
        self.folder, self.cache, self.programs = folder, folder / "cache", programs
        (folder / "two_kernels.py").write_text(KERNELS, encoding="utf-8")
        (folder / "call.py").write_text(CALL, encoding="utf-8")

    def __call__(self) -> tuple[int, str]:
        """How many of the two came from the cache, and what was said; both give what they should."""
        done = self.programs.run(self.folder / "call.py", cache=self.cache)
        assert done.returncode == 0, done.stderr
        *numbers, hits = done.stdout.split()
        assert numbers == ["4.0", "6.0"]
        return int(hits), done.stderr

    def files(self, suffix: str) -> list[Path]:
        return sorted(self.cache.rglob(f"two_kernels.*{suffix}"))


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory, numba_programs: NumbaPrograms) -> Started:
    """Both kernels are kept, with a copy of the cache beside it."""
    made = Started(tmp_path_factory.mktemp("kernels"), numba_programs)
    assert made() == (0, "")
    assert made() == (2, ""), "kept"
    assert len(made.files(".nbi")) == len(made.files(".nbc")) == 2
    shutil.copytree(made.cache, made.folder / "copy")
    return made


OF_PACKAGE = "from vibroswarm.core.jit import signed; print(signed(3), dict(signed.stats.cache_hits))"


def test_another_installation_of_the_same_sources_uses_the_same_kernels(
    tmp_path: Path, numba_programs: NumbaPrograms
) -> None:
    source, program = Path(vibroswarm.__file__).parent, tmp_path / "program.py"
    program.write_text(OF_PACKAGE, encoding="utf-8")
    for name in ("here", "there"):
        shutil.copytree(source, tmp_path / name / source.name, ignore=shutil.ignore_patterns("__pycache__"))
    said = []
    for name in ("here", "there", "there"):
        if said[1:]:  # the negative control: other sources have kernels of their own
            with (tmp_path / name / source.name / "core" / "ticks.py").open("a", encoding="utf-8") as changed:
                changed.write("# another line\n")
        env = os.environ | {"PYTHONPATH": str(tmp_path / name)}
        done = numba_programs.run(program, cache=tmp_path / "cache", env=env)
        assert done.returncode == 0, done.stderr
        said.append(done.stdout.split(maxsplit=1))
    assert [value for value, _ in said] == ["3", "3", "3"]
    assert [hits.strip() == "{}" for _, hits in said] == [True, False, True]


@pytest.fixture
def started(kept: Started) -> Started:
    """As it was when both had just been kept."""
    shutil.rmtree(kept.cache)
    shutil.copytree(kept.folder / "copy", kept.cache)
    (kept.folder / "two_kernels.py").write_text(KERNELS, encoding="utf-8")
    os.utime(kept.folder / "two_kernels.py", (1e9, 1e9))
    return kept


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:60])


def flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


def swap(path: Path) -> None:
    """The file of an older version, without a hash before it."""
    path.write_bytes(path.read_bytes()[32:])


@pytest.mark.parametrize("damage", [cut, flip, swap, lambda path: path.write_bytes(b"")])
def test_damage_of_any_kind_is_seen(
    damage: Callable[[Path], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    monkeypatch.setattr(kernel_cache, "warn_once", said.append)
    files, path = _Files(str(tmp_path), "a kernel", b"stamp"), tmp_path / "a kernel.1.nbc"
    files._save_data(path.name, list(range(50)))
    assert files._load_data(path.name) == list(range(50))
    assert said == []
    damage(path)
    with pytest.raises(FileNotFoundError):
        files._load_data(path.name)
    assert len(said) == 1


@pytest.mark.slow
def test_damaged_files_are_written_anew(started: Started) -> None:
    flip(started.files(".nbi")[0])
    cut(started.files(".nbc")[1])
    hits, said = started()
    assert hits == 0
    assert said.count("are damaged and") == 1
    assert started() == (2, "")
    assert len(started.files(".nbc")) <= 3


def test_what_cannot_be_written_is_compiled_in_memory(started: Started) -> None:
    for path in started.files(".nbi"):
        path.unlink()
        path.mkdir()
    hits, said = started()
    assert hits == 0
    assert said.count("those not saved") == 1


def test_a_file_in_the_place_of_the_folder(started: Started) -> None:
    shutil.rmtree(started.cache)
    started.cache.mkdir()
    (started.cache / "vibroswarm").touch()
    hits, said = started()
    assert hits == 0
    assert said.count("kernels are not cached") == 1


@needs_modes
@pytest.mark.parametrize("below", [".", "vibroswarm", "vibroswarm/kernels", "vibroswarm/kernels/a key"])
def test_a_folder_that_others_may_write_to_is_not_safe(below: str, tmp_path: Path) -> None:
    base = tmp_path / "cache"
    folder = base / "vibroswarm" / "kernels" / "a key"
    for place in (*reversed(folder.parents[:3]), folder):
        place.mkdir(mode=0o700, exist_ok=True)
    base.chmod(0o1777)  # a sticky folder above is as good as any
    assert kernel_cache.why_unsafe(folder, base) is None
    (base / below).chmod(0o777)
    assert "may write to" in str(kernel_cache.why_unsafe(folder, base))


@needs_modes
@pytest.mark.skipif(hasattr(os, "geteuid") and os.geteuid() != 0, reason="only root gives files away")
def test_a_folder_of_another_user_is_not_safe(tmp_path: Path) -> None:
    folder = tmp_path / "kernels"
    folder.mkdir(mode=0o700)
    os.chown(folder, 65534, -1)
    assert "belongs to another user" in str(kernel_cache.why_unsafe(folder, tmp_path))


@needs_modes
def test_a_folder_that_others_may_write_to_is_not_used(started: Started) -> None:
    (place,) = started.cache.glob("vibroswarm/kernels/*")
    place.chmod(0o777)
    hits, said = started()
    assert hits == 0
    assert said.count("may write to") == 1


@needs_modes
def test_folders_are_made_for_the_user_alone(kept: Started) -> None:
    (place,) = (kept.folder / "copy").glob("vibroswarm/kernels/*")
    assert all(one.stat().st_mode & 0o077 == 0 for one in (place, *list(place.parents)[:3]))


def test_a_source_whose_time_is_still_to_come_is_kept(started: Started) -> None:
    source = started.folder / "two_kernels.py"
    os.utime(source, (time.time() + 1e6, time.time() + 1e6))
    assert started() == (2, "")


@pytest.mark.parametrize("changes", [True, False])
def test_kernels_of_a_source_that_has_changed_since_it_was_imported_are_not_kept(
    tmp_path: Path, changes: bool, numba_programs: NumbaPrograms
) -> None:
    """Nor one declared later, which may call the changed source; where nothing changes, all are kept."""
    started = Started(tmp_path, numba_programs)
    imports = "from two_kernels import twice\nfrom vibroswarm.core.jit import kernel\n\n"
    later = imports + "@kernel\ndef four(x):\n    return twice(twice(x))\n"
    (tmp_path / "later.py").write_text(later, encoding="utf-8")
    touch = "import os\nimport vibroswarm.core.jit\nos.utime(__file__)\n" if changes else ""
    (tmp_path / "two_kernels.py").write_text(touch + KERNELS, encoding="utf-8")
    os.utime(tmp_path / "two_kernels.py", (time.time() - 60, time.time() - 60))
    (tmp_path / "call.py").write_text(
        "from later import four\n" + CALL + "assert four(1.0) == 4.0\n", encoding="utf-8"
    )
    os.utime(tmp_path / "later.py", (time.time() - 60, time.time() - 60))
    assert started() == (0, "")
    for name in ("two_kernels", "later"):
        assert (list(started.cache.rglob(f"{name}.*.nbc")) == []) == changes
