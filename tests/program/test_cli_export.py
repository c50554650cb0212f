"""``vibroswarm export`` as a user meets it: C, Python, the header that is read back, and what is refused."""

from __future__ import annotations

import json
import re
import shutil
import struct
import subprocess
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from helpers.commands import output_of, refusal_of, words_of
from helpers.exported_robots import HAS_ARM, STRICT, needs_arm, needs_gcc
from vibroswarm import preset
from vibroswarm.cli import main
from vibroswarm.errors import InputError, RunError
from vibroswarm.export import c_library, timing
from vibroswarm.export.assembly import parts_of
from vibroswarm.export.c_program import c_sources
from vibroswarm.strategies import names
from vibroswarm.strategies.base import register
from vibroswarm.strategies.none import none

DOCUMENT = Path(__file__).parents[2] / "docs" / "figures" / "export.md"
MOTORS: dict[str, Any] = {
    "sensor.model": "acceleration",
    "sensor.acceleration.motor_hz": [90.0, 140.0],
}
THREE_KINDS: dict[str, dict[str, Any]] = {
    "own sensor": {"sensor.model": "confusion"},
    "`dirichlet`, two motors": MOTORS,
    "`places`, two motors": MOTORS | {"strategy.name": "places"},
}
"""Robots that read three kinds of tile, with ``dirichlet`` where no other strategy is named."""


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("a folder with spaces") / "soft robot"
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(c_library, "COMPILER", "no-such-compiler")
        assert main(["export", "c", str(folder), "--strategy", "soft"]) == 0
    return folder


