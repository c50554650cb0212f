"""Store a study in a folder to which batches are only ever added.

    study.toml          the study, self-contained
    vibroswarm.json     the manifest: hash of the study, versions
    shards/NAME.*       tables of a batch with their description (``core.folders``); NAME is a hash of its content
    failures/*.json     batches that failed for good; ignored once their runs are stored

A shard is a stored batch: its tables and its description. Each file of a shard is written atomically under a name made
from its content, and there is no index. So several writers need no coordination on any file system with atomic
renames, and a batch that runs twice gives the same file.
"""

from __future__ import annotations

import hashlib
import json
import shlex
import time
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import polars as pl

from vibroswarm.core.atomic_io import MANIFEST, make_folder, write_file
from vibroswarm.core.folders import (
    DAMAGED,
    has_manifest,
    manifest_text,
    read_described,
    read_manifest,
    write_described,
)
from vibroswarm.core.untrusted_files import parsed_toml, read_text
from vibroswarm.errors import InputError, RunError, in_file
from vibroswarm.result import code_files, write_code
from vibroswarm.simulation import versions
from vibroswarm.study.batch import Batch, BatchResult, check_shard
from vibroswarm.study.executors import check_begun_by
from vibroswarm.study.plan import Group, Range, missing, plan_of
from vibroswarm.study.registered_code import check_registered
from vibroswarm.study.spec import MOST_RUNS, Study, as_toml

MARKER: Final = "study.toml"
"""File of the study's text."""
SHARDS: Final = "shards"
"""Folder of the stored batches."""
FAILURES: Final = "failures"
"""Folder of the records of failed batches."""


def resume_command(folder: str | Path) -> str:
    """Return the command that goes on with the study in a folder, as a shell takes it."""
    return shlex.join(["vibroswarm", "evaluate", f"{folder}/{MARKER}", "--out", str(folder)])


@dataclass(frozen=True)
class Shard:
    """A stored batch: its group and runs, and its files by table."""

    name: str
    group: int
    first: int
    """First run."""
    last: int
    """One past the last run."""
    rows: int
    """Number of rows of the table ``robots``."""
    files: Mapping[str, Path]
    """Path of each table, by its name."""
    made_by: Mapping[str, str]
    """``simulation.versions`` of the worker."""


COARSE_NS: Final = 20_000_000
"""How much earlier than the clock a time of change may be, ns: file systems count in steps."""
_checked: Final[dict[tuple[Path, str], tuple[list[Any], Shard]]] = {}
"""Shards that this process has read and checked, by description and hash of the study, with the ``identity`` of their
files: a command opens a study several times, and reading a shard takes milliseconds."""


