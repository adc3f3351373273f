"""Steady oxygen solution: data class, summary, and VTK image data (`.vti`) for ParaView."""

from __future__ import annotations

import base64
import struct
import zlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from design.files import write_text
from design.hemodynamics.oxygen.conditions import (
    AIR_MILLIMOLAR,
    AIR_MMHG,
    NMOL_PER_MOL,
    OxygenConditions,
    assumptions,
)
from design.hemodynamics.oxygen.tissue_grid import TissueGrid
from design.network import VesselNetwork
from kernels.arrays import FloatArray

HALF: Final = 0.5
"""Share of tissue from which a cell counts as tissue and not as lumen, where it must be one."""


@dataclass(frozen=True)
class OxygenSolution:
    """Steady oxygen in vessels and tissue.

    Attributes
    ----------
    conditions : OxygenConditions
    grid : TissueGrid
    concentration : (nx, ny, nz) float64, mM
        In the cells; 0 outside the tissue. Within about a cell of a thin vessel it is the mean
        over the grid's smoothing, below what stands at the wall.
    tissue_share : (nx, ny, nz) float64
        Of each cell: 0 outside and in lumens, 1 in tissue.
    entry, exit : (v,) float64, mM
        Mixed in the stream at both ends of each vessel, in the flow's direction; NaN where
        nothing flows.
    wall_flux : (v,) float64, nmol/s
        From each vessel into the tissue.
    supplied, drained, from_bath, consumed : float, nmol/s
        Into the vessels and out of them, through the tissue's surface, and taken up.
    flow_ul_s : float, µL/s
        Into the vessels.
    newton, cycles : int
        Steps on the finest grid, and cycles of multigrid in them.
    """

    conditions: OxygenConditions
    grid: TissueGrid
    concentration: FloatArray
    tissue_share: FloatArray
    entry: FloatArray
    exit: FloatArray
    wall_flux: FloatArray
    supplied: float
    drained: float
    from_bath: float
    consumed: float
    flow_ul_s: float
    newton: int
    cycles: int

    @property
    def imbalance(self) -> float:
        """What goes in less what goes out and is taken up, over what is taken up or supplied."""
        net = self.supplied + self.from_bath - self.drained - self.consumed
        return abs(net) / max(self.consumed, 1e-12 * self.supplied, 1e-300)

    def share_below(self, millimolar: float) -> float:
        """Share of the tissue, by volume, that holds less."""
        low = self.concentration < millimolar
        return float(self.tissue_share[low].sum() / self.tissue_share.sum())

    def least(self) -> float:
        """Of the cells that are tissue by half or more, mM."""
        return max(float(self.concentration[self.tissue_share >= HALF].min()), 0.0)

    @cached_property
    def worst(self) -> tuple[int, int, int]:
        """Cell in the middle of the widest hypoxic place; without any, the one with least.

        Where much is without oxygen, which cell holds least is a matter of rounding.
        """
        tissue = self.tissue_share >= HALF
        hypoxic = tissue & (self.concentration < self.conditions.threshold_millimolar)
        if hypoxic.any():
            best = int(np.argmax(distance_transform_edt(hypoxic)))
        else:
            best = int(np.argmin(np.where(tissue, self.concentration, np.inf)))
        i, j, k = np.unravel_index(best, tissue.shape)
        return int(i), int(j), int(k)


BINS: Final = 40
MMHG_PER_MILLIMOLAR: Final = AIR_MMHG / AIR_MILLIMOLAR
"""Henry's law: medium at 37 °C holds 0.2 mM under 149 mmHg."""


def oxygen_summary(fine: OxygenSolution, coarse: OxygenSolution | None = None) -> dict[str, Any]:
    """Shares, extremes and balance for `report.json`; keys name their units.

    ``extraction_percent`` is what the vessels leave behind of what they bring.
    ``demand_met_percent`` holds what is taken up against what the cells would take with oxygen in
    plenty. ``cells_fed_at_most`` is the plain balance: what is brought over a cell's uptake.
    ``imbalance`` is in less out less taken up, over what is taken up. ``…_coarser`` is the same on
    a grid of twice the spacing: how much the grid matters, not a bound. ``worst_place`` is the
    middle of the widest hypoxic place, or where there is none the place with least.
    """
    conditions, grid = fine.conditions, fine.grid
    share, field = fine.tissue_share, fine.concentration
    volume = float(share.sum()) * grid.cell_ul
    per_cell = conditions.mol_per_cell_s * NMOL_PER_MOL
    at = grid.origin_mm + grid.spacing_mm * np.array(fine.worst)
    least = fine.least()
    level = conditions.threshold_millimolar
    brought = fine.supplied + max(fine.from_bath, 0.0)
    p5 = _percentile(fine, 5.0)
    summary: dict[str, Any] = {
        "hypoxic_percent": 100.0 * fine.share_below(level),
        "threshold_millimolar": level,
        "least_millimolar": least,
        "least_mmhg": least * MMHG_PER_MILLIMOLAR,
        "worst_place_mm": np.round(at, 4).tolist(),
        "mean_millimolar": float((share * field).sum() / share.sum()),
        "p5_millimolar": p5,
        "inlet_millimolar": conditions.inlet_millimolar,
        "outlet_millimolar": fine.drained / fine.flow_ul_s,
        "supplied_nmol_s": fine.supplied,
        "drained_nmol_s": fine.drained,
        "from_bath_nmol_s": fine.from_bath,
        "consumed_nmol_s": fine.consumed,
        "imbalance": fine.imbalance,
        "extraction_percent": 100.0 * (fine.supplied - fine.drained) / fine.supplied
        if fine.supplied > 0.0
        else 0.0,
        "demand_met_percent": 100.0 * fine.consumed / (volume * conditions.uptake_millimolar_s),
        "cells": conditions.cells_per_ml * volume * 1e-3,
        "cells_fed_at_most": brought / per_cell,
        "tissue_mm3": volume,
        "spacing_um": grid.spacing_mm * 1e3,
        "grid_cells": int(grid.inside.sum()),
    }
    if coarse is not None:
        summary["hypoxic_coarser_percent"] = 100.0 * coarse.share_below(level)
    return summary | {"histogram": histogram(fine), "assumptions": assumptions(conditions)}


