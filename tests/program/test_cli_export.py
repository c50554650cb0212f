"""``vibroswarm export`` as a user meets it: C, Python, the header that is read back, and what is refused."""

from __future__ import annotations

import json
import re
import shutil
import struct
import subprocess
from pathlib import Path
from typing import Any

import pytest

from helpers.commands import refusal_of
from helpers.example_strategies import load_example
from helpers.exported_robots import EXPORTED, HAS_ARM, STRICT, needs_gcc
from vibroswarm import preset
from vibroswarm.cli import main
from vibroswarm.export import c_library

OWN_SENSOR = "own sensor"
"""Robots that read three kinds of tile with a sensor of their own."""


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("a folder with spaces") / "soft robot"
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(c_library, "COMPILER", "no-such-compiler")
        assert main(["export", "c", str(folder), "--strategy", "soft"]) == 0
    return folder


def test_a_library_is_written_once(library: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (library / "src" / "vibroswarm.c").read_text()
    assert "exists already" in refusal_of(capsys, "export", "c", library, "--strategy", "none")
    assert (library / "src" / "vibroswarm.c").read_text() == before


def check(folder: Path, *options: str) -> int:
    return main(["export", "check", str(folder), *options])


def test_the_header_is_read_back(library: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert check(library, "--strategy", "soft") == 0
    assert check(library / "src" / "vibroswarm_parameters.h", "--strategy", "soft") == 0
    capsys.readouterr()
    assert check(library, "--strategy", "soft", "--set", "strategy.soft.eta=900.5", "--json") == 1
    assert json.loads(capsys.readouterr().out)["tables"]["differences"] == [
        {"name": "strategy.soft.eta", "header": "1500.0", "scenario": "900.5"},
        {"name": "VS_PARAMS_ETA", "header": "VS_R(1500.0)", "scenario": "VS_R(900.5)"},
    ]


PACKETS = """
#include <stdio.h>
#include <string.h>
#include "vibroswarm.h"
#include "vibroswarm_parameters.h"
int main(void)
{
    vs_Message sent, heard;
    uint8_t packet[VS_PACKET_BYTES];
    vs_int sender = 0, number = 0;
    memset(&sent, 0, sizeof sent);
    sent.ones = 1;
    sent.zeros = -7;
    sent.social_ones = 0.125;
    const vs_int length = vs_pack(&sent, 3, 70000, packet);
    for (int k = 0; k < length; k++)
        printf("%02x", packet[k]);
    const bool reads = vs_unpack(packet, length, &heard, &sender, &number);
    printf(" %d %d %d", reads, (int)sender, (int)number);
    printf(" %d %d %g", (int)heard.ones, (int)heard.zeros, (double)heard.social_ones);
    printf(" %d", vs_unpack(packet, length - 1, &heard, &sender, &number));
    packet[0]++; /* another layout */
    printf(" %d", vs_unpack(packet, length, &heard, &sender, &number));
    packet[0]--;
    packet[4]++; /* another program */
    printf(" %d", vs_unpack(packet, length, &heard, &sender, &number));
    packet[4]--;
    packet[5] = VS_WORLD_ROBOTS; /* a sender for which the robot has no memory */
    printf(" %d\\n", vs_unpack(packet, length, &heard, &sender, &number));
    return 0;
}
"""


@needs_gcc
@pytest.mark.parametrize("precision", [1, 2])
def test_packets_hold_messages_and_say_what_runs(precision: int, tmp_path: Path) -> None:
    load_example("dbbs")
    sources = written(scenario_for("dbbs"), tmp_path)
    printed = printed_by(PACKETS, sources, precision)
    packet, reads, *found, short, layout, program, unknown = printed.split()
    identity = re.search(
        r"VS_PROGRAM_ID UINT32_C\((\w+)\)", (sources / "vibroswarm_parameters.h").read_text()
    )
    assert identity is not None
    number = "f" if precision == 1 else "d"
    fields = (1, int(identity[1], 16), 3, 70000, 1, -7, 0.125, 0.0)
    assert bytes.fromhex(packet) == struct.pack(f"<BIBIii2{number}", *fields)
    assert (reads, found) == ("1", ["3", "70000", "1", "-7", "0.125"])
    assert (short, layout, program, unknown) == ("0", "0", "0", "0")


def printed_by(around: str, sources: Path, precision: int) -> str:
    """Compile a program around the library, run it, and return what it prints."""
    file = sources.parent / "around.c"
    file.write_text(around)
    flags = [*STRICT, "-O0", f"-DVS_PRECISION={precision}", "-I", str(sources)]
    command = [
        "gcc",
        *flags,
        *map(str, sources.glob("*.c")),
        str(file),
        "-o",
        str(file.with_name("a.out")),
        "-lm",
    ]
    subprocess.run(command, check=True)
    return subprocess.run([file.with_name("a.out")], capture_output=True, text=True, check=True).stdout


def scenario_for(name: str) -> Any:
    if name == OWN_SENSOR:
        three_kinds = {
            "floor.source": "random:0.28,0.48,0.24",
            "task.name": "majority",
            "strategy.name": "dirichlet",
            "sensor.model": "confusion",
        }
        return preset("paper").with_values(three_kinds)
    return preset("paper").with_values({"strategy.name": name})


def written(scenario: Any, folder: Path) -> Path:
    """Write a scenario's library; return the folder of its sources."""
    c_library.export_library(scenario, folder)
    return folder / "src"


WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror"]
WARNED = ["-std=c99", "-O2", *WARNINGS]


def compiled(folder: Path, *flags: str, compiler: str = "gcc") -> subprocess.CompletedProcess[str]:
    command = [compiler, *flags, "-x", "c", "-c", "-", "-I", ".", "-o", "/dev/null"]
    all_sources = "".join(f'#include "{path.name}"\n' for path in sorted(folder.glob("*.c")))
    return subprocess.run(command, cwd=folder, input=all_sources, capture_output=True, text=True, check=False)


@needs_gcc
@pytest.mark.slow
@pytest.mark.parametrize("strategy", [*sorted(EXPORTED), OWN_SENSOR])
def test_compilers_warn_of_nothing(tmp_path: Path, strategy: str) -> None:
    """Optimised once: what else is warned of then, a number without a value, does not depend on the precision.

    Where programs are compiled for the robot's processor, that is there.
    """
    sources = written(scenario_for(strategy), tmp_path)
    for precision in (1, 2, 3):
        how = [f"-DVS_PRECISION={precision}", *(["-fsyntax-only"] if precision != 2 or HAS_ARM else [])]
        for compiler in filter(shutil.which, ("gcc", "clang")):
            done = compiled(sources, *WARNED, *how, compiler=compiler)
            assert done.returncode == 0, done.stderr
