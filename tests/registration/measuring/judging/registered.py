"""Handmade registration numbers for judging tests."""

from typing import Any

import numpy as np

from kernels.arrays import FloatArray

GUARDED = {"decision_rule": "guarded", "conformance_level": 0.95}
CONFORMANCE = GUARDED | {"decision_rule": "conformance"}
"""``judging`` of numbers that were judged by guard bands, and will be again."""


def vessel(
    number: int, errors_um: FloatArray, designed_um: float = 500.0, noise_um: float = 4.0,
    u_um: float = 25.0, spacing: float = 0.12, **more: Any,
) -> dict[str, Any]:  # fmt: skip
    """A straight vessel with those errors of its sections; 0 measured where error is -designed."""
    n = len(errors_um)
    along = (np.arange(n) + 0.5) * spacing
    measured = designed_um + np.asarray(errors_um, dtype=float)
    free = measured[measured > 0]
    mean = float(free.mean()) if len(free) else 0.0
    return {
        "vessel": number, "kind": "channel", "designed_um": designed_um, "measured_um": mean,
        "error_percent": 100 * (mean / designed_um - 1), "length_mm": n * spacing, "open": True,
        "offset_um": 5.0, "unseen_mm": [], "unmeasured_mm": [], "along_mm": along.tolist(),
        "interval_95_um": [u_um] * n,
        "diameter_um": measured.tolist(), "noise_um": [noise_um] * n,
        "designed_along_um": [designed_um] * n,
        "place_mm": np.stack([along, 0 * along + number, 0 * along], axis=1).tolist(), **more,
    }  # fmt: skip


def registration(*vessels: dict[str, Any], **more: Any) -> dict[str, Any]:
    """All that the judgement and the verdict read."""
    return {
        "vessels": list(vessels), "defects": [], "scaled": {"rms_um": 10.0},
        "rigid": {"rms_um": 40.0}, "ambiguity": {"flag": False}, **more,
    }  # fmt: skip


def change(number: int, low: float, high: float, **more: Any) -> dict[str, Any]:
    """A bulge that stands out from its vessel."""
    return {
        "kind": "bulge", "vessel": number, "other": None, "from_mm": low, "to_mm": high,
        "at_mm": (low + high) / 2, "point_mm": [0.0, 0.0, 0.0], "size_um": 30.0, "error_um": 8.0,
        "percent": 6.0, "wall_um": 15.0, "significance": 9.0, "seen": True, **more,
    }  # fmt: skip