def _percentile(solution: OxygenSolution, percent: float) -> float:
    """By volume."""
    is_tissue = solution.tissue_share > 0.0
    value, weight = solution.concentration[is_tissue], solution.tissue_share[is_tissue]
    order = np.argsort(value)
    below = np.cumsum(weight[order])
    return float(value[order][np.searchsorted(below, percent / 100.0 * below[-1])])


def histogram(solution: OxygenSolution) -> dict[str, list[float]]:
    """``edges_millimolar`` (n + 1) from 0 to the most there is, ``share`` of the tissue (n)."""
    top = max(solution.conditions.inlet_millimolar, solution.conditions.bath_millimolar or 0.0)
    top = max(top, 1e-9)
    share, edges = np.histogram(
        np.clip(solution.concentration, 0.0, top),
        bins=BINS,
        range=(0.0, top),
        weights=solution.tissue_share,
    )
    return {"edges_millimolar": edges.tolist(), "share": (share / share.sum()).tolist()}


def oxygen_table(
    network: VesselNetwork, solution: OxygenSolution
) -> dict[str, NDArray[np.generic]]:
    """Columns of a per-vessel table, each (v,); in and out are in the flow's direction.

    ``wall_flux_nmol_s`` is given to the tissue; below 0 where a vessel takes oxygen up.
    """
    return {
        "vessel": np.arange(network.vessel_count),
        "kind": network.kind_names(),
        "length_mm": network.lengths(),
        "diameter_mm": 2.0 * network.mean_radius(),
        "oxygen_in_millimolar": solution.entry,
        "oxygen_out_millimolar": solution.exit,
        "oxygen_in_mmhg": solution.entry * MMHG_PER_MILLIMOLAR,
        "oxygen_out_mmhg": solution.exit * MMHG_PER_MILLIMOLAR,
        "wall_flux_nmol_s": solution.wall_flux,
    }


_BLOCK: Final = 1 << 20


def write_oxygen_vti(path: Path, solution: OxygenSolution) -> None:
    """Write ``oxygen_millimolar`` and ``tissue_share``, float32, a point at each cell's middle.

    Raises
    ------
    OSError
        When the file can't be written.
    """
    inner = (slice(1, -1),) * 3
    fields = {
        "oxygen_millimolar": solution.concentration[inner],
        "tissue_share": solution.tissue_share[inner],
    }
    grid = solution.grid
    shape = fields["tissue_share"].shape
    extent = " ".join(f"0 {n - 1}" for n in shape)
    origin = " ".join(repr(float(x)) for x in grid.origin_mm + grid.spacing_mm)
    spacing = " ".join([repr(float(grid.spacing_mm))] * 3)
    arrays = "".join(_array(name, values) for name, values in fields.items())
    write_text(
        path,
        '<?xml version="1.0"?>\n'
        '<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt32" '
        'compressor="vtkZLibDataCompressor">\n'
        f'<ImageData WholeExtent="{extent}" Origin="{origin}" Spacing="{spacing}">\n'
        f'<Piece Extent="{extent}">\n<PointData Scalars="oxygen_millimolar">\n'
        f"{arrays}</PointData>\n</Piece>\n</ImageData>\n</VTKFile>\n",
    )


def _array(name: str, values: NDArray[np.float64]) -> str:
    # VTK counts x fastest.
    data = np.ascontiguousarray(values.transpose(2, 1, 0), dtype="<f4").tobytes()
    blocks = [zlib.compress(data[k : k + _BLOCK], 6) for k in range(0, len(data), _BLOCK)]
    last = len(data) % _BLOCK
    head = struct.pack(f"<{3 + len(blocks)}I", len(blocks), _BLOCK, last, *map(len, blocks))
    coded = base64.b64encode(head) + base64.b64encode(b"".join(blocks))
    return (
        f'<DataArray type="Float32" Name={quoteattr(name)} format="binary">'
        f"{coded.decode('ascii')}</DataArray>\n"
    )
