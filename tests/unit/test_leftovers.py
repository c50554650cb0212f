"""What killed processes leave is removed, and nothing else; files get the modes that the user's mask gives."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

import vibroswarm
from vibroswarm.core import atomic_io
from vibroswarm.core.atomic_io import OLD_MARK, remove_leftovers, tag, whole_file, whole_folder
from vibroswarm.core.untrusted_files import read_text
from vibroswarm.errors import InputError
from vibroswarm.study.spec import Study
from vibroswarm.study.store import SHARDS, Store

needs_posix = pytest.mark.skipif(os.name != "posix", reason="whether a process lives cannot be asked")


def run(text: str) -> subprocess.CompletedProcess[str]:
    env = os.environ | {"PYTHONPATH": str(Path(vibroswarm.__file__).parents[1])}
    return subprocess.run([sys.executable, "-c", text], env=env, capture_output=True, text=True, timeout=60)


@pytest.fixture
def dead() -> str:
    """A name's tag of a process that has ended."""
    return run("from vibroswarm.core.atomic_io import tag; print(tag())").stdout.strip()


KILLED = """
import os, signal
from pathlib import Path
from vibroswarm.core.atomic_io import whole_file, whole_folder
with {with_}(Path({path!r})) as part:
    {write}
    os.kill(os.getpid(), signal.SIGKILL)
"""


@needs_posix
def test_what_a_killed_process_had_begun_is_removed_by_the_next(tmp_path: Path) -> None:
    file, folder = tmp_path / "table.csv", tmp_path / "result"
    assert (
        run(KILLED.format(with_="whole_file", path=str(file), write="part.write_text('x')")).returncode == -9
    )
    made = run(KILLED.format(with_="whole_folder", path=str(folder), write="(part / 'x').write_text('x')"))
    assert made.returncode == -9
    assert [path.name[:8] for path in tmp_path.glob(".*")] == [".result."], (
        "and the file of the first is gone"
    )
    with whole_folder(folder) as part:
        (part / "scenario.toml").touch()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["result"]
    assert (
        run(KILLED.format(with_="whole_file", path=str(file), write="part.write_text('x')")).returncode == -9
    )
    atomic_io._cleaned_folders.clear()
    with whole_file(file) as part:
        part.write_text("y")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["result", "table.csv"]


@needs_posix
@pytest.mark.parametrize("with_", ["whole_file", "whole_folder"])
def test_an_unfinished_one_whose_name_ends_in_old_is_not_moved_back(with_: str, tmp_path: Path) -> None:
    """Folders that were moved aside have ".old." in their temporary names too."""
    write = "(part / 'x').write_text('x')" if with_ == "whole_folder" else "part.write_text('x')"
    assert run(KILLED.format(with_=with_, path=str(tmp_path / "a.old"), write=write)).returncode == -9
    assert len(list(tmp_path.iterdir())) == 1
    assert remove_leftovers(tmp_path) == 1
    assert list(tmp_path.iterdir()) == []


@needs_posix
def test_only_what_is_ours_and_dead_is_removed(tmp_path: Path, dead: str) -> None:
    host = dead.split("-")[0]
    stay = [
        f".a.csv.{tag()}.csv",  # this process lives
        f".a.csv.{dead.replace(host, 'vs00000000')}.csv",  # on another machine
        f".a.csv.{dead[:-1]}",
        f"a.csv.{dead}",
        ".a.csv.0123456789ab.csv",
        ".hidden",
        "vibroswarm-notes",
        f"x.{dead}",
    ]
    for name in stay:
        (tmp_path / name).touch()
    (tmp_path / f".a.csv.{dead}.csv").touch()
    (tmp_path / f".a folder.{dead}").mkdir()
    (tmp_path / f".a folder.{dead}" / "x").touch()
    (tmp_path / f"vibroswarm-{dead}").mkdir()
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "x").touch()
    (tmp_path / f".link.{dead}").symlink_to(tmp_path / "elsewhere")
    assert remove_leftovers(tmp_path) == 4
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*stay, "elsewhere"])
    assert (tmp_path / "elsewhere" / "x").exists()
    assert remove_leftovers(tmp_path / "not there") == 0


@needs_posix
def test_a_result_moved_out_of_the_way_by_a_killed_process_comes_back(tmp_path: Path, dead: str) -> None:
    (tmp_path / f".result.{OLD_MARK}{dead}").mkdir()
    (tmp_path / f".result.{OLD_MARK}{dead}" / "scenario.toml").touch()
    remove_leftovers(tmp_path)
    assert [path.name for path in tmp_path.rglob("*")] == ["result", "scenario.toml"]


KILLED_IN_REMOVAL = """
import os, shutil, signal
from pathlib import Path
from vibroswarm.core import atomic_io
def killed(path, **options):
    (Path(path) / "table.csv").unlink()
    os.kill(os.getpid(), signal.SIGKILL)
shutil.rmtree = killed
path = Path({path!r})
{remove}
"""


@needs_posix
@pytest.mark.parametrize(
    "remove", ["atomic_io.remove_folder(path)", "atomic_io.remove_leftovers(path.parent)"]
)
def test_a_folder_that_is_half_removed_does_not_come_back(remove: str, tmp_path: Path, dead: str) -> None:
    path = tmp_path / "result"
    folders = [path, tmp_path / f".result.{OLD_MARK}{dead}"]
    for folder in folders if "leftovers" in remove else [path]:
        folder.mkdir()
        for name in ("scenario.toml", "table.csv"):
            (folder / name).touch()
    assert run(KILLED_IN_REMOVAL.format(path=str(path), remove=remove)).returncode == -9
    if path.exists():  # the user removes the newer result, beside which the older one was being removed
        (path / "table.csv").unlink()
        (path / "scenario.toml").unlink()
        path.rmdir()
    remove_leftovers(tmp_path)
    assert list(tmp_path.iterdir()) == []


