"""Frames a second of a report's Explore while one slider after the other is moved, each frame a simulation.

The library is not asked: the page simulates by itself.  30 a second is the aim, on the 20 s recordings of the demo;
Chromium headless draws 60 at most.

    fracid demo --out runs/demo
    python benchmarks/explore.py runs/demo/*/report.html
"""

import argparse
import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from helpers.browser import Browser

AIM = 30.0

DRAG = """new Promise(done => {
  const row = explore.rows.find(one => one.slider.name === NAME), low = +row.input.min, high = +row.input.max;
  const start = performance.now(), times = [];
  const step = () => {
    const begin = performance.now();
    row.input.value = low + (high - low) * (0.3 + 0.4 * (times.length % 60) / 60);
    row.input.dispatchEvent(new Event("input"));
    requestAnimationFrame(() => {
      times.push(performance.now() - begin);
      if (performance.now() - start < 3000) return setTimeout(step, 0);
      done([1000 * times.length / (performance.now() - start), Math.max(...times)]);
    });
  };
  step();
})"""


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("reports", nargs="+", type=Path, help="report.html of fits")
    options = parser.parse_args()
    slowest = 1e9
    with Browser() as browser:
        for report in options.reports:
            browser.open(report, width=1440, height=900)
            browser.run("document.getElementById('explore').scrollIntoView({behavior: 'instant'})")
            browser.until("explore !== null && explore.charts.length > 0")
            for name in browser.run("explore.rows.map(row => row.slider.name)"):
                rate, longest = browser.run(DRAG.replace("NAME", json.dumps(name)))
                slowest = min(slowest, rate)
                print(f"{report.parent.name:24} {name:20} {rate:5.1f} frames a second, the longest {longest:4.0f} ms")
    sys.exit(f"{slowest:.1f} frames a second; {AIM:g} are the aim" if slowest < AIM else None)


if __name__ == "__main__":
    main()