@dataclass
class Store:
    """A study's folder, opened by ``existing``, ``open_or_create`` or ``open``."""

    folder: Path
    """As given, for messages."""
    study: Study
    by_group: dict[int, list[Shard]] = field(default_factory=dict)
    """The stored batches that can be used, by group."""
    hash: str = ""
    """Hash of the study, as the version of this program that made the folder computed it; all shards name it."""
    command: str = ""
    """The words of the command that continues the study; empty: ``evaluate``."""
    broken: dict[str, str] = field(default_factory=dict)
    """Shards that cannot be used, and why."""
    left_over: int = 0
    """Number of useless files that killed writers left in the folder of shards."""
    root: Path = field(init=False)
    """The folder, also once the process works in another one."""

    def __post_init__(self) -> None:
        self.hash = self.hash or self.study.hash
        self.root = self.folder.absolute()

    @property
    def shards(self) -> list[Shard]:
        """The stored batches that can be used."""
        return [shard for shards in self.by_group.values() for shard in shards]

    @property
    def damaged(self) -> list[str]:
        """Shards that cannot be used, with the reason, one line each."""
        return [f"{name}.json: {reason}" for name, reason in self.broken.items()]

    @classmethod
    def existing(cls, folder: str | Path, study: Study, *, shards: bool = True) -> Store | None:
        """Open the store of this study if it exists, without writing anything.

        The store's study becomes ``study``: its number of runs or its name may differ from what the folder says.

        Args:
            shards: whether to read and check the shards too, which takes some milliseconds for each.
        Returns: None if the folder holds no store yet, and may become one.
        Raises:
            InputError: the folder holds something else, another study, a study of another format, or runs of other
                code that has been registered (``registered_code``).
        """
        folder = Path(folder)
        try:
            if has_manifest(folder):
                store = cls.open(folder, shards=shards)
                if store.study.hash != study.hash:
                    raise InputError(_differences(store.study, study), field=str(folder))
                check_registered(store.made_by, folder, (cell.scenario for cell in study.cells), study.motion)
                store.study = study
                return store
            # A folder without a manifest may have files of another writer of this study, which was killed or is just
            # making the store. Such a folder is accepted.
            if folder.exists() and not (folder.is_dir() and all(_is_of(p, study) for p in folder.iterdir())):
                if has_manifest(folder):  # another writer has written it since the check above
                    return cls.existing(folder, study, shards=shards)
                raise InputError(
                    "exists but is not a study; give the name of a new folder", field=str(folder)
                )
        except OSError as error:
            raise InputError(f"cannot be read: {error.strerror or error}", field=str(folder)) from None
        return None

    @classmethod
    def open_or_create(cls, folder: str | Path, study: Study) -> Store:
        """Open the store of this study, or make it; temporary files that killed writers left are removed.

        Raises:
            InputError: the folder holds something else, another study, or a study of another format; a folder or a
                pipe is in the place of a file; the folder cannot be made; or two files of users' code have one name.
            RunError: the folder cannot be written.
        """
        folder = Path(folder)
        store = cls.existing(folder, study)
        if store is None:
            # Two different files of one name are refused before anything is written.
            code_files((cell.scenario for cell in study.cells), study.motion)
            make_folder(folder / SHARDS)
            store = cls(folder, study, command=study.command)
        store.write_head()
        return store

    @classmethod
    def open(cls, folder: str | Path, *, shards: bool = True) -> Store:
        """Open the store in a folder and check its shards; shards that cannot be used are listed in ``broken``.

        Args:
            shards: as in ``existing``.
        Raises:
            InputError: the folder holds no study, a study of another format, or a damaged one; or something else is in
                the place of its shards.
        """
        folder = Path(folder)
        manifest = read_manifest(folder, "study")
        saved_hash = manifest["hash"]
        text = read_text(folder / MARKER, "a study")
        with in_file(folder / MARKER):
            study = Study.from_toml(text, name=str(folder / MARKER), folder=folder)
        if not _is_as_written(text):
            raise InputError(
                f"{DAMAGED}; restore it (--runs changes the number of runs)", field=str(folder / MARKER)
            )
        store = cls(folder, study, hash=saved_hash, command=manifest.get("command", ""))
        if shards:
            store.refresh()
        return store

    def as_given(self, error: Exception) -> str:
        """Return the words of an error, with the folder as it was given."""
        return str(error).replace(str(self.root), str(self.folder))

    def refresh(self) -> None:
        """Read the descriptions of all shards again, and set ``by_group``, ``broken`` and ``left_over``.

        Files left over are temporary files, and tables without a description: their writer was killed before it wrote
        the description, which is written last.
        """
        self.by_group, self.broken, self.left_over = {}, {}, 0
        described = set()  # the tables of all shards that can be used
        for path in sorted((self.root / SHARDS).glob("*")):
            if path.name.startswith("."):  # a temporary file
                self.left_over += 1
            elif path.suffix == ".json":
                try:
                    shard = self._shard(path)
                except ValueError as error:  # its message says what is wrong
                    self.broken[path.stem] = self.as_given(error)
                except OSError as error:  # its message does not say that a shard is damaged
                    self.broken[path.stem] = f"is damaged: {error}"
                else:
                    self.by_group.setdefault(shard.group, []).append(shard)
                    described |= set(shard.files.values())
        # A table that no usable shard has is not left over if its description exists: the description is broken, or
        # another writer has just written it.
        tables = set((self.root / SHARDS).glob("[!.]*.parquet"))
        descriptions = [path.with_name(f"{path.name.partition('.')[0]}.json") for path in tables - described]
        self.left_over += sum(not description.is_file() for description in descriptions)

    def add(self, done: BatchResult) -> None:
        """Save a finished batch, its description last, and remove the record of its failure if there is one.

        Raises:
            RunError: the disk is full or failed; no file is incomplete.
        """
        # The shard's name is made from its content, so that a batch that runs twice gives the same files.
        name = hashlib.sha256(done.files["robots"]).hexdigest()[:24]
        work = done.work
        try:
            files = write_described(
                self.root / SHARDS,
                name,
                "batch",
                done.files,
                study=self.hash,
                group=work.group,
                first=work.first,
                last=work.last,
                seed=work.seed,
                rows=done.rows,
                versions=done.versions,
            )
        except (
            InputError
        ) as error:  # not the user's mistake, since the folder could be written when the study began
            raise RunError(str(error)) from error
        self.broken.pop(name, None)
        shard = Shard(
            name=name,
            group=work.group,
            first=work.first,
            last=work.last,
            rows=done.rows,
            files=files,
            made_by=done.versions,
        )
        self.by_group.setdefault(work.group, []).append(shard)
        self._failure(work).unlink(missing_ok=True)

    def add_failure(self, work: Batch, why: str) -> None:
        """Record that a batch failed, and why, in a file of its own."""
        path = self._failure(work)
        path.parent.mkdir(exist_ok=True)
        runs = {"first": work.first, "last": work.last, "seed": work.seed}
        write_file(path, manifest_text("failure", batch=work.name, group=work.group, **runs, why=why))

    @property
    def failures(self) -> list[dict[str, Any]]:
        """The recorded failures of batches of which some runs are still missing."""
        failures = []
        for path in sorted((self.root / FAILURES).glob("[!.]*.json")):
            # An unreadable record is skipped without harm: the shards show which runs are missing.
            with suppress(InputError):
                failure = read_manifest(path, "failure")
                if missing((int(failure["first"]), int(failure["last"])), self.ranges(int(failure["group"]))):
                    failures.append(failure)
        return failures

    @property
    def lost_runs(self) -> set[tuple[int, int]]:
        """The missing runs of failed batches: group and number of the run.

        Several records may name the same run, and runs of a batch that failed may have been stored since.
        """
        return {
            (failure["group"], run)
            for failure in self.failures
            for first, last in missing((failure["first"], failure["last"]), self.ranges(failure["group"]))
            for run in range(first, last)
        }

    def ranges(self, group: int) -> list[Range]:
        """List the stored runs of a group as ranges, which may overlap."""
        return [(s.first, s.last) for s in self.by_group.get(group, [])]

    def missing(self, group: Group, runs: int) -> list[tuple[int, int, int]]:
        """List which of the first ``runs`` runs of a group are missing, block by block.

        Returns: for each missing range within a block: number of the block, first missing run, one past the last.
        """
        gaps = missing((0, runs), self.ranges(group.number))
        return [block for low, high in gaps for block in group.blocks(low, high)]

    def runs(self, group: int) -> int:
        """Return how many runs of a group are stored without a gap from run 0 on."""
        limit = 2**32  # run numbers are below it
        gaps = missing((0, limit), self.ranges(group))
        return gaps[0][0] if gaps else limit  # the first gap begins where the stored runs end

    def scan(self, group: int, runs: int, table: str = "robots", start: int = 0) -> pl.LazyFrame | None:
        """Return a lazy table of the rows of the runs of a group from ``start`` to ``runs`` - 1.

        Shards may overlap if several writers ran the same runs; each run is taken from one shard only. The column
        ``code`` of the robots is the hash of the program's code that made the run.

        Returns: None if none of these runs is stored, or no shard has this table.
        """
        # Runs below ``low`` are no longer taken: an earlier shard has given them.
        frames, low = [], start
        # Of shards that begin at the same run, the longest comes first: it makes the others needless. The name decides
        # between shards of the same runs, so that the choice does not depend on the order of the files.
        for shard in sorted(
            self.by_group.get(group, []), key=lambda shard: (shard.first, -shard.last, shard.name)
        ):
            first, last = max(low, shard.first), min(shard.last, runs)  # the part of the shard that is taken
            if last <= low:
                continue
            # A shard has ``failures`` only if the source of motion gave up a run, and ``samples`` only if the study
            # saves them.
            if table in shard.files:
                frame = pl.scan_parquet(shard.files[table], glob=False)
                if table == "robots":
                    frame = frame.with_columns(code=pl.lit(shard.made_by.get("code", "")))
                if (first, last) != (shard.first, shard.last):
                    frame = frame.filter(pl.col("run").is_between(first, last, closed="left"))
                frames.append(frame)
            low = last
        return pl.concat(frames) if frames else None

    @property
    def made_by(self) -> list[dict[str, str]]:
        """The different ``simulation.versions`` that made the shards, each once.

        Shards name the registered code of their own cells only, so versions that contradict each other nowhere are one.
        """
        different: list[dict[str, str]] = []
        for text in sorted({json.dumps(dict(s.made_by), sort_keys=True) for s in self.shards}):
            versions = json.loads(text)
            same = (one for one in different if all(one.get(k, v) == v for k, v in versions.items()))
            alike = next(same, None)
            if alike is None:
                different.append(versions)
            else:
                alike.update(versions)
        return different

    def check_versions(self) -> None:
        """Refuse to continue if other versions than those of this process made shards.

        Otherwise no single version could repeat all runs.

        Raises:
            InputError: the versions differ; the message names them.
        """
        for saved in self.made_by:
            check_begun_by(saved, self.folder)

    def check_alike(self) -> None:
        """Refuse a store whose shards were made by different versions.

        Raises:
            InputError: the versions differ; the message names them.
        """
        first, *others = self.made_by or [{}]  # ``made_by`` is empty if there are no shards
        for other in others:  # ``made_by`` has no duplicates, so any second entry is an error
            different = [
                f"{k} {first.get(k)} and {other[k]}" for k in other if first.get(k, other[k]) != other[k]
            ]
            raise InputError(
                f"shards were made by different versions: {'; '.join(different)}", field=str(self.folder)
            )

    def _shard(self, path: Path) -> Shard:
        """Return a shard as ``_read`` does, or as this process has read it, unless a file of it has changed since."""
        files, shard = _checked.get((path, self.hash), ([], None))
        if shard is None or files != _identities(path, shard):
            start_ns = time.time_ns() - COARSE_NS
            shard = self._read(path)
            files = _identities(path, shard)
            # One that changes while it is read is read again.
            if all(one is not None and one[2] < start_ns for one in files):
                _checked[path, self.hash] = files, shard
        return shard

    def _read(self, path: Path) -> Shard:
        """Read a shard's description, and check it and the files that it names.

        Raises:
            ValueError: something is wrong; the message says what (InputError is a ValueError).
        """
        description, files = read_described(path, "batch")
        if description.get("study") != self.hash or description.get("seed") != self.study.seed:
            raise ValueError("is of another study")
        group, first, last, rows = (description[key] for key in ("group", "first", "last", "rows"))
        groups = plan_of(self.study).groups
        if not (0 <= group < len(groups) and 0 <= first < last <= MOST_RUNS):
            raise ValueError(f"is of group {group}, runs {first} to {last}, which the study does not have")
        check_shard(files, self.study, groups[group], range(first, last), rows)
        return Shard(
            name=path.stem,
            group=group,
            first=first,
            last=last,
            rows=rows,
            files=files,
            made_by=description["versions"],
        )

    def _failure(self, work: Batch) -> Path:
        """Return the file that records the failure of a batch."""
        return self.root / FAILURES / f"{work.group}-{work.first}-{work.last}.json"

    def write_head(self) -> None:
        """Write ``study.toml`` if its text has changed, the manifest if it is missing, and copies of user code.

        The text of ``study.toml`` changes with the number of runs or the precision, and the name.

        Raises:
            InputError: a file cannot be created, or the present ``study.toml`` cannot be read.
            RunError: the folder cannot be written, or the study's text would be read as another study.
        """
        text = self.study.to_toml()
        if self.hash != self.study.hash:
            # Another version made the folder. Its text stays, since its hash was computed from it; only the name, the
            # runs and the precision change.
            text = _with_runs_of(read_text(self.root / MARKER, "a study"), text)
        sealed = f"{text}{SEALED}{hashlib.sha256(text.encode()).hexdigest()}\n"
        marker, manifest = self.root / MARKER, self.root / MANIFEST
        try:
            if not marker.is_file() or marker.read_text(encoding="utf-8") != sealed:
                write_file(marker, sealed)
            if not manifest.is_file():
                self._check_written(text)
                values = {"hash": self.hash, "versions": versions()}
                values |= {"command": self.command} if self.command else {}
                write_file(manifest, manifest_text("study", **values))
            write_code(self.root, (cell.scenario for cell in self.study.cells), self.study.motion)
            (self.root / SHARDS).mkdir(exist_ok=True)
        except OSError as error:
            raise RunError(f"could not write '{self.folder}': {error.strerror or error}") from error

    def _check_written(self, text: str) -> None:
        """Raise RunError if the text is read as another study: the shards would seem to belong to that other study."""
        if Study.from_toml(text, name=MARKER).hash != self.study.hash:
            raise RunError(f"{MARKER} would be read as another study; set the differing fields with --set")


