"""Store a study in a folder to which batches are only ever added.

    study.toml          the study, self-contained
    study.json          format, hash, versions
    shards/NAME.parquet the rows of a batch; NAME is a hash of its content
    shards/NAME.json    describes the batch; written last, so that a shard without it is ignored
    failures/*.json     batches that failed twice, until they succeed

Each file is written atomically under a name made from its content, and there is no index. So several writers need no
coordination on any file system with atomic renames, and a batch that runs twice gives the same file.
"""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import polars as pl

from vibroswarm.core.atomic_io import remove_leftovers, write_file, write_files
from vibroswarm.core.fork_guard import check_threads
from vibroswarm.core.untrusted_files import entry, read_json, read_text, texts
from vibroswarm.errors import InputError, RunError, check_format, shown
from vibroswarm.result import write_code
from vibroswarm.simulation import versions
from vibroswarm.study.batch import Batch, BatchResult, check_shard
from vibroswarm.study.executors import check_begun_by
from vibroswarm.study.plan import Group, Range, missing, plan_of
from vibroswarm.study.spec import MOST_RUNS, Study, as_toml

FORMAT: Final = 3
"""Version of the folder; that of the study's file is in ``spec``."""

FAILURE: Final = {"batch": str, "group": int, "first": int, "last": int, "seed": int, "why": str}
"""Keys of a failure and their types."""
MARKER: Final = "study.toml"
HEAD: Final = "study.json"
SHARDS: Final = "shards"
FAILURES: Final = "failures"


@dataclass(frozen=True)
class Shard:
    """A stored batch: its group and runs, and its files by table."""

    name: str
    group: int
    first: int
    last: int
    rows: int
    files: Mapping[str, Path]
    made_by: Mapping[str, str]


