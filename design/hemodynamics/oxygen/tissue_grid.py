"""Make the oxygen solver's regular grid of tissue cells from a box or a tissue."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.errors import FlowError
from design.tissue import Tissue
from kernels.arrays import FloatArray

CELLS_AT_MOST: Final = 40_000_000
"""About 200 bytes each: 8 GB."""

_SLAB = 2_000_000


class TissueGrid(NamedTuple):
    """Cubic cells, one layer of empty ones all round, so that kernels need no test for the edge.

    Attributes
    ----------
    origin_mm : (3,) float64, mm
        Centre of cell (0, 0, 0), in the empty layer.
    spacing_mm : float, mm
    inside : (nx, ny, nz) bool
        Cells whose centre is in the tissue, lumens included; False all over the outer layer.
    depth_mm : (nx, ny, nz) float32, mm
        Of the centre below the tissue's surface.
    """

    origin_mm: FloatArray
    spacing_mm: float
    inside: NDArray[np.bool_]
    depth_mm: NDArray[np.float32]

    @property
    def cell_ul(self) -> float:
        """Volume of a cell, µL."""
        return self.spacing_mm**3


def spacing_for(bounds: FloatArray, cells: int) -> float:
    """Spacing that cuts the box ``bounds`` (2, 3) into about so many cells, mm, two digits."""
    exact = float(np.prod(bounds[1] - bounds[0]) / cells) ** (1.0 / 3.0)
    digits = 10.0 ** (np.floor(np.log10(exact)) - 1.0)
    return float(f"{np.ceil(exact / digits) * digits:.6g}")


def grid_of_box(bounds: FloatArray, spacing_mm: float) -> TissueGrid:
    """All of a box is tissue; ``bounds`` (2, 3), mm, are met to half a cell."""
    origin, shape = _frame(bounds, spacing_mm)
    centre = [origin[k] + spacing_mm * np.arange(shape[k]) for k in range(3)]
    near = [np.minimum(c - bounds[0][k], bounds[1][k] - c) for k, c in enumerate(centre)]
    depth = np.minimum(np.minimum(near[0][:, None, None], near[1][:, None]), near[2])
    return _grid(origin, spacing_mm, depth.astype(np.float32))


def grid_of_tissue(tissue: Tissue, spacing_mm: float, scale: float = 1.0) -> TissueGrid:
    """Cells of a tissue by its signed distance, in the size of a print ``scale`` times its own.

    Raises
    ------
    FlowError
        When there are too many cells, or none.
    """
    origin, shape = _frame(tissue.bounds * scale, spacing_mm)
    y, z = (origin[k] + spacing_mm * np.arange(shape[k]) for k in (1, 2))
    depth = np.empty(shape, dtype=np.float32)
    layers = max(1, _SLAB // (shape[1] * shape[2]))
    for first in range(0, shape[0], layers):
        x = origin[0] + spacing_mm * np.arange(first, min(first + layers, shape[0]))
        points = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)
        inward = -scale * tissue.grid.distance(points / scale)
        depth[first : first + layers] = inward.reshape(len(x), *shape[1:])
    return _grid(origin, spacing_mm, depth)


def _frame(bounds: FloatArray, spacing: float) -> tuple[FloatArray, tuple[int, int, int]]:
    if not (np.isfinite(spacing) and spacing > 0.0):
        raise FlowError(f"the grid's spacing is {spacing:g} mm; give a length above 0")
    size = np.asarray(bounds[1] - bounds[0], dtype=np.float64)
    count = np.maximum(np.round(size / spacing), 1.0)
    if np.prod(count + 2) > CELLS_AT_MOST:
        raise FlowError(
            f"a grid of {spacing * 1e3:g} µm has {np.prod(count):.3g} cells, above "
            f"{CELLS_AT_MOST:,}; raise the spacing to {spacing_for(bounds, 2_000_000) * 1e3:g} µm"
        )
    # What doesn't divide is shared by both sides.
    origin = np.asarray(bounds[0] + (size - (count + 1.0) * spacing) / 2.0)
    shape = count.astype(np.int64) + 2
    return origin, (int(shape[0]), int(shape[1]), int(shape[2]))


def _grid(origin: FloatArray, spacing: float, depth: NDArray[np.float32]) -> TissueGrid:
    inside = np.zeros(depth.shape, dtype=np.bool_)
    inner = (slice(1, -1),) * 3
    inside[inner] = depth[inner] > 0.0
    if not inside.any():
        raise FlowError(
            f"no cell of {spacing * 1e3:g} µm has its middle in the tissue; lower the spacing"
        )
    return TissueGrid(origin, spacing, inside, depth)