def _identities(path: Path, shard: Shard) -> list[tuple[int, int, int] | None]:
    """Return what identifies the files of a shard, whose description is ``path``."""
    return [_identity(file) for file in (path, *shard.files.values())]


def _identity(path: Path) -> tuple[int, int, int] | None:
    """Return what identifies a file and its content; None if there is none."""
    if not path.exists():
        return None
    status = path.stat()
    return status.st_dev, status.st_ino, status.st_ctime_ns


NOT_OF_THE_CELLS: Final = ("format", "name", "runs", "until", "figure", "max_runs", "level")
"""Keys of a study's file that change no run of its cells, so that they may change without a new folder."""


SEALED: Final = "# sha256 of the text above: "
"""Beginning of the last line of a study's file in its folder, since no manifest says how many runs there are."""


def _is_as_written(text: str) -> bool:
    """Return whether the text of a study's file is as it was written; older versions wrote no hash of it."""
    text, mark, written = text.rpartition(SEALED)
    return not mark or hashlib.sha256(text.encode()).hexdigest() == written.strip()


def _fingerprint(text: str) -> str:
    """Hash a study's TOML without ``NOT_OF_THE_CELLS``: the text, so that all versions agree on it."""
    values = {k: v for k, v in parsed_toml(text, MARKER).items() if k not in NOT_OF_THE_CELLS}
    return hashlib.sha256(json.dumps(values, default=str).encode()).hexdigest()[:16]


