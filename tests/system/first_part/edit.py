"""Edits of a G-code file: other doses where its moves pass through a capsule."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Inside = Callable[[Array], NDArray[np.bool_]]

STEP_MM = 0.05


def between(low: Array, high: Array, reach_mm: float) -> Inside:
    """Return which points lie within ``reach_mm`` of the line between two places."""
    way = high - low

    def inside(points: Array) -> NDArray[np.bool_]:
        share = np.clip((points - low) @ way / (way @ way), 0, 1)
        return np.asarray(np.linalg.norm(points - low - share[:, None] * way, axis=1) < reach_mm)

    return inside


def rewritten(text: str, inside: Inside, factor: float) -> str:
    """Return the file with ``factor`` times the ink on all written moves inside.

    Absolute coordinates and E, as printctl writes them; moves are split where they pass the border.
    """
    place = np.zeros(3)
    plunger = moved = 0.0  # E of the file, and of the edited one
    out = []
    for line in text.splitlines():
        words = {w[0]: float(w[1:]) for w in re.findall(r"[XYZEF]-?\d*\.?\d+", line.split(";")[0])}
        target = np.array([words.get(a, place[k]) for k, a in enumerate("XYZ")])
        if line.startswith("G92"):
            if "E" in words:
                plunger = moved = words["E"]
            place = target
        elif re.match(r"G[01]\b", line):
            dose = words.get("E", plunger) - plunger
            plunger = words.get("E", plunger)
            length = float(np.linalg.norm(target - place))
            if dose > 0 and length > 0:
                count = max(int(length / STEP_MM), 1)
                shares = (np.arange(count) + 0.5) / count
                within = inside(place + shares[:, None] * (target - place))
                if within.any():
                    out += _split(line, place, target, dose, within, factor, moved, words.get("F"))
                    moved += dose * float(np.where(within, factor, 1.0).mean())
                    place = target
                    continue
            moved += dose
            if "E" in words:
                line = re.sub(r"E-?\d*\.?\d+", f"E{moved:.7f}", line)
            place = target
        out.append(line)
    return "\n".join(out) + "\n"


def _split(
    line: str, place: Array, target: Array, dose: float, within: NDArray[np.bool_],
    factor: float, moved: float, feed: float | None,
) -> list[str]:  # fmt: skip
    """Return the pieces of a move, each inside or outside as a whole."""
    count = len(within)
    borders = np.flatnonzero(np.diff(within.astype(int))) + 1
    out = []
    for first, last in zip([0, *borders], [*borders, count], strict=True):
        moved += dose * (last - first) / count * (factor if within[first] else 1.0)
        x, y, z = place + (target - place) * last / count
        dosed = f" E{moved:.7f}" if factor or not within[first] else ""
        out.append(f"G1 X{x:.3f} Y{y:.3f} Z{z:.4f}{dosed}" + (f" F{feed:g}" if feed else ""))
        feed = None
    return out
