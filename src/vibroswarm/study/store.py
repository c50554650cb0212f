"""The store of a study: a folder to which batches are added, and nothing else.

    study.toml          the study, standing alone
    study.json          format, hash, versions
    shards/NAME.parquet the rows of a batch; NAME is made from its content
    shards/NAME.json    which batch it is: written last, so that a shard without it does not count
    failures/*.json     batches that failed twice, until they are done

A batch is written whole, under a name made from its content, and there is no index. So writers need not know of each
other, on any file system that renames whole files; and a batch that is done twice is the same file.
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

from vibroswarm.errors import InputError, RunError, older, shown
from vibroswarm.files import whole_file
from vibroswarm.forked import check_threads
from vibroswarm.leftovers import remove_leftovers
from vibroswarm.plain_files import entry, read_json, read_text, texts
from vibroswarm.result import write_code
from vibroswarm.simulation import versions
from vibroswarm.study.plan import Group, Range, missing, plan_of
from vibroswarm.study.shard_checks import check_shard
from vibroswarm.study.spec import FORMAT, MOST_RUNS, Study, as_toml
from vibroswarm.study.work import Done, Work

FAILURE: Final = {"batch": str, "group": int, "first": int, "last": int, "seed": int, "why": str}
"""Entries of a failure, with their types."""
MARKER: Final = "study.toml"
HEAD: Final = "study.json"
SHARDS: Final = "shards"
FAILURES: Final = "failures"


@dataclass(frozen=True)
class Shard:
    """A batch that is in the store: its group and runs, and its files by table."""

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
    """By which the shards know their study: that of the version which made the folder."""
    broken: dict[str, str] = field(default_factory=dict)
    """Shards that are there but cannot be used, and why."""
    left_over: int = 0
    """Files of writers that were killed."""

    def __post_init__(self) -> None:
        self.hash = self.hash or self.study.hash

    @property
    def damaged(self) -> list[str]:
        """Shards that are there but cannot be used, in words."""
        return [f"{name}.json: {why}" for name, why in self.broken.items()]

    @classmethod
    def existing(cls, folder: str | Path, study: Study) -> Store | None:
        """The store of this study that is there, or None where a new one can be made; nothing is written.

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
            # A writer that was killed at its beginning, or one that begins just now, is no obstacle.
            if folder.exists() and not (folder.is_dir() and all(_is_of(p, study) for p in folder.iterdir())):
                if (folder / HEAD).exists():  # it was written a moment ago
                    return cls.existing(folder, study)
                raise InputError("is there and no study; give the name of a new folder", field=str(folder))
        except OSError as error:
            raise InputError(f"cannot be read: {error.strerror or error}", field=str(folder)) from None
        return None

    @classmethod
    def open_or_create(cls, folder: str | Path, study: Study) -> Store:
        """The store of this study: a new one, or the one that is there.

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
        """The store that is there, its shards checked.

        Raises:
            InputError: no study there, or one of a newer format, or its head is damaged.
        """
        folder = Path(folder)
        head = folder / HEAD
        if not head.exists():
            raise InputError(f"is no study of vibroswarm (there is no {HEAD})", field=str(folder))
        about = read_json(head, "the head of a study")
        version, told = entry(about, "format", int, head), entry(about, "hash", str, head)
        made_by = texts(entry(about, "versions", dict, head), "versions", head)
        if version < FORMAT:
            raise InputError(older(version), field=str(folder))
        if version > FORMAT:
            raise InputError(
                f"is of format {version}; this version reads up to {FORMAT}: update vibroswarm",
                field=str(folder),
            )
        text = read_text(folder / MARKER, "a study")
        study = Study.from_toml(text, name=str(folder / MARKER), folder=folder)
        # A later version may know more fields and so give the same study another hash; its text is the same.
        same_code = made_by.get("code") == versions()["code"]
        if study.hash != told and (same_code or _fingerprint(text) != about.get("text")):
            raise InputError(
                f"{MARKER} is not the study that the folder was made for (hash {told}); put it back",
                field=str(folder),
            )
        store = cls(folder, study, hash=told)
        store.refresh()
        return store

    def refresh(self) -> None:
        """Look at what is there."""
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
        # A shard without its description was being written when its writer was killed.
        there = set((self.folder / SHARDS).glob("[!.]*.parquet"))
        self.left_over += len([p for p in there - described if not p.with_name(_stem(p) + ".json").is_file()])

    def add(self, done: Done) -> None:
        """Keep a batch: its files first, its description last.

        Raises:
            RunError: the disk is full or failed; nothing is half-written.
        """
        name = hashlib.sha256(done.files["robots"]).hexdigest()[:24]
        paths = {
            table: f"{name}.parquet" if table == "robots" else f"{name}.{table}.parquet"
            for table in done.files
        }
        about = {
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
        try:
            for table, data in done.files.items():
                with whole_file(shards / paths[table]) as part:
                    part.write_bytes(data)
            with whole_file(shards / f"{name}.json") as part:
                part.write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
        except InputError as error:  # the folder could be written a moment ago
            raise RunError(str(error)) from error
        self.broken.pop(name, None)
        files = {table: shards / path for table, path in paths.items()}
        work = done.work
        self.shards.append(Shard(name, work.group, work.first, work.last, done.rows, files, done.versions))
        self._failure(work).unlink(missing_ok=True)

    def add_failure(self, work: Work, why: str) -> None:
        """Note that a batch failed."""
        path = self._failure(work)
        path.parent.mkdir(exist_ok=True)
        about = {"batch": work.name, "group": work.group, "first": work.first, "last": work.last}
        with whole_file(path) as part:
            part.write_text(
                json.dumps({**about, "seed": work.seed, "why": why}, indent=1) + "\n", encoding="utf-8"
            )

    @property
    def failures(self) -> list[dict[str, Any]]:
        """Batches that failed and have not been done since, whole or in other pieces."""
        found = []
        for path in sorted((self.folder / FAILURES).glob("[!.]*.json")):
            with suppress(InputError):  # of no matter: the batch is missing, and is told so
                one = read_json(path, "a failure")
                for key, kind in FAILURE.items():
                    entry(one, key, kind, path)
                if missing((int(one["first"]), int(one["last"])), self.ranges(int(one["group"]))):
                    found.append(one)
        return found

    def ranges(self, group: int) -> list[Range]:
        """Runs of a group that are there; ranges may overlap."""
        return [(s.first, s.last) for s in self.shards if s.group == group]

    def missing(self, group: Group, runs: int) -> list[tuple[int, int, int]]:
        """What of the group's blocks is not there yet: number of the block, first run, one past the last."""
        gaps = missing((0, runs), self.ranges(group.number))
        return [block for low, high in gaps for block in group.blocks(low, high)]

    def runs(self, group: int) -> int:
        """Runs of a group that are there without a gap, from run 0."""
        gaps = missing((0, 2**32), self.ranges(group))
        return gaps[0][0] if gaps else 2**32

    def scan(self, group: int, runs: int, table: str = "robots") -> pl.LazyFrame | None:
        """The rows of the first ``runs`` runs of a group, each once; None where there are none."""
        check_threads()
        frames, low = [], 0
        for shard in sorted(
            (s for s in self.shards if s.group == group), key=lambda s: (s.first, -s.last, s.name)
        ):
            high = min(shard.last, runs)
            if high > low:
                frame = pl.scan_parquet(shard.files[table], glob=False)
                if (shard.first, shard.last) != (
                    max(low, shard.first),
                    high,
                ):  # several writers did more than once
                    frame = frame.filter(pl.col("run").is_between(max(low, shard.first), high, closed="left"))
                frames.append(frame)
                low = high
        return pl.concat(frames) if frames else None

    @property
    def made_by(self) -> list[dict[str, str]]:
        """The different versions that made the shards."""
        different = {json.dumps(dict(s.made_by), sort_keys=True) for s in self.shards}
        return [json.loads(text) for text in sorted(different)]

    def check_versions(self) -> None:
        """Refuse to go on with other versions: the whole would not be repeatable.

        Raises:
            InputError: naming what differs.
        """
        mine = versions()
        for theirs in self.made_by:
            different = [
                f"{k} {theirs.get(k)} there, {mine[k]} here" for k in mine if theirs.get(k) != mine[k]
            ]
            if different:
                raise InputError(
                    f"was begun by other versions ({'; '.join(different)}); go on with those, take a new folder, or "
                    "say --mixed to go on all the same",
                    field=str(self.folder),
                )

    def check_alike(self) -> None:
        """Refuse shards of different versions.

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
        """A shard by its description, its files checked."""
        about = read_json(path, "the description of a shard")
        if entry(about, "format", int, path) < FORMAT:
            raise ValueError(older(about["format"]))
        if about["format"] > FORMAT:
            raise ValueError(f"is of format {about['format']}; update vibroswarm")
        if about.get("study") != self.hash or about.get("seed") != self.study.seed:
            raise ValueError("is of another study")
        group, first, last, rows = (
            entry(about, key, int, path) for key in ("group", "first", "last", "rows")
        )
        files: dict[str, Path] = {}
        for name, what in entry(about, "files", dict, path).items():
            if Path(name).name != name:
                raise ValueError(f"names a file elsewhere: {shown(name)}")
            size, sha256 = entry(what, "bytes", int, path), entry(what, "sha256", str, path)
            _check(path.with_name(name), size, sha256)
            files[entry(what, "table", str, path)] = path.with_name(name)
        groups = plan_of(self.study).groups
        if not (0 <= group < len(groups) and 0 <= first < last <= MOST_RUNS):
            raise ValueError(f"is of group {group}, runs {first} to {last}, which the study has not")
        check_shard(files, self.study, groups[group], range(first, last), rows)
        made_by = texts(entry(about, "versions", dict, path), "versions", path)
        return Shard(path.stem, group, first, last, rows, files, made_by)

    def _failure(self, work: Work) -> Path:
        return self.folder / FAILURES / f"{work.group}-{work.first}-{work.last}.json"

    def write_head(self) -> None:
        """``study.toml``, written again where the number of runs changed; then ``study.json``, written once."""
        text = self.study.to_toml()
        if self.hash != self.study.hash:
            text = _with_runs_of(read_text(self.folder / MARKER, "a study"), text)
        marker, head = self.folder / MARKER, self.folder / HEAD
        try:
            if not marker.is_file() or marker.read_text(encoding="utf-8") != text:
                with whole_file(marker) as part:
                    part.write_text(text, encoding="utf-8")
            if not head.is_file():
                self._check_written(text)
                about = {
                    "format": FORMAT,
                    "hash": self.hash,
                    "text": _fingerprint(text),
                    "versions": versions(),
                }
                with whole_file(head) as part:
                    part.write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
            write_code(self.folder, (cell.scenario for cell in self.study.cells), self.study.motion)
            (self.folder / SHARDS).mkdir(exist_ok=True)
        except OSError as error:
            raise RunError(f"could not write '{self.folder}': {error.strerror or error}") from error

    def _check_written(self, text: str) -> None:
        """What is read back must be the study that is run, or its shards would be taken for those of another."""
        if Study.from_toml(text, name=MARKER).hash != self.study.hash:
            raise RunError(
                f"{MARKER} would be read as another study; say what differs with --set in its scenario"
            )


NOT_OF_THE_CELLS: Final = ("format", "name", "runs", "until", "figure", "max_runs")
"""Keys of a study that may change while its folder stays."""


def _fingerprint(text: str) -> str:
    """A hash of what a study's text says of its cells and seed; it does not depend on how a version reads it."""
    values = {k: v for k, v in tomllib.loads(text).items() if k not in NOT_OF_THE_CELLS}
    return hashlib.sha256(json.dumps(values, default=str).encode()).hexdigest()[:16]


