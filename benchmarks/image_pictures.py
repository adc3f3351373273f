"""Print picture processing: threshold between two classes, half-level width, spots."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.signal import peak_widths
from skimage.filters import threshold_li, threshold_minimum, threshold_otsu
from skimage.measure import label, regionprops

from benchmarks.image_timing import against, cpu_ms
from registration.devices.microscope.ink_absorption import shade_profile
from registration.devices.microscope.profiles import Profiles, middles
from registration.devices.microscope.widths import _edges
from registration.overlay.raster import Raster, spots
from registration.segmentation.levels import sparse_levels

FloatArray = NDArray[np.float64]


def picture_rows(quick: bool) -> Iterator[dict[str, Any]]:
    """Rows of all pictures."""
    for share in (0.005, 0.02, 0.1):
        yield levels(share)
    yield edges(100 if quick else 1000)
    yield patches()


def levels(share: float) -> dict[str, Any]:
    """Gel with few lumens, and as many mixed voxels: threshold off the middle, of the gap."""
    rng, few = np.random.default_rng(1), int(share * 500_000)
    values = np.concatenate(
        [
            rng.normal(100, 8, 500_000 - 2 * few),
            rng.normal(20, 8, few),
            rng.uniform(20, 100, few),
        ]
    )
    ways: dict[str, Any] = {
        "ours": lambda found: sparse_levels(found).half,
        "skimage.threshold_otsu": threshold_otsu,
        "skimage.threshold_li": threshold_li,
        "skimage.threshold_minimum": threshold_minimum,
    }
    found = {
        name: (abs(float(way(values)) - 60) / 80, cpu_ms(lambda w=way: w(values), 1))
        for name, way in ways.items()
    }
    measure = f"level between gel and lumens of {share:.1%}, as many mixed"
    return against(measure, "of the gap", found.pop("ours"), **found)


def edges(count: int) -> dict[str, Any]:
    """Width at half level of noisy profiles (4 %) of an opaque line, 300 µm: RMS error, µm."""
    rng = np.random.default_rng(2)
    across = np.linspace(-0.8, 0.8, 161)
    clean = shade_profile(across, 0.3, 1e3, 0.02)
    seen = Profiles(across, clean + rng.normal(0, 0.04, (count, 161)), np.ones(count, bool))
    seen = seen.smoothed(0.03)

    def ours() -> FloatArray:
        middle, found = middles(seen, 0.3)
        left, right, _ = _edges(seen, middle, found, 0.3)
        return right - left

    def library() -> FloatArray:
        wide = [
            peak_widths(one, [int(np.argmax(one))], 0.5)[0][0] * seen.step_mm for one in seen.values
        ]
        return np.array(wide)

    def error(wide: FloatArray) -> float:
        return 1e3 * float(np.sqrt(np.nanmean((wide - 0.3) ** 2)))

    return against(
        "line's width at half level", "µm", (error(ours()), cpu_ms(ours, 2)),
        **{"scipy.signal.peak_widths": (error(library()), cpu_ms(library, 2))},
    )  # fmt: skip


def patches() -> dict[str, Any]:
    """Spots of a million pixels: how many there are."""
    rng = np.random.default_rng(3)
    mask = cv2.GaussianBlur(rng.normal(size=(1000, 1000)), (0, 0), 4) > 0.1
    raster = Raster((0.0, 0.0), 0.01, (1000, 1000))

    def ours() -> float:
        return float(len(spots(mask, raster, 0.02, 0.0)))

    def library() -> float:
        return float(
            sum(one.area * 1e-4 >= 0.02 for one in regionprops(label(mask, connectivity=2)))
        )

    return against(
        "spots in a mask", "spots", (ours(), cpu_ms(ours, 2)),
        **{"skimage.regionprops": (library(), cpu_ms(library, 2))},
    )  # fmt: skip
