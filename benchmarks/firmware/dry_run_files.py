"""G-code files that compare the simulated print time with real firmware's; not used for tuning.

Tuned on: ``calibration_curve`` (both bauds, board at 0.15 of real time), and lines without motion.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.firmware.gcode_files import HEAD, MotionFile

Lines = list[str]
SLICED_LINES = 160


def infill_with_hops(rows: int = 14) -> Lines:
    """Return a zigzag with a hop and a travel after each second row."""
    file, e = MotionFile(), 0.0
    file.move(3600, X=30.0, Y=30.0, Z=0.4)
    for i in range(rows):
        e += 0.11
        file.move(60 * (18 + i % 3), X=30.0 + 13.0 * ((i + 1) % 2), E=e)
        if i % 2:
            file.move(240, Z=1.4)
            file.move(4800, X=37.0, Y=30.0 + 0.35 * (i + 1))
            file.move(240, Z=0.4)
            file.move(2400, X=30.0)
        else:
            file.move(1200, Y=30.0 + 0.35 * (i + 1))
    return file.lines


def arc_helix(turns: int = 7, radius_mm: float = 5.5) -> Lines:
    """Return half circles by G2 and G3, which rise and push ink."""
    lines, e = [*HEAD, "G1 X40 Y40 F3600"], 0.0
    for i in range(2 * turns):
        e += 0.21
        side, code = (1 if i % 2 == 0 else -1), "G2" if (i // 4) % 2 == 0 else "G3"
        way = f"X{40 + (2 * radius_mm if side > 0 else 0):g} Y40 Z{0.05 * (i + 1):.2f}"
        lines.append(f"{code} {way} I{side * radius_mm:g} J0 E{e:.4f} F{900 + 100 * (i % 5)}")
    return lines


def short_curve(moves: int, seed: int, feeds_mm_s: tuple[float, ...]) -> Lines:
    """Return segments of 0.05 to 0.2 mm on a winding curve, at one speed after the other."""
    rng, lines = np.random.default_rng(seed), [*HEAD, "G1 X60 Y60 F3600"]
    x, y, e, angle = 60.0, 60.0, 0.0, 0.0
    for i in range(moves):
        length = float(rng.uniform(0.05, 0.2))
        angle += float(rng.normal(0.02, 0.05))
        x, y, e = x + length * math.cos(angle), y + length * math.sin(angle), e + 0.03 * length
        feed = 60 * feeds_mm_s[i * len(feeds_mm_s) // moves]
        lines.append(f"G1 X{x:.3f} Y{y:.3f} E{e:.4f} F{feed:g}")
    return lines


def lattice(cells: int = 7, pitch_mm: float = 1.7) -> Lines:
    """Return two layers of diagonal struts, each crossing cut into pieces."""
    file, e = MotionFile(), 0.0
    for layer in range(2):
        file.move(240, Z=0.3 * (layer + 1))
        for i in range(cells):
            across = pitch_mm * i
            file.move(3000, **_turned(layer, 70.0, 70.0 + across))
            for k in range(1, cells + 1):
                e += 0.02
                wave = across + 0.3 * (k % 2)
                file.move(60 * 14, **_turned(layer, 70.0 + pitch_mm * k, 70.0 + wave), E=e)
    return file.lines


def _turned(layer: int, along: float, across: float) -> dict[str, float]:
    return {"X": along, "Y": across} if layer == 0 else {"X": across, "Y": along}


def random_walk(steps: int = 110, seed: int = 4106) -> Lines:
    """Return steps of all lengths and directions with ink, some pulled back."""
    rng, file, e = np.random.default_rng(seed), MotionFile(), 0.0
    x = y = 60.0
    file.move(3600, X=x, Y=y)
    for _ in range(steps):
        x, y = (float(np.clip(v + rng.normal(0, 3.5), 20, 100)) for v in (x, y))
        e += float(rng.uniform(0, 0.1))
        file.move(float(rng.uniform(500, 2400)), X=x, Y=y, E=e)
        if rng.random() < 0.1:
            file.move(300, E=e - 0.2)
            file.move(300, E=e)
    return file.lines


def sliced(path: Path | None) -> Lines:
    """Return the first lines of a part sliced by the product, given as a file."""
    if path is None:
        return []
    text = path.read_text().splitlines()
    return [line for line in text if line.split(";")[0].strip()][:SLICED_LINES]


def validation_files(part: Path | None) -> dict[str, Callable[[], Lines]]:
    """Return the six files by name; the sliced one only where a part is given."""
    files: dict[str, Callable[[], Lines]] = {
        "infill with hops": infill_with_hops,
        "arc helix": arc_helix,
        "900 short segments": lambda: short_curve(900, 4103, (12.0, 40.0)),
        "lattice": lattice,
        "random walk": random_walk,
    }
    return files | ({"sliced part": lambda: sliced(part)} if part else {})