def _with_runs_of(old: str, new: str) -> str:
    """The study of ``old`` with the name and the number of runs of ``new``."""
    kept = {k: v for k, v in tomllib.loads(old).items() if k == "format" or k not in NOT_OF_THE_CELLS}
    changed = {k: v for k, v in tomllib.loads(new).items() if k in NOT_OF_THE_CELLS and k != "format"}
    return as_toml(kept | changed)


def _is_of(path: Path, study: Study) -> bool:
    """Whether this belongs to a store of the study of which no batch is done yet; a user's study.toml does not."""
    if path.name == MARKER:
        try:
            return _fingerprint(path.read_text(encoding="utf-8")) == _fingerprint(study.to_toml())
        except ValueError:
            return False
    return (path.name == SHARDS and path.is_dir()) or path.name.startswith((f".{MARKER}.", f".{HEAD}."))


def _stem(path: Path) -> str:
    return path.name.partition(".")[0]


def _check(path: Path, size: int, sha256: str) -> None:
    """Compare a file with its description."""
    if not path.is_file():
        raise ValueError(f"its file {path.name} is missing or no plain file")
    if path.stat().st_size != size:
        raise ValueError(f"{path.name} is cut off: {path.stat().st_size} bytes of {size}")
    with path.open("rb") as stream:
        if hashlib.file_digest(stream, "sha256").hexdigest() != sha256:
            raise ValueError(f"{path.name} is not what was written")


def _differences(there: Study, given: Study) -> str:
    """What tells two studies apart, in words."""
    told = []
    for name in ("seed", "motion", "keep"):
        mine, theirs = getattr(given, name), getattr(there, name)
        if mine != theirs:
            told.append(f"{name} is {theirs!r} there and {mine!r} here")
    if len(there.cells) != len(given.cells):
        told.append(f"it has {len(there.cells)} cells there and {len(given.cells)} here")
    else:
        told += _of_cells(there, given)
    return (
        f"holds another study: {'; '.join(told[:3]) or 'its cells are named otherwise'}; take another folder"
    )


def _of_cells(there: Study, given: Study) -> list[str]:
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