def test_a_library_is_written_once(library: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names_of = sorted(path.relative_to(library).as_posix() for path in library.rglob("*") if path.is_file())
    assert names_of == [
        "examples/inspection/inspection.ino", "library.properties", "platformio.ini", "src/vibroswarm.c",
        "src/vibroswarm.h", "src/vibroswarm_mathematics.h", "src/vibroswarm_parameters.h", "src/vibroswarm_radio.c",
        "src/vibroswarm_runtime.h", "src/vibroswarm_self_test.c",
    ]  # fmt: skip
    before = (library / "src" / "vibroswarm.c").read_text()
    assert f"DIR: '{library}' exists already" in refusal_of(
        capsys, "export", "c", library, "--strategy", "none"
    )
    assert (library / "src" / "vibroswarm.c").read_text() == before


@pytest.fixture
def unmeasured(monkeypatch: pytest.MonkeyPatch) -> None:
    """Libraries are written, and neither compiled nor timed: for tests of what is written."""
    monkeypatch.setattr(c_library, "COMPILER", "no-such-compiler")


@pytest.mark.usefixtures("unmeasured")
def test_force_replaces_an_export_and_nothing_else(
    library: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(library, tmp_path / "copy")
    arguments = ["--strategy", "none", "--force"]
    assert main(["export", "c", str(tmp_path / "copy"), *arguments]) == 0
    assert "strategy 'none'" in (tmp_path / "copy" / "src" / "vibroswarm.c").read_text()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("years of work")
    assert "does not replace it" in refusal_of(capsys, "export", "c", tmp_path / "mine", *arguments)
    assert (tmp_path / "mine" / "thesis.txt").read_text() == "years of work"


def test_an_interrupted_export_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    written, write = [], Path.write_text

    def interrupted(path: Path, *arguments: Any, **more: Any) -> int:
        if len(written) == 2:
            raise KeyboardInterrupt
        written.append(path)
        return write(path, *arguments, **more)

    monkeypatch.setattr(Path, "write_text", interrupted)
    assert main(["export", "c", str(tmp_path / "robot"), "--strategy", "soft"]) == 130
    assert list(tmp_path.iterdir()) == []
    assert "interrupted" in capsys.readouterr().err


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


@pytest.mark.parametrize(
    ("before", "after", "names"),
    [
        ("#define VS_WORLD_CREDIBLE_THRESHOLD VS_R(0.95)", "#define VS_WORLD_CREDIBLE_THRESHOLD VS_R(0.9)",
         "VS_WORLD_CREDIBLE_THRESHOLD"),
        ("//@ decision.credible_threshold = 0.95", "//@ decision.credible_threshold = 0.9",
         "decision.credible_threshold"),
        ("#define VS_RMS_THRESHOLD VS_R(1.33)", "#define VS_RMS_LIMIT VS_R(1.33)", "VS_RMS_LIMIT VS_RMS_THRESHOLD"),
    ],
)  # fmt: skip
def test_an_edited_header_is_noticed(
    before: str, after: str, names: str, library: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (library / "src" / "vibroswarm_parameters.h").read_text()
    assert before in text
    (tmp_path / "edited.h").write_text(text.replace(before, after))
    assert check(tmp_path / "edited.h", "--strategy", "soft") == 1
    said = capsys.readouterr().out
    assert all(name in said for name in names.split())


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("int main(void) { return 0; }\n", "is not a header of vibroswarm"),
        ("//@ swarm.robots = -3\n", "swarm.robots"),
        ("//@ swarm.robots = = 3\n", "is not TOML"),
    ],
)
def test_a_wrong_header_is_refused(
    text: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "wrong.h").write_text(text)
    assert check(tmp_path / "wrong.h") == 2
    assert said in capsys.readouterr().err
    assert check(tmp_path) == 2
    assert "holds 0 files" in capsys.readouterr().err


def test_robots_that_know_their_places_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    true = ["--set", "localisation.method=true"]
    said = refusal_of(capsys, "export", "c", str(tmp_path / "x"), "--strategy", "places", *true)
    assert "localisation.method: is 'true'" in said
    assert "localisation.method=mixture" in said
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize(
    ("option", "value", "functions"),
    [
        ("energies", "true", "place_samples.py"),
        ("draws", "3", "place_samples.py"),
        ("share_map", "true", "place_summaries.py"),
    ],
)
def test_options_of_places_are_refused_by_name(
    option: str, value: str, functions: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With the file and line of what would have to be exported, and the value that can be."""
    set_to = ["--strategy", "places", "--set", "localisation.method=mixture"]
    set_to += ["--set", f"strategy.places.{option}={value}", "--set", "strategy.places.map_every=2"]
    said = refusal_of(capsys, "export", "c", str(tmp_path / "x"), *set_to)
    assert f"strategy.places.{option}: {value}: " in said
    assert f"see vibroswarm/strategies/{functions}, line" in said
    assert f"leave it at {'0' if option == 'draws' else 'false'}" in said
    assert not (tmp_path / "x").exists()


STRANGE = '''
"""A strategy with a line that cannot be exported."""
import numpy as np
from vibroswarm.strategies.base import strategy_in

class State:
    decision: int

def begin(s, a, d, p, w):
    s.decision = -1

def on_sample(s, a, x, out, d, p, w):
    EXPRESSION
    return True

def decision(s, a, p, w):
    return s.decision

strange = strategy_in(__name__, "strange")
'''


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("out.bit = {0: 1, 1: 0}[x.reading]", "Dict '{0: 1, 1: 0}'"),
        ("out.bit = int(np.sign(x.reading))", "the call 'np.sign(x.reading)'"),
    ],
)
def test_a_strategy_that_cannot_be_exported_is_refused_with_its_line(
    line: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "strange.py").write_text(STRANGE.replace("EXPRESSION", line))
    arguments = ["--strategy", f"{tmp_path / 'strange.py'}:strange"]
    assert f"strange.py, line 13: {said}" in refusal_of(capsys, "export", "c", tmp_path / "robot", *arguments)
    assert not (tmp_path / "robot").exists()


@pytest.mark.parametrize(
    ("row", "advice"),
    [("State", "declare it in the class Arrays"), ("Message", "use a field for each of its numbers")],
)
def test_arrays_of_state_and_message_are_refused(
    row: str, advice: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = STRANGE.replace("import strategy_in", "import array, strategy_in").replace(
        "EXPRESSION", "out.bit = x.reading"
    )
    text = text.replace("class State:\n", "class Message:\n    bit: int\n\nclass State:\n")
    text = text.replace(f"class {row}:\n", f'class {row}:\n    last = array("float64", "3")\n')
    (tmp_path / "strange.py").write_text(text)
    arguments = ["--strategy", f"{tmp_path / 'strange.py'}:strange"]
    said = refusal_of(capsys, "export", "c", str(tmp_path / "robot"), *arguments)
    assert (
        f"{row} of strategy 'strange': 'last' is an array, which an exported program cannot hold in {row}"
        in said
    )
    assert advice in said
    assert not (tmp_path / "robot").exists()


def path_with(folder: Path, **scripts: str) -> str:
    """Write the programs ``arm-none-eabi-NAME`` into a folder; return the value of PATH that finds them first."""
    folder.mkdir()
    for name, text in scripts.items():
        path = folder / f"arm-none-eabi-{name}"
        path.write_text(f"#!/bin/sh\n{text}\n")
        path.chmod(0o755)
    return f"{folder}:/usr/bin:/bin"


@pytest.mark.parametrize("size", ["exit 1", "exit 0", None])
def test_without_the_tool_for_sizes_the_library_is_written(
    size: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scripts = {"gcc": "exit 0"} | ({} if size is None else {"size": size})
    monkeypatch.setenv("PATH", path_with(tmp_path / "bin", **scripts))
    if size is None:
        monkeypatch.setattr(c_library, "SIZE_TOOL", "no-such-tool", raising=False)
    assert "is missing or fails" in output_of(capsys, "export", "c", tmp_path / "x", "--strategy", "none")
    assert (tmp_path / "x" / "src" / "vibroswarm.c").exists()


def test_the_size_is_stated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    listed = "echo text data bss dec hex filename; echo 100 20 3 123 7b x"
    monkeypatch.setenv("PATH", path_with(tmp_path / "bin", gcc="exit 0", size=listed))
    assert "120 bytes of flash, 23 bytes of static RAM" in output_of(
        capsys, "export", "c", tmp_path / "x", "--strategy", "none"
    )


def test_a_compiler_that_takes_too_long_is_quoted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(
        "PATH", path_with(tmp_path / "bin", gcc="echo so slow >&2; exec sleep 20", size="exit 0")
    )
    monkeypatch.setattr(c_library, "SECONDS", 0.5)
    with pytest.raises(RunError, match=r"arm-none-eabi-gcc failed: so slow$"):
        c_library.measured(tmp_path)


def build_sketch(library: Path, folder: Path, around: str) -> None:
    """Compile the library, and with it the C++ file ``around``, which includes the sketch."""
    if shutil.which("g++") is None:
        pytest.skip("g++ is not installed")
    include = ["-I", str(library / "src"), "-I", str(library / "examples" / "inspection")]
    sources = [str(path) for path in (library / "src").glob("*.c")]
    subprocess.run(["gcc", *STRICT, QUICKLY, *include, "-c", *sources], cwd=folder, check=True)
    objects = [path.name for path in folder.glob("*.o")]
    subprocess.run(["g++", "-Wall", "-Werror", *include, around, *objects], cwd=folder, check=True)


@needs_gcc
@pytest.mark.parametrize("name", ["own sensor", "`dirichlet`, two motors"])  # soft's is run below
def test_the_sketch_compiles_as_cpp(name: str, tmp_path: Path) -> None:
    library = tmp_path / "a library"
    c_library.write_library(scenario_for(name), library)
    sketch = (library / "examples/inspection/inspection.ino").read_text()
    assert ("vs_observed" in sketch, "class from 0 to 2" in sketch) == (
        name != "own sensor",
        name == "own sensor",
    )
    (tmp_path / "sketch.cpp").write_text(
        "#include <stdint.h>\nstatic uint32_t micros() { return 0; }\n"
        '#include "inspection.ino"\nint main() { setup(); loop(); }\n'
    )
    build_sketch(library, tmp_path, "sketch.cpp")


STARTED_SKETCH = """
#include <stdint.h>
#include <stdio.h>
static uint32_t time_us;
static uint32_t micros() { return time_us += 50; }
#include "inspection.ino"
int main()
{
    setup();
    for (int k = 0; k < 2000; k++)
        loop();
"""
LATE_SKETCH = (
    STARTED_SKETCH
    + """
    const long steps_before = robot.tick - robot.missed;
    time_us += 1010000; /* a driver of the sketch that takes 1.01 s */
    loop();
    printf("%ld %ld %ld %lu\\n", (long)robot.tick, (long)robot.missed, robot.tick - robot.missed - steps_before,
           (unsigned long)time_us / PERIOD_US);
}
"""
)


@needs_gcc
def test_periods_that_a_sketch_misses_are_not_made_up_for(library: Path, tmp_path: Path) -> None:
    (tmp_path / "late.cpp").write_text(LATE_SKETCH)
    build_sketch(library, tmp_path, "late.cpp")
    done = subprocess.run([tmp_path / "a.out"], capture_output=True, text=True, check=True)
    tick, missed, steps_after, periods = map(int, done.stdout.split())
    assert tick == periods + 1  # the clock is that of the board: the first step is at time 0
    assert missed in (49, 50)  # by when in a period the driver began
    assert steps_after == 1


@needs_gcc
def test_a_robot_that_fails_its_own_test_does_not_start(library: Path, tmp_path: Path) -> None:
    """Those that pass it do: the test above."""
    copy = shutil.copytree(library, tmp_path / "copy")
    header = copy / "src" / "vibroswarm_parameters.h"
    header.write_text(header.read_text().replace("VS_WORLD_PRIOR_BETA 1", "VS_WORLD_PRIOR_BETA 2"))
    (tmp_path / "failing.cpp").write_text(STARTED_SKETCH + 'printf("%ld\\n", (long)robot.tick); }')
    build_sketch(copy, tmp_path, "failing.cpp")
    done = subprocess.run([tmp_path / "a.out"], capture_output=True, text=True, check=True)
    assert int(done.stdout) == 0


PACKETS = """
#include <stdio.h>
#include <string.h>
#include "vibroswarm.h"
#include "vibroswarm_parameters.h"
void vs_poll(void) {}
int main(void)
{
    vs_Message sent, heard;
    uint8_t packet[VS_PACKET_BYTES];
    vs_int sender = 0, number = 0;
    memset(&sent, 0, sizeof sent);
    sent.bit = 1;
    sent.number = -7;
    sent.at_x_m = 0.125;
    const vs_int length = vs_pack(&sent, 3, 70000, packet);
    for (int k = 0; k < length; k++)
        printf("%02x", packet[k]);
    const bool reads = vs_unpack(packet, length, &heard, &sender, &number);
    printf(" %d %d %d", reads, (int)sender, (int)number);
    printf(" %d %d %g", (int)heard.bit, (int)heard.number, (double)heard.at_x_m);
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


FAILING_SENSORS = """
#include <stdio.h>
#include "vibroswarm.h"
#include "vibroswarm_parameters.h"
void vs_poll(void) {}
static vs_Robot robot;
int main(void)
{
    const vs_real vast = (vs_real)(sizeof(vs_real) == 4 ? 3e18 : 3e153); /* the sum of squares is infinite */
    char line[VS_LOG_BYTES];
    vs_start(&robot, 1, 0, 0);
    for (int k = 0; k < 20000; k++) {
        const vs_real turned_deg = (vs_right_percent(&robot) - vs_left_percent(&robot)) / 60;
        vs_accelerate(&robot, k % 2 ? vast : 0, 0, 0);
        if (vs_step(&robot, k % 10 == 5 ? VS_NAN : k % 10 == 6 ? VS_INFINITY : turned_deg, 1000)) {
            vs_sample(&robot, vs_observed(&robot));
            vs_work(&robot);
            vs_log_line(&robot, line);
        }
        vs_work(&robot);
    }
    printf("%ld %s", (long)robot.walk.legs, line);
    return 0;
}
"""


@needs_gcc
@pytest.mark.parametrize("precision", [1, 2])
def test_readings_that_are_not_finite_end_no_walk_and_are_not_logged(precision: int, tmp_path: Path) -> None:
    sources = written(scenario_for("soft"), tmp_path)
    printed = printed_by(FAILING_SENSORS, sources, precision)
    legs, line = printed.split(" ")
    assert int(legs) > 10  # a turn that never ends has no next leg
    assert line.split(",")[4] == ""  # the energy


@needs_gcc
@pytest.mark.parametrize("precision", [1, 2])
def test_packets_hold_messages_and_say_what_runs(precision: int, tmp_path: Path) -> None:
    sources = written(scenario_for("places"), tmp_path)
    printed = printed_by(PACKETS, sources, precision)
    packet, reads, *found, short, layout, program, unknown = printed.split()
    identity = re.search(
        r"VS_PROGRAM_ID UINT32_C\((\w+)\)", (sources / "vibroswarm_parameters.h").read_text()
    )
    assert identity is not None
    number = "f" if precision == 1 else "d"
    fields = (1, int(identity[1], 16), 3, 70000, 1, -7, 0.125, 0.0, 0.0, 0.0)
    assert bytes.fromhex(packet) == struct.pack(f"<BIBIii4{number}", *fields)
    assert (reads, found) == ("1", ["3", "70000", "1", "-7", "0.125"])
    assert (short, layout, program, unknown) == ("0", "0", "0", "0")


def test_robots_whose_numbers_no_packet_holds_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "swarm.robots: 257 robots cannot be exported" in refusal_of(
        capsys, "export", "c", tmp_path / "many", "--robots", "257"
    )
    parts_of(preset("paper").with_values({"swarm.robots": 256}))


QUICKLY = "-O0"
"""Strict C gives the same numbers at every level, and robots that test themselves at -Os are timed below."""


def run_with(sources: Path, around: Path, *flags: str) -> None:
    """Compile a program around the library to ``a.out`` beside it."""
    command = ["gcc", *STRICT, *flags, "-I", str(sources), *map(str, sources.glob("*.c")), str(around)]
    subprocess.run([*command, "-o", str(around.parent / "a.out"), "-lm"], check=True)


def printed_by(around: str, sources: Path, precision: int) -> str:
    """Compile a program around the library, run it, and return what it prints."""
    file = sources.parent / "around.c"
    file.write_text(around)
    run_with(sources, file, QUICKLY, f"-DVS_PRECISION={precision}")
    return subprocess.run([file.with_name("a.out")], capture_output=True, text=True, check=True).stdout


SELF_TEST = """
#include "vibroswarm.h"
void vs_poll(void) {}
static vs_Robot robot;
int main(void) { return vs_self_test(&robot) ? 0 : 3; }
"""


@needs_gcc
@pytest.mark.parametrize("strategy", ["own sensor"] if HAS_ARM else [*names(), *THREE_KINDS])
def test_robots_test_themselves(strategy: str, tmp_path: Path) -> None:
    """The others do on the emulated processor, below; ``soft`` does in its sketch, above."""
    sources = written(scenario_for(strategy), tmp_path)
    (tmp_path / "test.c").write_text(SELF_TEST)
    run_with(sources, tmp_path / "test.c", QUICKLY)
    assert subprocess.run([tmp_path / "a.out"], check=False).returncode == 0


@needs_gcc
@pytest.mark.parametrize(
    ("strategy", "flags", "before", "after"),
    [
        ("places", ["-DVS_PRECISION=1"], "", ""),  # float: components take other walls
        ("soft", [], "VS_WALKER_SAMPLE_INTERVAL_MS VS_R(", "VS_WALKER_SAMPLE_INTERVAL_MS VS_R(100 + "),
    ],
)
def test_what_is_not_the_simulated_program_fails_its_test(
    strategy: str, flags: list[str], before: str, after: str, tmp_path: Path
) -> None:
    sources = written(scenario_for(strategy), tmp_path)
    header = sources / "vibroswarm_parameters.h"
    text = header.read_text()
    assert before in text
    header.write_text(text.replace(before, after) if before else text)
    (tmp_path / "test.c").write_text(SELF_TEST)
    run_with(sources, tmp_path / "test.c", QUICKLY, *flags)
    assert subprocess.run([tmp_path / "a.out"], check=False).returncode == 3


def documented() -> dict[str, tuple[int, int, int]]:
    """Return precision, flash and static RAM of each strategy in the table of the document."""
    rows = re.findall(
        r"^\| `(\w+)` \| \w+ \((\d)\) \| ([\d,]+) \| ([\d,]+) \|",
        DOCUMENT.read_text(),
        re.MULTILINE,
    )
    return {
        name: (int(precision), int(flash.replace(",", "")), int(ram.replace(",", "")))
        for name, precision, flash, ram in rows
    }


def scenario_for(name: str) -> Any:
    if name in THREE_KINDS:
        floor = {
            "floor.source": "random:0.28,0.48,0.24",
            "task.name": "majority",
            "strategy.name": "dirichlet",
        }
        return preset("paper").with_values(floor | THREE_KINDS[name])
    return preset("paper").with_values({"strategy.name": name})


def test_every_shipped_strategy_is_exportable_as_documented() -> None:
    table = documented()
    assert list(table) == list(names())
    for name, (precision, _, _) in table.items():
        header = texts_of(scenario_for(name))["src/vibroswarm.h"]
        assert f"#define VS_PRECISION {precision} " in header, name
        assert ("vs_told_pose" in header) == (name in MAPPING), name


TEXTS: dict[str, dict[str, str]] = {}
"""Of the files of libraries, by the hash of their scenario."""


def texts_of(scenario: Any, library_files: Any = c_library.library_files) -> dict[str, str]:
    if scenario.hash not in TEXTS:
        TEXTS[scenario.hash] = library_files(scenario)
    return TEXTS[scenario.hash]


def written(scenario: Any, folder: Path) -> Path:
    """Write a scenario's library; return the folder of its sources."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(c_library, "library_files", texts_of)
        c_library.write_library(scenario, folder)
    return folder / "src"


def check_memory(name: str, found: c_library.Memory) -> None:
    assert found.flash <= 40 * 1024
    assert name == "field" or found.ram <= (2 * 1024 if name == "soft" else 16 * 1024)
    _, flash, ram = documented()[name]
    assert found.flash == pytest.approx(flash, rel=0.03)  # compilers differ a little
    assert found.ram == pytest.approx(ram, abs=64)


MAPPING = ("places", "explore", "field", "fading")
"""Strategies whose work would take many control periods at once."""


WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror"]
WARNED = ["-std=c99", "-O2", *WARNINGS]


@pytest.fixture
def compiled_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """A library is compiled once for each choice of flags, and only the program around it for each measurement.

    The compiler may warn of nothing, which does not change what it makes.
    """
    whole = c_library.compile_with

    def compile_around(sources: Path, around: str, flags: Sequence[str], program: Path) -> None:
        chosen = [flag for flag in flags if flag.startswith(("-O", "-f"))]
        folder = sources.parent / "".join(chosen)
        if not folder.exists():
            folder.mkdir()
            for header in sources.glob("*.h"):
                shutil.copy(header, folder)
            command = [c_library.COMPILER, *c_library.FLAGS, *chosen, *WARNINGS, "-c"]
            subprocess.run([*command, *map(str, sorted(sources.glob("*.c")))], cwd=folder, check=True)
        whole(folder, around, [*flags, *map(str, sorted(folder.glob("*.o")))], program)

    for module in (c_library, timing):
        monkeypatch.setattr(module, "compile_with", compile_around)


@needs_arm
@pytest.mark.usefixtures("compiled_once")
@pytest.mark.parametrize(
    "name",
    [
        *(FEW := ("soft", "places", "`dirichlet`, two motors", "`places`, two motors")),
        *(pytest.param(n, marks=pytest.mark.slow) for n in names() if n not in FEW),
    ],
)
def test_wheels_are_set_within_the_period_and_work_takes_the_documented_time(
    name: str, tmp_path: Path
) -> None:
    """And memory is within limits and as documented, and the compiler, which optimises, warns of nothing."""
    scenario = scenario_for(name)
    sources = written(scenario, tmp_path)
    memory = c_library.measured(sources)
    assert memory is not None
    if name in documented():
        check_memory(name, memory)
    found = timing.timed(sources, scenario, memory.flags)
    assert found is not None
    assert timing.unfit(scenario, memory, found) == []
    label = name if name in THREE_KINDS else f"`{name}`"
    row = re.search(rf"^\| {label} \|.*$", DOCUMENT.read_text(), re.MULTILINE)
    assert row is not None
    late_ms, load, waits_ms, is_fit = [cell.strip() for cell in row[0].split("|")[5:9]]
    assert is_fit == "yes"
    assert found.late_ms == pytest.approx(float(late_ms), rel=0.05, abs=0.06)  # compilers differ a little
    assert 100 * found.load == pytest.approx(float(load), rel=0.05, abs=0.1)
    assert timing.ms(found.waits) == pytest.approx(float(waits_ms), rel=0.05, abs=1)
    assert (timing.ms(found.work) > 100) == (name in MAPPING or "places" in name)
    if name == "`dirichlet`, two motors":  # a spectrum: three periods; all spectra take as long
        assert 40.0 < timing.ms(found.work) < 80.0


def test_too_little_memory_is_reported() -> None:
    flash, ram = timing.FLASH_BYTES, timing.RAM_BYTES - timing.STACK_BYTES
    assert timing.unfit(scenario_for("soft"), c_library.Memory(flash, ram, ""), None) == []
    assert timing.unfit(scenario_for("soft"), c_library.Memory(flash + 1, ram + 1, ""), None) == [
        "it takes 262145 bytes of flash, and there are 262144",
        "it takes 28673 bytes of static RAM, and there are 32768 with 4096 for the stack",
    ]


@needs_arm
def test_what_does_not_fit_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(timing, "TIMED_S", 6)  # a step that takes too long is seen at once
    options = ["--strategy", "soft", "--set", "run.control_period_ms=2"]
    said = words_of(capsys, "export", "c", tmp_path / "x", *options)
    assert "NOT FIT for the study's robots: wheels may be set" in said
    assert "with a control period of 2 ms" in said


@pytest.mark.usefixtures("unmeasured")
@pytest.mark.parametrize("robot", ["kilobot", "paper"])
def test_a_robot_with_another_processor_says_so(
    robot: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = output_of(capsys, "export", "c", tmp_path / "x", "--preset", robot, "--strategy", "soft")
    assert ("NOT FIT for a Kilobot: its ATmega328P has 8 bits" in said) == (robot == "kilobot")
    assert re.search("Size not measured: .* is not installed", " ".join(said.split()))


def test_a_strategy_that_was_typed_in_is_refused() -> None:
    space: dict[str, Any] = {}
    exec("def on_sample(s, a, x, out, d, p, w):\n    return True\n", space)  # noqa: S102
    register(replace(none, name="typed_in", on_sample=space["on_sample"]))
    with pytest.raises(InputError, match="its source cannot be read"):
        c_sources(parts_of(preset("paper").with_values({"strategy.name": "typed_in"})))


def compiled(folder: Path, *flags: str, compiler: str = "gcc") -> subprocess.CompletedProcess[str]:
    command = [compiler, *flags, "-x", "c", "-c", "-", "-I", ".", "-o", "/dev/null"]
    all_sources = "".join(f'#include "{path.name}"\n' for path in sorted(folder.glob("*.c")))
    return subprocess.run(command, cwd=folder, input=all_sources, capture_output=True, text=True, check=False)


@needs_gcc
@pytest.mark.slow
@pytest.mark.parametrize("strategy", [*sorted(names()), *THREE_KINDS])
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
    written_c = "".join(path.read_text(encoding="utf-8") for path in sources.glob("*.[ch]"))
    assert not re.search(r"\(\([^()]*\)\)[;,{]?$", written_c, re.MULTILINE), "doubled parentheses"
    assert not re.search(r"\(void\)\w", written_c), "a parameter that is not used"


@needs_gcc
def test_what_only_reads_takes_a_constant_and_what_breaks_numbers_is_refused(library: Path) -> None:
    header = (library / "src" / "vibroswarm.h").read_text(encoding="utf-8")
    for getter in ("vs_left_percent", "vs_right_percent", "vs_observed", "vs_time_s"):
        assert f"{getter}(const vs_Robot *r)" in header
    assert "vs_sample(vs_Robot *r" in header
    assert "vs_receive(vs_Robot *r, vs_int sender, vs_int number, const vs_Message *message)" in header
    assert compiled(library / "src", *WARNED).returncode == 0
    fast = compiled(library / "src", "-std=c99", "-ffast-math")
    assert fast.returncode != 0
    assert "compile without -ffast-math" in fast.stderr
    short = compiled(
        library / "src", "-std=c99", "-DVS_PRECISION=3", "-U__SIZEOF_DOUBLE__", "-D__SIZEOF_DOUBLE__=4"
    )
    assert short.returncode != 0
    assert "double has 4 bytes here" in short.stderr


@pytest.mark.usefixtures("unmeasured")
def test_a_robot_can_say_what_it_runs(library: Path, tmp_path: Path) -> None:
    def identity(folder: Path) -> dict[str, str]:
        text = (folder / "src" / "vibroswarm_parameters.h").read_text(encoding="utf-8")
        return dict(re.findall(r"#define (VS_(?:SCENARIO_HASH|CODE_HASH|PROGRAM_ID)) (.+)", text))

    same, other = tmp_path / "same", tmp_path / "other"
    assert main(["export", "c", str(same), "--strategy", "soft"]) == 0
    assert (
        main(["export", "c", str(other), "--strategy", "soft", "--set", "decision.min_observations=1"]) == 0
    )
    assert identity(same) == identity(library)
    assert (
        identity(same)["VS_SCENARIO_HASH"]
        == f'"{preset("paper").with_values({"strategy.name": "soft"}).hash}"'
    )
    assert re.fullmatch(r"UINT32_C\(0x[0-9a-f]{8}\)", identity(same)["VS_PROGRAM_ID"])
    assert identity(same)["VS_PROGRAM_ID"] != identity(other)["VS_PROGRAM_ID"]
