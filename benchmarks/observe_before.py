"""Benchmark of ink over older ink by a camera, told by the picture before: gaps, false gaps.

``python -m benchmarks.observe_before --layers 300 [--seed N]``. Solid ridged layers of
translucent, opaque and matte ink by `checkers.stacked_layers`; the camera moves by up to 1.5 pixels
between the pictures, light and drying change, bubbles come and go. Clock: none; CPU seconds of a
look are told.
"""

from __future__ import annotations

import argparse
import json
import time

import numpy as np

from benchmarks.checkers.stacked_layers import KINDS, Layer, Stack, stack
from benchmarks.machine import machine, row
from registration.inspection import ExpectedLines, LayerFindings, see_layer

_SHOWN = 3
"""Older layers that the product is told of."""
_FAULTY = 10_000
"""Added to the seeds of layers with gaps."""


def expected(found: Stack) -> ExpectedLines:
    """The layer and those below, as the product takes them."""
    layers = [*found.older[-_SHOWN:], found.layer]
    return ExpectedLines(
        np.vstack([_places(one, 0) for one in layers]),
        np.vstack([_places(one, 1) for one in layers]),
        np.concatenate([np.full(len(one.at), one.width) for one in layers]),
        np.arange(sum(len(one.at) for one in layers)),
        np.concatenate([np.arange(len(one.at)) + 1000 * k for k, one in enumerate(layers)]),
        np.repeat(np.arange(len(layers)) == len(layers) - 1, [len(one.at) for one in layers]),
    )


def _places(layer: Layer, which: int) -> np.ndarray:
    return np.hstack([layer.ends()[which], np.full((len(layer.at), 1), 0.3)])


def look(found: Stack) -> LayerFindings:
    """See one painted layer."""
    return see_layer(found.picture, found, expected(found), before=found.before)


def _judged(found: Stack, seen: LayerFindings) -> tuple[int, int, int]:
    """Planted gaps in seen stations, of them found, and false ones."""
    base = 1000 * min(_SHOWN, len(found.older))
    stations, inside, hits = seen.stations, 0, 0
    real = set()
    for line, begin, end in found.gaps:
        own = (stations.stroke == base + line) & (stations.along_mm > begin)
        own &= stations.along_mm < end
        here = [
            k
            for k, gap in enumerate(seen.gaps)
            if gap.stroke == base + line and gap.from_mm < end and gap.to_mm > begin
        ]
        real.update(here)
        if own.any() and stations.seen[own].mean() > 0.7:
            inside, hits = inside + 1, hits + bool(here)
    return inside, hits, len(seen.gaps) - len(real)


def _seeds(first: int, count: int) -> range:
    return range(first, first + count)


def main() -> None:
    """Run and print JSON."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--layers", type=int, default=300)
    parser.add_argument("--faulty", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0, help="of the first sound layer")
    said = parser.parse_args()
    rows, begun, looks = [], time.process_time(), 0
    for kind in KINDS:
        part = 1 if kind == "translucent" else 10  # nothing is told of the others
        sound = [look(stack(seed, kind)) for seed in _seeds(said.seed, said.layers // part)]
        wrong, of = sum(bool(found.gaps) for found in sound), f"of {len(sound)}"
        share = float(np.mean([found.seen_share for found in sound]))
        told = float(np.mean([found.seen_share > 0.5 for found in sound]))
        total = np.zeros(3, int)
        planted = 0
        for seed in _seeds(said.seed + _FAULTY, said.faulty // part):
            painted = stack(seed, kind, gaps=3)
            total += _judged(painted, look(painted))
            planted += len(painted.gaps)
        looks += len(sound) + said.faulty // part
        rows += [
            row(f"{kind}: sound layers with a gap found", wrong, of, "0", wrong == 0),
            row(f"{kind}: share of the way seen, mean", round(share, 3), ""),
            row(f"{kind}: layers seen by more than half", round(told, 3), ""),
            row(f"{kind}: gaps of 0.5 to 1.5 mm in seen stations", int(total[0]), f"of {planted}"),
            row(f"{kind}:   of them found", int(total[1]), f"of {total[0]}", ">= 95 %",
                bool(total[1] >= 0.95 * total[0])),
            row(f"{kind}:   false ones beside them", int(total[2]), "", "0", not total[2]),
        ]  # fmt: skip
    spent = (time.process_time() - begun) / looks
    rows.append(row("CPU s per look, painting included", round(spent, 2), "s"))
    print(json.dumps({"machine": machine(), "rows": rows}, indent=1))


if __name__ == "__main__":
    main()
