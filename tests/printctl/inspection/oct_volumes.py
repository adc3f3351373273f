"""Small OCT volumes of straight lines in layers: boxes of gel in a dim bath, with speckle."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from kernels.arrays import FloatArray
from printctl.inspection import ExpectedLines, LayerFindings, height_map, see_layer
from printctl.inspection.values import FloatImage
from registration.scan import Scan

WIDTH, THICK, VOXEL = 0.3, 0.2, (0.02, 0.03, 0.03)
GEL, BATH = 1500.0, 30.0

Piece = tuple[int, float, float, float, float]
"""Layer; x, y of one end; x, y of the other, mm; along x or y."""


@dataclass(frozen=True)
class Volume:
    """A painted volume, and what was to be written.

    Attributes
    ----------
    voxels : (z, y, x) uint16, depth down
    to_scan : (4, 4) float64
    pieces : Sequence of Piece
        Each a stroke.
    """

    voxels: np.ndarray
    to_scan: FloatArray
    pieces: Sequence[Piece]

    @property
    def lines(self) -> ExpectedLines:
        """All lines; those of the topmost layer are fresh."""
        layer = np.array([piece[0] for piece in self.pieces])
        z = (layer + 0.5) * THICK
        at = np.array([piece[1:] for piece in self.pieces])
        count = np.arange(len(layer))
        return ExpectedLines(
            np.column_stack([at[:, :2], z]),
            np.column_stack([at[:, 2:], z]),
            np.full(len(layer), WIDTH),
            count,
            count,
            layer == layer.max(),
        )

    def scan(self, voxels: np.ndarray) -> Scan:
        """Another volume of the same scanner."""
        return Scan(voxels, VOXEL, 1.0, False, "linear", "oct", True, Path("painted"))

    def picture(self, crop: int = 0) -> tuple[FloatImage, FloatArray]:
        """Height map of the topmost layer, so many voxels cut off all round; its frame."""
        inner = self.voxels[:, crop:-crop, crop:-crop] if crop else self.voxels
        moved = self.to_scan.copy()
        moved[:2, 3] -= crop * np.array(VOXEL[:0:-1])
        middle = (max(piece[0] for piece in self.pieces) + 0.5) * THICK
        return height_map(self.scan(inner), moved, middle, THICK, self.lines)

    def look(self) -> LayerFindings:
        """Findings of the topmost layer."""
        picture, frame = self.picture()
        return see_layer(picture, frame, self.lines, thickness_mm=THICK)


def painted(
    pieces: Sequence[Piece],
    missing: Sequence[tuple[int, float, float]] = (),
    margin_mm: float = 1.5,
    seed: int = 1,
) -> Volume:
    """Paint pieces, all but ``missing`` (piece, from, to, mm along it)."""
    rng = np.random.default_rng(seed)
    at = np.array([piece[1:] for piece in pieces]).reshape(-1, 2)
    low, high = at.min(axis=0) - margin_mm, at.max(axis=0) + margin_mm
    top = (max(piece[0] for piece in pieces) + 1) * THICK + 0.3
    dz, dy, dx = VOXEL
    shape = tuple(int(length / step) for length, step in zip(
        (top + 0.2, high[1] - low[1], high[0] - low[0]), VOXEL, strict=True
    ))  # fmt: skip
    mean = np.full(shape, BATH)
    x, y = low[0] + dx * np.arange(shape[2]), low[1] + dy * np.arange(shape[1])
    z = top - dz * np.arange(shape[0])
    for number, (layer, x0, y0, x1, y1) in enumerate(pieces):
        along, across = (x, y) if y0 == y1 else (y, x)
        begin, end, middle = (x0, x1, y0) if y0 == y1 else (y0, y1, x0)
        own = (along >= begin) & (along <= end)
        for which, bare, bare_end in missing:
            own &= (which != number) | (along < begin + bare) | (along > begin + bare_end)
        beside = np.abs(across - middle) < WIDTH / 2
        flat = beside[:, None] & own if y0 == y1 else own[:, None] & beside
        mean[np.ix_((z > layer * THICK) & (z < (layer + 1) * THICK))] += np.where(flat, GEL, 0.0)
    voxels = np.minimum(rng.gamma(3.0, np.minimum(mean, GEL) / 3.0), 65_535).astype(np.uint16)
    to_scan = np.diag([1.0, 1.0, -1.0, 1.0])
    to_scan[:3, 3] = (-low[0], -low[1], top)
    return Volume(voxels, to_scan, pieces)


def area(layers: int, count: int, pitch: float = WIDTH) -> list[Piece]:
    """Parallel lines in layers, each across those below."""
    size = count * pitch
    middles = pitch * (np.arange(count) + 0.5)
    return [
        (k, 0.0, m, size, m) if k % 2 == 0 else (k, m, 0.0, m, size)
        for k in range(layers)
        for m in middles.tolist()
    ]