@needs_posix
def test_a_store_is_tidied_when_it_is_gone_on_with(tmp_path: Path, dead: str) -> None:
    study = Study({"run": {"t_end_s": 60.0}}, {}, 2, seed=1)
    Store.open_or_create(tmp_path / "s", study)
    (tmp_path / "s" / SHARDS / f".x.parquet.{dead}.parquet").touch()
    assert Store.open(tmp_path / "s").left_over == 1
    assert Store.open_or_create(tmp_path / "s", study).left_over == 0


@needs_posix
@pytest.mark.parametrize("mask", [0o022, 0o077, 0o002])
def test_the_mask_of_the_process_is_kept_and_not_touched(mask: int, tmp_path: Path) -> None:
    text = f"""
import os
from pathlib import Path
from vibroswarm.core.atomic_io import whole_file, whole_folder
os.umask({mask})
def never(mask):
    raise AssertionError("another thread may be making a file just now")
os.umask = never
with whole_file(Path({str(tmp_path / "file.csv")!r})) as part:
    part.write_text("x")
with whole_folder(Path({str(tmp_path / "folder")!r})) as part:
    (part / "x").touch()
"""
    done = run(text)
    assert done.returncode == 0, done.stderr
    assert stat.S_IMODE((tmp_path / "file.csv").stat().st_mode) == 0o666 & ~mask
    assert stat.S_IMODE((tmp_path / "folder").stat().st_mode) == 0o777 & ~mask


@needs_posix
def test_a_private_folder_stays_private_when_it_is_written(tmp_path: Path) -> None:
    folder = tmp_path / "private"
    folder.mkdir(mode=0o700)
    with whole_folder(folder) as part:
        (part / "x").touch()
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


@needs_posix
def test_a_folder_that_may_not_be_written_to_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frozen = tmp_path / "frozen"
    frozen.mkdir()
    monkeypatch.setattr(
        os, "access", lambda place, mode: place != frozen
    )  # as the system does, except for root
    for path in (frozen, frozen / "new" / "deeper"):
        with pytest.raises(InputError, match="frozen' may not be written to"), whole_folder(path):
            pass


def test_a_folder_of_which_a_part_cannot_be_removed_stays_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "result"
    shards = path / "shards"
    shards.mkdir(parents=True)
    (path / "study.toml").touch()
    monkeypatch.setattr(
        os, "access", lambda place, mode: Path(place) != shards
    )  # as the system does, except for root
    words = r"cannot be removed: '.*shards' may not be written to"
    with pytest.raises(InputError, match=words), whole_folder(path, replace=True):
        pass
    with pytest.raises(InputError, match=words):
        atomic_io.remove_folder(path)
    assert sorted(tmp_path.rglob("*")) == [path, shards, path / "study.toml"]


@pytest.mark.parametrize("letter", ["n", "\u8a08"])  # one byte, and three in UTF-8
def test_names_as_long_as_a_file_system_allows_are_written(letter: str, tmp_path: Path) -> None:
    size = len(letter.encode())
    with whole_file(tmp_path / (letter * (240 // size) + ".csv")) as part:
        part.write_text("x")
    folder = tmp_path / (letter * (250 // size))
    for k in range(2):
        with whole_folder(folder, replace=True, marker="x") as part:
            (part / "x").write_text(str(k))
    assert (folder / "x").read_text() == "1", "replaced"
    assert len(list(tmp_path.iterdir())) == 2


AT_ONCE = """
import sys
from pathlib import Path
from vibroswarm.core.atomic_io import whole_folder
for k in range(60):
    with whole_folder(Path(sys.argv[1]), replace=True, marker="m") as part:
        (part / "m").write_text(str(k))
        (part / "n").write_text(str(k))
"""


def test_several_processes_that_replace_one_folder_do_not_stop_each_other(tmp_path: Path) -> None:
    env = os.environ | {"PYTHONPATH": str(Path(vibroswarm.__file__).parents[1])}
    command = [sys.executable, "-c", AT_ONCE, str(tmp_path / "out")]
    writers = [subprocess.Popen(command, env=env, stderr=subprocess.PIPE, text=True) for _ in range(3)]
    said = [writer.communicate(timeout=60)[1] for writer in writers]
    assert [writer.returncode for writer in writers] == [0, 0, 0], said
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    assert (tmp_path / "out" / "m").read_text() == (tmp_path / "out" / "n").read_text() == "59"


@pytest.mark.parametrize("name", ["a\0b", "a/" * 2000 + "b"], ids=["nul", "deep"])
def test_impossible_names_are_refused_by_name(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    for write in (atomic_io.make_folder, lambda path: atomic_io.write_files(path, {"x": "y"})):
        with pytest.raises(InputError, match="there is no such name"):
            write(path)
    with pytest.raises(InputError, match=r"no such name|not a valid folder name"), whole_folder(path):
        pass


def test_a_device_without_data_is_read_as_nothing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A read without waiting gives None, as of /proc/kmsg; a pipe that takes a file's place does it too."""
    ours, theirs = os.pipe()
    (tmp_path / "x").write_text("x")
    monkeypatch.setattr(os, "open", lambda *given: ours)
    os.set_blocking(ours, False)
    assert read_text(tmp_path / "x", "a text") == ""
    monkeypatch.undo()
    os.close(theirs)
