"""Dots of an OCT calibration target: centres by ours, by scikit-image and by OpenCV."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from skimage.measure import label, regionprops
from skimage.segmentation import clear_border

from benchmarks.image_timing import against, cpu_ms
from registration.optics.grid_target import _centres

FloatArray = NDArray[np.float64]


def target_rows(quick: bool) -> Iterator[dict[str, Any]]:
    """Rows at several levels of noise."""
    for noise in (0.5, 3.0):
        yield centres(noise)


def dotted(noise: float) -> tuple[FloatArray, FloatArray]:
    """Return a flattened picture of 20 by 20 dots, and their true centres (x, y), voxels."""
    rng = np.random.default_rng(1)
    turn = np.array([[np.cos(0.06), -np.sin(0.06)], [np.sin(0.06), np.cos(0.06)]])
    index = np.stack(np.meshgrid(np.arange(20), np.arange(20)), -1).reshape(-1, 2)
    true = (index - 9.5) @ turn.T * 17 + 200
    y, x = np.mgrid[:400, :400]
    away = np.full((400, 400), np.inf)
    for u, v in true:
        part = (slice(int(v) - 12, int(v) + 13), slice(int(u) - 12, int(u) + 13))
        away[part] = np.minimum(away[part], np.hypot(x[part] - u, y[part] - v))
    flat = 10 - 20 / (1 + np.exp(-(away - 4.3) / 0.4))
    return cv2.GaussianBlur(flat + rng.normal(0, noise, flat.shape), (0, 0), 0.8), true


def by_regions(flat: FloatArray) -> FloatArray:
    """Return weighted centres of whole dots by scikit-image."""
    dots = regionprops(clear_border(label(flat > 0)), np.maximum(flat, 0))
    usual = np.median([dot.area for dot in dots if dot.area > 4])
    kept = [dot.centroid_weighted for dot in dots if usual / 3 < dot.area < 3 * usual]
    return np.array(kept)[:, ::-1]


def by_blobs(flat: FloatArray) -> FloatArray:
    """Return centres by OpenCV's blob detector."""
    options = cv2.SimpleBlobDetector_Params()
    options.blobColor, options.minArea, options.maxArea = 255, 20, 400
    options.filterByCircularity = options.filterByConvexity = options.filterByInertia = False
    options.minDistBetweenBlobs = 5
    grey = cv2.normalize(flat, None, 0, 255, cv2.NORM_MINMAX, cv2.CV_8U)
    return np.array([one.pt for one in cv2.SimpleBlobDetector_create(options).detect(grey)])


def centres(noise: float) -> dict[str, Any]:
    """RMS error of the dots' centres, voxels."""
    flat, true = dotted(noise)
    ways: dict[str, Any] = {
        "ours": _centres,
        "skimage.regionprops": by_regions,
        "cv2.SimpleBlobDetector": by_blobs,
    }
    found = {}
    for name, way in ways.items():
        places = way(flat)
        off = (
            np.hypot(*(places[:, None] - true[None]).T).min(axis=0)
            if len(places)
            else np.full(400, 17.0)
        )
        found[name] = (
            float(np.sqrt(np.mean(np.minimum(off, 17) ** 2))),
            cpu_ms(lambda w=way: w(flat), 2),
        )
    return against(f"400 dots' centres, noise {noise:g} dB", "voxels", found.pop("ours"), **found)