@dataclass
class Store:
    """A study's folder, opened by ``create``, ``open_or_create`` or ``open``."""

    folder: Path
    study: Study
    shards: list[Shard] = field(default_factory=list)
    hash: str = ""
    """Hash of the study in its shards, as computed by the version that made the folder."""
    broken: dict[str, str] = field(default_factory=dict)
    """Shards that cannot be used, and why."""
    left_over: int = 0
    """Number of files that killed writers left behind."""

    def __post_init__(self) -> None:
        self.hash = self.hash or self.study.hash

    @property
    def damaged(self) -> list[str]:
        """Shards that cannot be used, with the reason, one line each."""
        return [f"{name}.json: {reason}" for name, reason in self.broken.items()]

    @classmethod
    def existing(cls, folder: str | Path, study: Study) -> Store | None:
        """Open the store of this study if it exists; return None if a new one can be made. Writes nothing.

        Raises:
            InputError: something else is there, or another study, or one of a newer format.
        """
        folder = Path(folder)
        try:
            if (folder / HEAD).exists():
                store = cls.open(folder)
                if store.study.hash != study.hash:
                    raise InputError(_differences(store.study, study), field=str(folder))
                store.study = study
                return store
            # A writer that was killed at its start, or is starting just now, is no obstacle.
            if folder.exists() and not (folder.is_dir() and all(_is_of(p, study) for p in folder.iterdir())):
                if (folder / HEAD).exists():  # it was written a moment ago
                    return cls.existing(folder, study)
                raise InputError(
                    "exists but is not a study; give the name of a new folder", field=str(folder)
                )
        except OSError as error:
            raise InputError(f"cannot be read: {error.strerror or error}", field=str(folder)) from None
        return None

    @classmethod
    def open_or_create(cls, folder: str | Path, study: Study) -> Store:
        """Open the store of this study, or make it.

        Raises:
            InputError: something else is there, or another study, or one of a newer format.
            RunError: the folder cannot be written.
        """
        folder = Path(folder)
        for place in (folder, folder / SHARDS, folder / FAILURES):
            remove_leftovers(place)
        store = cls.existing(folder, study)
        if store is None:
            try:
                (folder / SHARDS).mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise InputError(f"cannot be made: {error.strerror}", field=str(folder)) from None
            store = cls(folder, study)
        store.write_head()
        return store

    @classmethod
    def open(cls, folder: str | Path) -> Store:
        """Open a store and check its shards.

        Raises:
            InputError: the folder holds no study, or one of a newer format, or a damaged one.
        """
        folder = Path(folder)
        head = folder / HEAD
        if not head.exists():
            raise InputError(f"is not a study of vibroswarm (there is no {HEAD})", field=str(folder))
        head_values = read_json(head, "the head of a study")
        version, saved_hash = entry(head_values, "format", int, head), entry(head_values, "hash", str, head)
        made_by = texts(entry(head_values, "versions", dict, head), "versions", head)
        check_format(version, FORMAT, str(folder))
        text = read_text(folder / MARKER, "a study")
        study = Study.from_toml(text, name=str(folder / MARKER), folder=folder)
        # A later version may know more fields and so give the same study another hash; its text is the same.
        same_code = made_by.get("code") == versions()["code"]
        if study.hash != saved_hash and (same_code or _fingerprint(text) != head_values.get("text")):
            raise InputError(
                f"{MARKER} is not the study for which the folder was made (hash {saved_hash}); restore it",
                field=str(folder),
            )
        store = cls(folder, study, hash=saved_hash)
        store.refresh()
        return store

    def refresh(self) -> None:
        """Read the folder again."""
        self.shards, self.broken, self.left_over = [], {}, 0
        described = set()
        for path in sorted((self.folder / SHARDS).glob("*")):
            if path.name.startswith("."):
                self.left_over += 1
            elif path.suffix == ".json":
                try:
                    shard = self._read(path)
                except (ValueError, OSError) as error:
                    self.broken[path.stem] = (
                        f"is damaged: {error}" if isinstance(error, OSError) else str(error)
                    )
                else:
                    self.shards.append(shard)
                    described |= set(shard.files.values())
        # The writer of a shard without description was killed.
        shards = set((self.folder / SHARDS).glob("[!.]*.parquet"))
        heads = [p.with_name(f"{p.name.partition('.')[0]}.json") for p in shards - described]
        self.left_over += sum(not head.is_file() for head in heads)

    def add(self, done: BatchResult) -> None:
        """Save a batch: its files first, its description last.

        Raises:
            RunError: the disk is full or failed; no file is incomplete.
        """
        name = hashlib.sha256(done.files["robots"]).hexdigest()[:24]
        paths = {
            table: f"{name}.parquet" if table == "robots" else f"{name}.{table}.parquet"
            for table in done.files
        }
        description = {
            "format": FORMAT,
            "study": self.hash,
            "group": done.work.group,
            "first": done.work.first,
            "last": done.work.last,
            "seed": done.work.seed,
            "rows": done.rows,
            "files": {
                paths[table]: {"table": table, "bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
                for table, data in done.files.items()
            },
            "versions": done.versions,
        }
        shards = self.folder / SHARDS
        contents = {paths[table]: data for table, data in done.files.items()}
        try:
            write_files(shards, contents | {f"{name}.json": _json(description)})
        except InputError as error:  # the folder could be written a moment ago
            raise RunError(str(error)) from error
        self.broken.pop(name, None)
        files = {table: shards / path for table, path in paths.items()}
        work = done.work
        self.shards.append(Shard(name, work.group, work.first, work.last, done.rows, files, done.versions))
        self._failure(work).unlink(missing_ok=True)

    def add_failure(self, work: Batch, why: str) -> None:
        """Record that a batch failed."""
        path = self._failure(work)
        path.parent.mkdir(exist_ok=True)
        description = {"batch": work.name, "group": work.group, "first": work.first, "last": work.last}
        write_file(path, _json({**description, "seed": work.seed, "why": why}))

    @property
    def failures(self) -> list[dict[str, Any]]:
        """Batches that failed and have not succeeded since, whole or in other parts."""
        failures = []
        for path in sorted((self.folder / FAILURES).glob("[!.]*.json")):
            with suppress(InputError):  # harmless: the batch is reported as missing
                failure = read_json(path, "a failure")
                for key, kind in FAILURE.items():
                    entry(failure, key, kind, path)
                if missing((int(failure["first"]), int(failure["last"])), self.ranges(int(failure["group"]))):
                    failures.append(failure)
        return failures

    def ranges(self, group: int) -> list[Range]:
        """List the stored runs of a group as ranges, which may overlap."""
        return [(s.first, s.last) for s in self.shards if s.group == group]

    def missing(self, group: Group, runs: int) -> list[tuple[int, int, int]]:
        """List the missing parts of the group's blocks: number of the block, first run, one past the last."""
        gaps = missing((0, runs), self.ranges(group.number))
        return [block for low, high in gaps for block in group.blocks(low, high)]

    def runs(self, group: int) -> int:
        """Count the stored runs of a group from run 0 to the first gap."""
        gaps = missing((0, 2**32), self.ranges(group))
        return gaps[0][0] if gaps else 2**32

    def scan(self, group: int, runs: int, table: str = "robots") -> pl.LazyFrame | None:
        """Scan the rows of the first ``runs`` runs of a group, each once; None if there are none, or no such table."""
        check_threads()
        frames, low = [], 0
        for shard in sorted(
            (s for s in self.shards if s.group == group), key=lambda s: (s.first, -s.last, s.name)
        ):
            high = min(shard.last, runs)
            if high > low and table not in shard.files:  # no run of it failed
                low = high
            elif high > low:
                frame = pl.scan_parquet(shard.files[table], glob=False)
                # Several writers may have run some of them.
                if (shard.first, shard.last) != (max(low, shard.first), high):
                    frame = frame.filter(pl.col("run").is_between(max(low, shard.first), high, closed="left"))
                frames.append(frame)
                low = high
        return pl.concat(frames) if frames else None

    @property
    def made_by(self) -> list[dict[str, str]]:
        """The distinct versions that made the shards."""
        different = {json.dumps(dict(s.made_by), sort_keys=True) for s in self.shards}
        return [json.loads(text) for text in sorted(different)]

    def check_versions(self) -> None:
        """Refuse to continue if other versions made the shards: no single version could repeat all runs.

        Raises:
            InputError: naming what differs.
        """
        for saved in self.made_by:
            check_begun_by(saved, self.folder)

    def check_alike(self) -> None:
        """Refuse shards that were made by different versions.

        Raises:
            InputError: naming what differs.
        """
        first, *others = self.made_by or [{}]
        for other in others:
            different = [f"{k} {first.get(k)} and {other[k]}" for k in other if first.get(k) != other[k]]
            raise InputError(
                f"shards were made by different versions: {'; '.join(different)}", field=str(self.folder)
            )

    def _read(self, path: Path) -> Shard:
        """Read a shard's description and check its files."""
        description = read_json(path, "the description of a shard")
        check_format(entry(description, "format", int, path), FORMAT)
        if description.get("study") != self.hash or description.get("seed") != self.study.seed:
            raise ValueError("is of another study")
        group, first, last, rows = (
            entry(description, key, int, path) for key in ("group", "first", "last", "rows")
        )
        files: dict[str, Path] = {}
        for name, file in entry(description, "files", dict, path).items():
            if Path(name).name != name:
                raise ValueError(f"names a file elsewhere: {shown(name)}")
            size, sha256 = entry(file, "bytes", int, path), entry(file, "sha256", str, path)
            _check(path.with_name(name), size, sha256)
            files[entry(file, "table", str, path)] = path.with_name(name)
        groups = plan_of(self.study).groups
        if not (0 <= group < len(groups) and 0 <= first < last <= MOST_RUNS):
            raise ValueError(f"is of group {group}, runs {first} to {last}, which the study has not")
        check_shard(files, self.study, groups[group], range(first, last), rows)
        made_by = texts(entry(description, "versions", dict, path), "versions", path)
        return Shard(path.stem, group, first, last, rows, files, made_by)

    def _failure(self, work: Batch) -> Path:
        return self.folder / FAILURES / f"{work.group}-{work.first}-{work.last}.json"

    def write_head(self) -> None:
        """Write ``study.toml``, again if the number of runs changed, and then ``study.json``, once."""
        text = self.study.to_toml()
        if self.hash != self.study.hash:
            text = _with_runs_of(read_text(self.folder / MARKER, "a study"), text)
        marker, head = self.folder / MARKER, self.folder / HEAD
        try:
            if not marker.is_file() or marker.read_text(encoding="utf-8") != text:
                write_file(marker, text)
            if not head.is_file():
                self._check_written(text)
                text_hash, made_by = _fingerprint(text), versions()
                write_file(
                    head,
                    _json({"format": FORMAT, "hash": self.hash, "text": text_hash, "versions": made_by}),
                )
            write_code(self.folder, (cell.scenario for cell in self.study.cells), self.study.motion)
            (self.folder / SHARDS).mkdir(exist_ok=True)
        except OSError as error:
            raise RunError(f"could not write '{self.folder}': {error.strerror or error}") from error

    def _check_written(self, text: str) -> None:
        """Check that the text reads back as this study; otherwise its shards would seem to belong to another."""
        if Study.from_toml(text, name=MARKER).hash != self.study.hash:
            raise RunError(f"{MARKER} would be read as another study; set the differing fields with --set")


NOT_OF_THE_CELLS: Final = ("format", "name", "runs", "until", "figure", "max_runs")
"""Keys of a study that may change without a new folder."""


def _fingerprint(text: str) -> str:
    """Hash a study's TOML without the entries that change neither its cells nor its seed.

    It is the text that is hashed, not the study read from it, so that all versions of this program agree.
    """
    values = {k: v for k, v in tomllib.loads(text).items() if k not in NOT_OF_THE_CELLS}
    return hashlib.sha256(json.dumps(values, default=str).encode()).hexdigest()[:16]


def _with_runs_of(old: str, new: str) -> str:
    """Return the text of ``old`` with the name and the number of runs of ``new``."""
    kept = {k: v for k, v in tomllib.loads(old).items() if k == "format" or k not in NOT_OF_THE_CELLS}
    changed = {k: v for k, v in tomllib.loads(new).items() if k in NOT_OF_THE_CELLS and k != "format"}
    return as_toml(kept | changed)


def _is_of(path: Path, study: Study) -> bool:
    """Tell whether a file is one that this study's store has before its first batch; another ``study.toml`` is not."""
    if path.name == MARKER:
        try:
            return _fingerprint(path.read_text(encoding="utf-8")) == _fingerprint(study.to_toml())
        except ValueError:
            return False
    return (path.name == SHARDS and path.is_dir()) or path.name.startswith((f".{MARKER}.", f".{HEAD}."))


def _json(values: Mapping[str, Any]) -> str:
    return json.dumps(values, indent=1) + "\n"


def _check(path: Path, size: int, sha256: str) -> None:
    """Check that a file matches its description."""
    if not path.is_file():
        raise ValueError(f"its file {path.name} is missing or no plain file")
    if path.stat().st_size != size:
        raise ValueError(f"{path.name} is cut off: {path.stat().st_size} bytes of {size}")
    with path.open("rb") as stream:
        if hashlib.file_digest(stream, "sha256").hexdigest() != sha256:
            raise ValueError(f"{path.name} is not what was written")


def _differences(there: Study, given: Study) -> str:
    """Say in which respects two studies differ."""
    differences = []
    for name in ("seed", "motion", "keep"):
        here, saved = getattr(given, name), getattr(there, name)
        if here != saved:
            differences.append(f"{name} is {saved!r} there and {here!r} here")
    if len(there.cells) != len(given.cells):
        differences.append(f"it has {len(there.cells)} cells there and {len(given.cells)} here")
    else:
        differences += _of_cells(there, given)
    return f"holds another study: {'; '.join(differences[:3]) or 'its cells have other names'}; take another folder"


def _of_cells(there: Study, given: Study) -> list[str]:
    """Describe the first cell that differs between two studies with equally many cells; empty if none does."""
    for old, new in zip(there.cells, given.cells, strict=True):
        if old.scenario != new.scenario:
            a, b = old.scenario.model_dump(), new.scenario.model_dump()
            return [
                f"{section}.{name} of cell {new.number} is {a[section][name]!r} there and {value!r} here"
                for section, fields in b.items()
                for name, value in fields.items()
                if a[section][name] != value
            ]
    return []
