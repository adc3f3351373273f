"""Table of predicted ink volume and line width by layer, with and without pressure lag."""

from __future__ import annotations

from typing import Any

import numpy as np

from kernels.arrays import IntArray
from printctl.checks.bead.predict import InkPrediction
from sim.gcode.bead import Bead


def layer_rows(prediction: InkPrediction) -> list[dict[str, Any]]:
    """A row for each layer that is written: volume, and width of its lines with and without lag."""
    late, prompt = (
        _by_layer(prediction.bead, prediction.source),
        _by_layer(prediction.prompt, prediction.prompt_source),
    )
    rows = []
    for layer, own in late.items():
        asked = prompt.get(layer)
        rows.append(
            {
                "head": prediction.head,
                "layer": layer,
                **own,
                "asked_ul": asked["laid_ul"] if asked else 0.0,
                "asked_width_mm": asked["width_mm"] if asked else 0.0,
            }
        )
    return rows


def _by_layer(bead: Bead, source: IntArray) -> dict[int, dict[str, Any]]:
    rows = np.flatnonzero(bead.writes)
    rows = rows[np.argsort(source[rows], kind="stable")]
    layers, first = np.unique(source[rows], return_index=True)
    by_number = {}
    for layer, own in zip(layers.tolist(), np.split(rows, first[1:]), strict=True):
        width, length = bead.width_mm[own], bead.pieces.length[own]
        order = np.argsort(width)
        way = np.cumsum(length[order])
        low, middle, high = np.searchsorted(way, way[-1] * np.array([0.05, 0.5, 0.95]))
        by_number[layer] = {
            "laid_ul": float(bead.flow.laid_ul[own].sum()),
            "width_mm": float(width[order][middle]),
            "narrow_mm": float(width[order][low]),
            "wide_mm": float(width[order][high]),
        }
    return by_number
