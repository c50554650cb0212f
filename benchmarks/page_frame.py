"""How long the page takes to draw a frame, with ten robots and 1200 s, in a headless Chromium.

    python benchmarks/page_frame.py [--frames 400] [--ratio 1]

A frame is drawn at scattered times, each far from the one before, which is the worst case: all marks, curves
and cards are made anew. Then frames follow one another as they do while playing at 20 times real time. The
clock runs, within an animation frame, around the page's whole draw function and the reading of one pixel of
each canvas, without which the browser may put the work off. The processor time is that of the page's thread for the
same frames drawn one after another, which other programs do not lengthen as they do the clock.
"""

from __future__ import annotations

import argparse
import importlib.util
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from vibroswarm.run_page.write import write_page

RECORDS = Path(__file__).parents[1] / "tests" / "helpers" / "page_records.py"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
OPTIONS = (
    "--no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking --disable-sync"
)
MEASURE = """async (times) => {
  const canvases = [...document.querySelectorAll("#past, #actors, #belief, .card canvas")];
  const contexts = canvases.map((canvas) => canvas.getContext("2d"));
  const took = [];
  for (const t of times) {
    await new Promise(requestAnimationFrame);
    const begin = performance.now();
    vibroswarm.seek(t);
    for (const context of contexts) context.getImageData(5, 5, 1, 1);
    took.push(performance.now() - begin);
  }
  return took;
}"""

AT_ONCE = """(times) => {
  const canvases = [...document.querySelectorAll("#past, #actors, #belief, .card canvas")];
  const contexts = canvases.map((canvas) => canvas.getContext("2d"));
  for (const t of times) {
    vibroswarm.seek(t);
    for (const context of contexts) context.getImageData(5, 5, 1, 1);
  }
}"""


def made_up_run() -> Any:
    spec = importlib.util.spec_from_file_location("page_records", RECORDS)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.make_record(robots=10, t_end_s=1200.0, min_observations=1500)


def measure(
    path: Path, browser: str, frames: int, ratio: float
) -> dict[str, tuple[np.ndarray[Any, Any], float]]:
    """Times of frames and mean processor time of one, ms, by the way in which they follow one another."""
    from playwright.sync_api import sync_playwright

    chance = np.random.default_rng(0)
    orders = {
        "scattered": chance.uniform(0, 1200, frames),
        "playing at 20x": 900 + np.arange(frames) * 20 / 60 % 300,
    }
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=browser, args=OPTIONS.split())
        size: Any = {"width": 1600, "height": 1000}
        page = chromium.new_page(viewport=size, device_scale_factor=ratio)
        page.goto(path.as_uri() + "#t=0")
        page.evaluate(MEASURE, [1.0, 600.0, 1100.0] * 5)
        inspector = page.context.new_cdp_session(page)
        inspector.send("Performance.enable", {"timeDomain": "threadTicks"})
        found = {}
        for name, times in orders.items():
            wanted = list(map(float, times))
            took = np.array(page.evaluate(MEASURE, wanted))
            before = processor_s(inspector)
            page.evaluate(AT_ONCE, wanted)
            found[name] = took, 1000 * (processor_s(inspector) - before) / frames
        chromium.close()
    return found


def processor_s(inspector: Any) -> float:
    """Processor time of the page's thread so far, s."""
    metrics = inspector.send("Performance.getMetrics")["metrics"]
    return next(float(metric["value"]) for metric in metrics if metric["name"] == "TaskDuration")


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--frames", type=int, default=400)
    parser.add_argument("--ratio", type=float, default=1.0, help="device pixels for each CSS pixel")
    options = parser.parse_args()
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        print(f"no browser on the path: none of {', '.join(BROWSERS)}; nothing measured")
        return 0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.html"
        write_page(made_up_run(), path)
        print(f"page of 10 robots, 1200 s: {path.stat().st_size / 1e6:.2f} MB (limit 3 MB)")
        print(f"frames of a 1600 x 1000 window, {options.ratio:g} device pixels per CSS pixel, no GPU;")
        print("clock around the whole draw and a reading of one pixel of each canvas (limit 10 ms)")
        for name, (took, processor_ms) in measure(path, browser, options.frames, options.ratio).items():
            median, high, most = np.percentile(took, [50, 95, 100])
            print(
                f"{name:>16}: median {median:5.2f} ms, 95th percentile {high:5.2f} ms, most {most:5.2f} ms; "
                f"processor {processor_ms:5.2f} ms"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
