"""Benchmark of missing ink over older ink, told by heights: false gaps, detection, length.

``python -m benchmarks.observe_heights --layers 200``. Height maps of solid layers over solid
ones by `checkers.height_painter`: lines of 0.15 to 0.3 mm, 20 to 40 µm a pixel, ridges, bows,
drooping rims, noise of 3 to 15 % of a layer. Clock: none; CPU seconds of a look are told.
"""

from __future__ import annotations

import argparse
import json
import time

import numpy as np

from benchmarks.checkers.height_painter import SolidLayer, solid_layer
from benchmarks.machine import machine, row
from registration.inspection import ExpectedLines, LayerFindings, see_layer

LENGTHS_MM = (0.2, 0.3, 1.0)
PLANTED = 40


def expected(layer: SolidLayer) -> ExpectedLines:
    """The layer over one of the same outline that is written across."""
    n = len(layer.start)
    start, end = (np.hstack([p, np.full((n, 1), 0.3)]) for p in (layer.start, layer.end))
    below = (0.0, 0.0, layer.thickness)
    number = np.repeat([0, 1], n)
    return ExpectedLines(
        np.vstack([start[:, [1, 0, 2]] - below, start]),
        np.vstack([end[:, [1, 0, 2]] - below, end]),
        np.full(2 * n, layer.width),
        np.arange(2 * n),
        number,
        number == 1,
    )


def look(seed: int, gaps: tuple[tuple[float, float], ...] = ()) -> LayerFindings:
    """See one painted layer."""
    layer = solid_layer(np.random.default_rng(seed), gaps)
    return see_layer(layer.picture, layer, expected(layer), thickness_mm=layer.thickness)


def main() -> None:
    """Run and print JSON."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--layers", type=int, default=200)
    said = parser.parse_args()
    begun = time.process_time()
    sound = [look(seed) for seed in range(said.layers)]
    seconds = (time.process_time() - begun) / said.layers
    false = sum(bool(found.gaps) for found in sound)
    share = float(np.mean([found.seen_share for found in sound]))
    rows = [
        row("sound solid layers with a gap found", false, f"of {said.layers}", "0", false == 0),
        row("share of their way seen, mean", round(share, 3), ""),
    ]
    for length in LENGTHS_MM:
        found, off, other = 0, [], 0
        for seed in range(100_000, 100_000 + PLANTED):
            plain = solid_layer(np.random.default_rng(seed))
            begin = len(plain.start) // 4 * plain.size + 0.3 * (plain.size - plain.width)
            gaps = look(seed, ((begin, begin + length),)).gaps
            own = [gap for gap in gaps if gap.from_mm < begin + length and gap.to_mm > begin]
            found += bool(own)
            other += len(gaps) - len(own)
            off += [gap.length_mm - length for gap in own[:1]]
        rows += [
            row(f"gaps of {length:g} mm found", found, f"of {PLANTED}", ">= 38", found >= 38),
            row("  beside them, false ones", other, "", "0", other == 0),
            row("  length off, rms", round(1e3 * float(np.sqrt(np.mean(np.square(off)))), 1), "µm"),
        ]
    rows.append(row("CPU s per look, painting included", round(seconds, 2), "s"))
    print(json.dumps({"machine": machine(), "rows": rows}, indent=1))


if __name__ == "__main__":
    main()
