"""Estimate oxygen at tissue points from the nearest lumen, by Krogh's tissue cylinder."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from design.errors import DesignError
from kernels.arrays import FloatArray


@dataclass(frozen=True)
class OxygenModel:
    """What the cells breathe. The defaults are estimates, to be replaced by a lab's own.

    Attributes
    ----------
    lumen_millimolar : float, mol/m³
        Oxygen at every lumen wall; medium in equilibrium with air at 37 °C holds about 0.2.
    cells_per_ml : float
        10⁸ is within the range of organs, and ten times that of most cell-laden gels.
    mol_per_cell_s : float, mol/s
        Taken up by a cell.
    diffusivity_mm2_s : float, mm²/s
        Of oxygen in the tissue; some 3e-3 in water at 37 °C.
    """

    lumen_millimolar: float = 0.2
    cells_per_ml: float = 1e8
    mol_per_cell_s: float = 5e-17
    diffusivity_mm2_s: float = 2e-3

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (np.isfinite(value) and value > 0.0):
                raise DesignError(f"oxygen: {field.name} is {value:g}; give a value above 0")

    @property
    def uptake_millimolar_s(self) -> float:
        """Oxygen taken up per volume of tissue, mM/s."""
        # mol/(mL s) is 10⁶ mM/s.
        return self.cells_per_ml * self.mol_per_cell_s * 1e6


@dataclass(frozen=True)
class Oxygen:
    """Oxygen at the tissue's sampled points.

    Attributes
    ----------
    model : OxygenModel
    cylinder_mm : float, mm
        Radius of a tissue cylinder around a thin lumen, √(V / π L).
    mean_millimolar, p5_millimolar, least_millimolar : float, mM
        Anoxic points count as 0.
    anoxic : float
        Share of the tissue that the model leaves without oxygen.
    """

    model: OxygenModel
    cylinder_mm: float
    mean_millimolar: float
    p5_millimolar: float
    least_millimolar: float
    anoxic: float


def krogh_erlang(
    radius: FloatArray, lumen: FloatArray, cylinder: FloatArray, model: OxygenModel
) -> FloatArray:
    """Oxygen at ``radius`` (n,) from the axis of a lumen in its tissue cylinder, mM.

    c(r) = c₀ - M / (4 D) · (2 R² ln(r / a) - r² + a²): steady, uptake M whatever the
    concentration, c₀ at the wall r = a, no flux through r = R (Krogh 1919, J Physiol 52, 409,
    doi 10.1113/jphysiol.1919.sp001839, with Erlang's formula). Holds for a ≤ r ≤ R; negative
    where the oxygen doesn't reach.

    Parameters
    ----------
    radius, lumen, cylinder : (n,) float64, mm
        r, a and R.
    model : OxygenModel
    """
    scale = model.uptake_millimolar_s / (4.0 * model.diffusivity_mm2_s)
    falls = 2.0 * cylinder**2 * np.log(radius / lumen) - radius**2 + lumen**2
    oxygen: FloatArray = model.lumen_millimolar - scale * falls
    return oxygen


def krogh_oxygen(
    distance: FloatArray, lumen: FloatArray, area_mm2: float, model: OxygenModel
) -> Oxygen:
    """Estimate the oxygen of tissue points from their nearest lumen alone.

    Every lumen feeds a cylinder of the same cross-section of tissue, ``area_mm2``: the tissue's
    volume over the lumens' length. A point beyond its cylinder is taken to lie on the rim of one
    that reaches it. Not modelled: oxygen used up along the vessels, help from the lumens beyond
    the nearest, uptake that falls with the concentration.

    Parameters
    ----------
    distance : (n,) float64, mm
        Of the points from the nearest wall, at least 0.
    lumen : (n,) float64, mm
        Radius of that lumen.
    area_mm2 : float, mm²
    model : OxygenModel
    """
    radius = lumen + distance
    cylinder = np.maximum(np.sqrt(lumen**2 + area_mm2 / np.pi), radius)
    oxygen = krogh_erlang(radius, lumen, cylinder, model)
    kept = np.maximum(oxygen, 0.0)
    return Oxygen(
        model=model,
        cylinder_mm=float(np.sqrt(area_mm2 / np.pi)),
        mean_millimolar=float(kept.mean()),
        p5_millimolar=float(np.percentile(kept, 5.0)),
        least_millimolar=float(kept.min()),
        anoxic=float((oxygen <= 0.0).mean()),
    )
