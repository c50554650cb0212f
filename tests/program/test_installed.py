"""The program as a user installs it: from the wheel, without extras, in a folder that is not the checkout."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import venv
import zipfile
from collections.abc import Iterable, Iterator
from email import message_from_bytes
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from helpers.documents import ROOT, blocks, command_of, exchanges, lay_out, shell_lines, small

pytestmark = [pytest.mark.slow, pytest.mark.skipif(not (ROOT / ".git").exists(), reason="no checkout")]

PACKAGE = "src/vibroswarm/"


def called(*words: str | Path, cwd: Path) -> str:
    """What a command says; it must succeed, without any path that would find the checkout."""
    env = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")}
    done = subprocess.run([*words], cwd=cwd, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
    return done.stdout


def tracked() -> list[str]:
    """The files of the checkout that git knows."""
    listed = called("git", "-c", "core.quotePath=off", "ls-files", cwd=ROOT).splitlines()
    return [name for name in listed if (ROOT / name).is_file()]


def environment(folder: Path, *packages: str | Path, dependencies: bool = True) -> Path:
    """The Python of a new virtual environment with these packages, put there by the pip of this one."""
    venv.create(folder, with_pip=False)
    python = folder / "bin" / "python"
    # What is imported is compiled then; of all libraries whole, pip would compile ten times as much.
    options = ["--quiet", "--disable-pip-version-check", "--no-compile"]
    options += [] if dependencies else ["--no-deps"]
    line = [sys.executable, "-m", "pip", "--python", python, "install", *options, *packages]
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    if "Failed to establish a new connection" in done.stderr:
        pytest.skip("packages cannot be downloaded here")
    assert done.returncode == 0, done.stderr
    return python


def stated(requirements: Iterable[str], extra: str = "") -> Iterator[metadata.Distribution]:
    """The installed libraries that fulfil requirements, and those that these require."""
    for requirement in map(Requirement, requirements):
        if requirement.marker is not None and not requirement.marker.evaluate({"extra": extra}):
            continue
        library = metadata.distribution(requirement.name)
        assert requirement.specifier.contains(library.version, prereleases=True), requirement
        yield library
        for of_extra in ("", *requirement.extras):
            yield from stated(library.requires or (), of_extra)


def link(library: metadata.Distribution, site: Path) -> None:
    """Give an environment a library of this one, instead of downloading and compiling it again."""
    for name in {path.parts[0] for path in library.files or () if ".." not in path.parts}:
        if not (site / name).exists() and name != "__pycache__":
            (site / name).symlink_to(Path(str(library.locate_file(name))).resolve())


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel that is built from the tracked files."""
    folder = tmp_path_factory.mktemp("built")
    for name in tracked():
        copy = folder / "source" / name
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes((ROOT / name).read_bytes())
    python = environment(folder / "env", "setuptools>=77")
    build = "import sys; from setuptools import build_meta; build_meta.build_wheel(sys.argv[1])"
    called(python, "-c", build, folder, cwd=folder / "source")
    (wheel,) = folder.glob("*.whl")
    return wheel


def test_the_wheel_holds_every_tracked_file_of_the_package_and_no_other(built: Path) -> None:
    wanted = {name.removeprefix("src/") for name in tracked() if name.startswith(PACKAGE)}
    assert "vibroswarm/scenario/presets/paper.toml" in wanted
    with zipfile.ZipFile(built) as archive:
        assert {name for name in archive.namelist() if ".dist-info/" not in name} == wanted


@pytest.fixture(scope="module")
def installed(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Python of an environment with the wheel and the libraries that it states, and no other.

    The libraries are those that the checkout was installed with, from the same statement.
    """
    python = environment(tmp_path_factory.mktemp("an environment") / "of its own", built, dependencies=False)
    (site,) = (python.parents[1] / "lib").glob("python*/site-packages")
    for library in stated(requirements_of(built)):
        link(library, site)
    called(sys.executable, "-m", "pip", "--python", python, "check", cwd=site)
    return python


def requirements_of(wheel: Path) -> list[str]:
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        return message_from_bytes(archive.read(name)).get_all("Requires-Dist", [])


@pytest.fixture
def here(tmp_path: Path) -> Path:
    """A folder with a space in its name, empty but for the files that the README takes for the reader's own."""
    folder = tmp_path / "my inspections"
    folder.mkdir()
    lay_out(folder)
    return folder


RUN = """
import contextlib, io, json, sys
from vibroswarm.cli import main

outcomes = []
for command in json.loads(sys.argv[1]):
    said, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(errors):
        try:
            code = main(command)
        except SystemExit as left:
            code = left.code
    outcomes.append((code, said.getvalue() + errors.getvalue()))
print(json.dumps(outcomes))
"""
"""A program that runs command lines one after the other, and prints exit codes and texts."""


def outcomes(python: Path, commands: list[list[str]], folder: Path) -> list[tuple[int, str]]:
    return [
        (code, text) for code, text in json.loads(called(python, "-c", RUN, json.dumps(commands), cwd=folder))
    ]


def commands_of_the_readme() -> list[list[str]]:
    """All commands of the README's blocks that are run, with small numbers of runs."""
    found = []
    for block in blocks(ROOT / "README.md", "console", "sh"):
        lines = shell_lines(block.text) if block.kind == "sh" else [line for line, _ in exchanges(block.text)]
        found += [command for line in lines if block.is_run and (command := command_of(line)) is not None]
    return [small(command) for command in found]


def test_every_command_of_the_readme_works_from_the_wheel_alone(installed: Path, here: Path) -> None:
    program = installed.parent / "vibroswarm"
    assert called(program, "--version", cwd=here).startswith("vibroswarm ")
    (own,) = (
        block.text for block in blocks(ROOT / "README.md", "python") if block.text.startswith("# counter.py")
    )
    (here / "counter.py").write_text(own, encoding="utf-8")
    commands = commands_of_the_readme()
    for command, (code, text) in zip(commands, outcomes(installed, commands, here), strict=True):
        if command[:2] == NEED_EXTRAS["lab"][:2]:
            assert (code, says_extra("lab", text)) == (2, True), f"{command}\n{text}"
        else:
            assert code == 0, f"{command}\n{text}"


NEED_EXTRAS = {
    "physics": ["run", "--motion", "mujoco"],
    "video": ["lab", "track", "video.mp4", "--markers", "0,1", "--out", "tracked"],
    "optimize": ["optimize", "--method", "tpe", "--budget", "600"],
    "lab": ["calibrate", "compare", "first", "first"],
    "dask": ["evaluate", "--runs", "4", "--executor", "dask://127.0.0.1:1"],
}


def says_extra(extra: str, text: str) -> bool:
    return f"pip install 'vibroswarm[{extra}]'" in " ".join(text.split())


def test_a_command_that_needs_an_extra_says_which(installed: Path, here: Path) -> None:
    first = ["run", "--set", "run.t_end_s=300", "--out", "first"]
    (here / "video.mp4").write_bytes(b"")
    said = outcomes(installed, [first, *NEED_EXTRAS.values()], here)[1:]
    for extra, (code, text) in zip(NEED_EXTRAS, said, strict=True):
        assert code == 2, extra
        assert says_extra(extra, text)
