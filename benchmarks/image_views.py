"""Views of a plane: homography through marks, four sides of a frame, sampling between pixels."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from skimage.transform import ProjectiveTransform

from benchmarks.image_timing import against, cpu_ms
from registration.dye.perspective import find_homography, mapped
from registration.microscope.target import Target
from registration.microscope.view import _fitted

FloatArray = NDArray[np.float64]
READ_PX = 0.5


def view_rows(quick: bool) -> Iterator[dict[str, Any]]:
    """Rows of all views."""
    count = 50 if quick else 400
    yield homographies(count)
    yield frames(count // 4)
    yield sampling()


def camera(rng: np.random.Generator) -> FloatArray:
    """Return a view of 20 by 12 mm, turned and tilted by up to 30 degrees, about 30 px/mm."""
    turn, tilt = rng.uniform(-np.pi, np.pi), rng.uniform(-0.02, 0.02, 2)
    linear = 30 * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    affine = np.eye(3)
    affine[:2, :2], affine[:2, 2] = linear, rng.uniform(200, 600, 2)
    return affine @ np.array([[1, 0, -10], [0, 1, -6], [*tilt, 1 - 10 * tilt[0] - 6 * tilt[1]]])


def homographies(count: int) -> dict[str, Any]:
    """Marks read to half a pixel: error over the whole part, RMS px."""
    rng = np.random.default_rng(1)
    grid = np.stack(np.meshgrid(np.linspace(0, 20, 9), np.linspace(0, 12, 7)), -1).reshape(-1, 2)
    ways: dict[str, Any] = {
        "ours": lambda a, b: find_homography(a, b)[0],
        "cv2.findHomography": lambda a, b: cv2.findHomography(a, b, 0)[0],
        "skimage.ProjectiveTransform": lambda a, b: ProjectiveTransform.from_estimate(a, b).params,
    }
    off: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(count):
        true = camera(rng)
        places = rng.uniform([0, 0], [20, 12], (8, 2))
        read = mapped(true, places) + rng.normal(0, READ_PX, (8, 2))
        for name, way in ways.items():
            off[name].append(
                float(np.mean((mapped(way(places, read), grid) - mapped(true, grid)) ** 2))
            )
    found = {
        name: (float(np.sqrt(np.median(off[name]))), cpu_ms(lambda w=way: w(places, read), 20))
        for name, way in ways.items()
    }
    return against("homography through 8 marks read to 0.5 px", "px", found.pop("ours"), **found)


def side_lines(pixels: FloatArray, side: FloatArray, target: Target) -> FloatArray:
    """Fit a line to each side's pixels by OpenCV and return the view through their corners."""
    lines = []
    for number in range(4):
        points = pixels[side == number].astype(np.float32)
        vx, vy, x, y = cv2.fitLine(points, cv2.DIST_L12, 0, 1e-3, 1e-4).ravel().astype(float)
        lines.append([-vy, vx, vy * x - vx * y])
    left, bottom, right, top = np.array(lines)
    crossed = np.cross([left, bottom, right, top], [bottom, right, top, left])
    x, y = target.size_mm
    corners = np.array([[0, 0], [x, 0], [x, y], [0, y]], np.float64)
    return np.asarray(find_homography(corners, crossed[:, :2] / crossed[:, 2:])[0])


def frames(count: int) -> dict[str, Any]:
    """Middles of four sides to 0.3 px, 2 % of them off by 6 px: worst place of the frame, px."""
    rng = np.random.default_rng(2)
    target = Target((16.0, 13.0), 0.3, 3.0, np.zeros((1, 2)))
    x, y = target.size_mm
    grid = np.stack(np.meshgrid(np.linspace(0, x, 7), np.linspace(0, y, 7)), -1).reshape(-1, 2)
    off: dict[str, list[float]] = {"ours": [], "cv2.fitLine": []}
    for _ in range(count):
        true = camera(rng)
        ends = target.sides
        places = np.concatenate([np.linspace(*end, 50) for end in ends])
        side = np.repeat(np.arange(4.0), 50)
        pixels = mapped(true, places) + rng.normal(0, 0.3, (200, 2))
        pixels[rng.random(200) < 0.02] += 6.0
        for name, view in (
            ("ours", _fitted(target, true, pixels, side)[0]),
            ("cv2.fitLine", side_lines(pixels, side, target)),
        ):
            off[name].append(float(np.abs(mapped(view, grid) - mapped(true, grid)).max()))
    ms = {
        "ours": cpu_ms(lambda: _fitted(target, true, pixels, side)),
        "cv2.fitLine": cpu_ms(lambda: side_lines(pixels, side, target)),
    }
    found = {name: (float(np.median(values)), ms[name]) for name, values in off.items()}
    return against("frame's four sides to a homography", "px", found.pop("ours"), **found)


def sampling() -> dict[str, Any]:
    """A slope of one level a pixel sampled at 200,000 places between pixels: worst error."""
    rng = np.random.default_rng(3)
    image = np.arange(640, dtype=np.float32)[None].repeat(480, 0)
    at = rng.uniform(2, 470, (1000, 200, 2)).astype(np.float32)
    u, v = at[..., 0], at[..., 1]

    def by_cv2() -> Any:
        return cv2.remap(image, u, v, cv2.INTER_LINEAR)

    def by_scipy() -> Any:
        return map_coordinates(image, [v, u], order=1)

    ours = float(np.abs(by_cv2() - u).max()), cpu_ms(by_cv2)
    peer = float(np.abs(by_scipy() - u).max()), cpu_ms(by_scipy)
    return against(
        "bilinear samples by cv2.remap", "px", ours, **{"scipy.ndimage.map_coordinates": peer}
    )
