"""Painted layers and scans as the tests ask for them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.checkers import layer_painter as painter
from kernels.arrays import FloatArray
from printctl.inspection import ExpectedLines
from registration.scan import Scan


class Flat:
    """A frame straight from above, which sees no depth; a pixel's side, mm."""

    def __init__(self, px_mm: float) -> None:
        self.px_mm = px_mm

    def to_pixels(self, points_mm: FloatArray) -> FloatArray:
        """Pixels of places."""
        return np.asarray(points_mm)[:, :2] / self.px_mm


def lines_of(
    start: Any, end: Any, width: Any, *, stroke: Any = None, fresh: Any = True
) -> ExpectedLines:
    """Lines between places (n, 3), mm; each a stroke unless told; width of all or of each."""
    count = np.arange(len(start))
    return ExpectedLines(
        np.asarray(start, float),
        np.asarray(end, float),
        np.full(len(count), width, float),
        count,
        count if stroke is None else np.asarray(stroke),
        np.full(len(count), fresh),
    )


def mesh_of(voxel: tuple[float, ...], shape: tuple[int, ...]) -> list[FloatArray]:
    """Places z, y, x of voxels, mm, sparse."""
    axes = (step * np.arange(n) for step, n in zip(voxel, shape, strict=True))
    return np.meshgrid(*axes, indexing="ij", sparse=True)


def scan_of(light: FloatArray, voxel: tuple[float, float, float]) -> Scan:
    """OCT scan of a volume, depth down."""
    return Scan(
        np.asarray(light, np.uint16), voxel, 1.0, False, "linear", "oct", True, Path("painted")
    )


def from_above(depth_mm: float) -> FloatArray:
    """The matrix from the printer to a scan that looks down from so high."""
    to_scan = np.diag([1.0, 1.0, -1.0, 1.0])
    to_scan[2, 3] = depth_mm
    return to_scan


def expected(plan: painter.Plan, fresh: bool = True, first_stroke: int = 0) -> ExpectedLines:
    at = np.full((len(plan.width), 1), 0.3)
    stroke = plan.stroke.astype(np.int64) + first_stroke
    ends = (np.hstack([p, at]) for p in (plan.start, plan.end))
    return lines_of(*ends, plan.width, stroke=stroke, fresh=fresh)


def both(one: ExpectedLines, other: ExpectedLines) -> ExpectedLines:
    return ExpectedLines(
        *(np.concatenate([getattr(one, name), getattr(other, name)]) for name in vars(one))
    )


@dataclass
class Scene:
    """A square of 4 mm with one layout, 20 µm per px unless told."""

    seed: int
    kind: str = "opaque"
    layout: str = "rings"
    contrast: float = 0.4
    um_per_px: float = 20.0
    size: float = 4.0
    width: float = 0.3

    def plan(self) -> painter.Plan:
        rng = np.random.default_rng(self.seed)
        return painter.plan_layer(self.layout, self.size, self.width, rng)

    def paint(
        self,
        gaps: tuple[tuple[int, float, float], ...] = (),
        ratio: float = 1.0,
        thin: tuple[float, float, float] | None = None,
        **more: object,
    ) -> painter.Painted:
        """Paint it, all strokes from one way on to another with a part of their width."""
        rng = np.random.default_rng(self.seed + 1)
        plan = self.plan()
        look = painter.random_look(self.kind, rng, self.contrast)
        look.light = min(look.light, 0.25)
        ink = painter.lay(plan, rng, ratio=ratio, gaps=list(gaps))
        if thin is not None:
            at, stroke, along, width = ink
            less = (along > thin[0]) & (along < thin[1])
            ink = at, stroke, along, np.where(less, thin[2] * width, width)
        return painter.paint(plan, ink, list(gaps), self.size, self.um_per_px, look, rng, **more)  # type: ignore[arg-type]
