"""Measure memory and time of the features of a signal on an emulated Cortex-M0+.

    PYTHONPATH=tests python benchmarks/features_on_robot.py

Flash and RAM are those of a program with the features less those of the same program without them. It needs
arm-none-eabi-gcc with newlib, and qemu-system-arm.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

from helpers.exported_features import features_in_c
from vibroswarm.export.c_library import ASSETS, COMPILER, FLAGS, SIZE_TOOL
from vibroswarm.export.timing import EMULATOR, ms

READINGS = 175
MAIN = """
#include <stdint.h>
#include <stdio.h>
#define NS_PER_TICK 40
static uint32_t now(void) { return *(volatile uint32_t *)0xE000E018; }
static void call_debugger(int operation, const void *argument)
{
    register int r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
}
static uint32_t spent(uint32_t then) { return ((then - now()) & 0xFFFFFF) * NS_PER_TICK; }
int main(void)
{
    static double out[7];
    static char text[60];
    uint32_t then, times[3] = {0, 0, 0};
    *(volatile uint32_t *)0xE000E014 = 0xFFFFFF;
    *(volatile uint32_t *)0xE000E018 = 0;
    *(volatile uint32_t *)0xE000E010 = 5;
    (void)out; then = now();
#ifdef FEATURES
    for (int32_t i = 0; i < COUNT; i++)
        wave[i] = (vs_stored)((i * 37 % 41) - 20) / 7;
    then = now(); moments(COUNT, 350, out); times[0] = spent(then);
    then = now(); band(COUNT, 350, 90, out); times[1] = spent(then);
    then = now(); peak(COUNT, 350, out); times[2] = spent(then);
#else
    times[0] = spent(then);
#endif
    sprintf(text, "%lu %lu %lu\\n", (unsigned long)times[0], (unsigned long)times[1], (unsigned long)times[2]);
    call_debugger(0x04, text);
    call_debugger(0x18, (const void *)0x20026);
    return 0;
}
void *_sbrk(int bytes) { (void)bytes; return 0; }
extern uint32_t stack_top[];
static void reset(void) { main(); }
__attribute__((section(".vectors"), used)) static const void *vectors[] = {stack_top, reset};
"""


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for header in ("vibroswarm_runtime.h", "vibroswarm_mathematics.h"):
            shutil.copy(ASSETS / header, folder)
        with_features = built(folder, features_in_c(1), ["-DFEATURES", f"-DCOUNT={READINGS}"])
        flash, ram = (
            one - other for one, other in zip(sizes(with_features), sizes(built(folder, "", [])), strict=True)
        )
        # As in ``export.timing``: the board's Cortex-M3 runs the code of a Cortex-M0+ as it is, 1 ns an instruction.
        moments, band, peak = instructions(with_features)
    print(f"{flash} bytes of flash, {ram} bytes of RAM")
    print(
        f"moments {1000 * ms(moments) / READINGS:.0f} us a reading, a band {1000 * ms(band) / READINGS:.0f} us"
    )
    print(f"spectrum {ms(peak):.0f} ms")


def built(folder: Path, features: str, defined: list[str]) -> Path:
    """Compile the program, with features or without."""
    source, program = folder / "program.c", folder / f"program{len(defined)}.elf"
    source.write_text(features + MAIN, encoding="utf-8")
    flags = [flag for flag in FLAGS if flag != "-Wl,-e,main"]
    script = ["-T", str(ASSETS / "timed_program.ld")]
    command = [COMPILER, *flags, "-Os", *defined, str(source), "-o", str(program), *script, "-lm"]
    subprocess.run(command, check=True)
    return program


def sizes(program: Path) -> tuple[int, int]:
    """Return flash and static RAM of a program, bytes."""
    done = subprocess.run([SIZE_TOOL, str(program)], check=True, capture_output=True, text=True)
    text, data, zeros = map(int, done.stdout.splitlines()[1].split()[:3])
    return text + data, data + zeros


def instructions(program: Path) -> list[int]:
    """Return the instructions of the moments, a band and the spectrum of one signal."""
    command = [
        EMULATOR, "-M", "mps2-an385", "-display", "none", "-monitor", "none", "-serial", "none",
        "-semihosting-config", "enable=on,target=native", "-icount", "shift=0", "-kernel", str(program),
    ]  # fmt: skip
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=60)
    return [int(word) for word in re.findall(r"\d+", done.stdout + done.stderr)]


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    main()