def _with_runs_of(old: str, new: str) -> str:
    """Return the study's TOML ``old`` with the name, runs and precision of ``new``."""
    # The format stays that of ``old``, since it says how the parts that are kept have to be read.
    kept = {k: v for k, v in tomllib.loads(old).items() if k == "format" or k not in NOT_OF_THE_CELLS}
    changed = {k: v for k, v in tomllib.loads(new).items() if k in NOT_OF_THE_CELLS and k != "format"}
    return as_toml(kept | changed)


def _is_of(path: Path, study: Study) -> bool:
    """Return whether ``path`` may come from a writer of this study that was killed before it wrote the manifest.

    Such a writer makes the folder of shards, ``study.toml`` of this study, and temporary files.
    """
    if path.name == MARKER:
        try:
            return _fingerprint(read_text(path, "a study")) == _fingerprint(study.to_toml())
        except InputError:
            return False
    return (path.name == SHARDS and path.is_dir()) or path.name.startswith((f".{MARKER}.", f".{MANIFEST}."))


def _differences(there: Study, given: Study) -> str:
    """Write the message that a folder holds another study, with up to three differences.

    Args:
        there: the study in the folder. given: the study that was to be saved in the folder.
    """
    values = ((name, getattr(there, name), getattr(given, name)) for name in ("seed", "motion", "keep"))
    differences = [
        f"{name} is {saved!r} there and {new!r} here" for name, saved, new in values if new != saved
    ]
    if len(there.cells) != len(given.cells):
        differences.append(f"it has {len(there.cells)} cells there and {len(given.cells)} here")
    else:
        differences += _of_cells(there, given)
    return f"holds another study: {'; '.join(differences[:3]) or 'its cells have other names'}; take another folder"


def _of_cells(there: Study, given: Study) -> list[str]:
    """Describe all differences of the first cell whose scenario differs; empty if all scenarios are equal.

    Args:
        there: the study in a folder. given: the study that was to be saved in it, with the same number of cells.
    """
    for old, new in zip(there.cells, given.cells, strict=True):
        if old.scenario != new.scenario:
            old_sections, new_sections = old.scenario.model_dump(), new.scenario.model_dump()
            # Strategies have tables of their own, which the other scenario may not have.
            return [
                f"{section}.{name} of cell {new.number} is {old_sections[section].get(name)!r} there and {value!r} here"
                for section, fields in new_sections.items()
                for name, value in fields.items()
                if old_sections[section].get(name) != value
            ]
    return []
