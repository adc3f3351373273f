"""Pictures of prints: thresholds, edges at half level, contours to pixels, spots, block means."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.signal import peak_widths
from shapely import Polygon, contains_xy
from skimage.draw import polygon2mask
from skimage.filters import threshold_li, threshold_minimum, threshold_otsu
from skimage.measure import block_reduce, label, regionprops

from benchmarks.image_timing import against, cpu_ms
from printctl.web.scan.slices import otsu
from registration.microscope.profiles import Profiles, middles
from registration.microscope.shade import shade_profile
from registration.microscope.widths import _edges
from registration.overlay.find import spots
from registration.overlay.raster import Raster
from registration.picture.shade import _averaged
from registration.segmentation.levels import sparse_levels

FloatArray = NDArray[np.float64]


def picture_rows(quick: bool) -> Iterator[dict[str, Any]]:
    """Rows of all pictures."""
    yield from thresholds()
    yield edges(100 if quick else 1000)
    yield contours()
    yield patches()
    yield blocks()


def thresholds() -> Iterator[dict[str, Any]]:
    """Two classes of grey values, one of them sparse: threshold off their middle, of their gap."""
    rng = np.random.default_rng(1)
    values = np.concatenate([rng.normal(30, 6, 1_000_000), rng.normal(100, 10, 1_000_000)])
    ours = abs(otsu(values) - 65) / 70, cpu_ms(lambda: otsu(values), 3)
    peer = abs(float(threshold_otsu(values)) - 65) / 70, cpu_ms(lambda: threshold_otsu(values), 3)
    yield against(
        "Otsu's threshold of 2 million voxels", "of the gap", ours,
        **{"skimage.threshold_otsu": peer},
    )  # fmt: skip
    for share in (0.005, 0.02, 0.1):
        yield levels(share)


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


def contours() -> dict[str, Any]:
    """A disc of 3 mm radius, 2000 corners, on pixels of 10 µm: error of its area, parts in 1e6."""
    angle = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    ring = np.column_stack([4.0 + 3 * np.cos(angle), 4.0 + 3 * np.sin(angle)])
    raster = Raster((0.0, 0.0), 0.01, (800, 800))
    true = np.pi * 9 / 0.01**2
    x, y = np.meshgrid(raster.x_mm, raster.y_mm)
    shape = Polygon(ring)

    def filled() -> Any:
        mask = np.zeros((800, 800), np.uint8)
        corners = np.round(ring / 0.01 * 65536).astype(np.int64).astype(np.int32)
        return cv2.fillPoly(mask, [corners], 1, shift=16)

    ways: dict[str, Any] = {
        "ours": lambda: raster.inside([ring]),
        "skimage.polygon2mask": lambda: polygon2mask((800, 800), ring[:, ::-1] / 0.01),
        "cv2.fillPoly": filled,
        "shapely.contains_xy": lambda: contains_xy(shape, x, y),
    }
    found = {
        name: (1e6 * abs(float(way().sum()) / true - 1), cpu_ms(way, 2))
        for name, way in ways.items()
    }
    return against("even-odd raster of a contour", "ppm of area", found.pop("ours"), **found)


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


def blocks() -> dict[str, Any]:
    """Means of blocks of 3 by 3 pixels of a picture: difference, grey levels."""
    image = np.random.default_rng(4).random((1800, 2400, 3))

    def ours() -> Any:
        return _averaged(image, 3)

    def by_cv2() -> Any:
        mean = cv2.resize(image, (800, 600), interpolation=cv2.INTER_AREA)
        return np.rint(255 * mean).astype(np.uint8)

    def by_skimage() -> Any:
        return np.rint(255 * block_reduce(image, (3, 3, 1), np.mean)).astype(np.uint8)

    def off(found: Any) -> float:
        return float(np.abs(found.astype(int) - ours()).max())

    return against(
        "block means of a picture", "levels", (0.0, cpu_ms(ours, 2)),
        **{
            "cv2.resize": (off(by_cv2()), cpu_ms(by_cv2, 2)),
            "skimage.block_reduce": (off(by_skimage()), cpu_ms(by_skimage, 2)),
        },
    )  # fmt: skip
