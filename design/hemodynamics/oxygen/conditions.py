"""Inputs of an oxygen problem: inlet, bath, cells, uptake, diffusion; each default's literature.

Concentrations are in mM, which is nmol/µL; so flow times concentration is nmol/s, and nothing is
converted on the way.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final

import numpy as np

from design.errors import FlowError

AIR_MMHG: Final = 149.0
"""Partial pressure of oxygen in air saturated with water at 37 °C: 0.2095 (760 - 47)."""

AIR_MILLIMOLAR: Final = 0.2
"""Of culture medium in equilibrium with that air (Henry's law)."""

NMOL_PER_MOL: Final = 1e9
UL_PER_ML: Final = 1e3

_MAY_BE_ZERO: Final = ("inlet_millimolar", "threshold_millimolar", "bath_millimolar")


@dataclass(frozen=True)
class OxygenConditions:
    """Oxygen, or another solute by other numbers; the defaults are literature's, not a lab's.

    Attributes
    ----------
    inlet_millimolar : float, mM
        In what enters the vessels.
    cells_per_ml : float
        In the tissue, everywhere the same.
    mol_per_cell_s : float, mol/s
        Greatest uptake of a cell.
    half_millimolar : float, mM
        Concentration at which uptake is half of that (Michaelis' constant).
    tissue_diffusivity_mm2_s, medium_diffusivity_mm2_s : float, mm²/s
    sherwood : float
        Of the way from the stream to the wall, J/ℓ = π D Sh (c - c_wall). 48/11 is that of a
        parabolic profile and a constant flux through the wall, fully developed.
    threshold_millimolar : float, mM
        Tissue below it counts as hypoxic.
    bath_millimolar : float or None, mM
        Kept so at the tissue's surface; None lets nothing through it.
    """

    inlet_millimolar: float = AIR_MILLIMOLAR
    cells_per_ml: float = 1e7
    mol_per_cell_s: float = 5e-17
    half_millimolar: float = 1e-3
    tissue_diffusivity_mm2_s: float = 2e-3
    medium_diffusivity_mm2_s: float = 3e-3
    sherwood: float = 48.0 / 11.0
    threshold_millimolar: float = 0.01
    bath_millimolar: float | None = None

    def __post_init__(self) -> None:
        for field in fields(self):
            _check(field.name, getattr(self, field.name))

    @property
    def uptake_millimolar_s(self) -> float:
        """Greatest uptake of tissue, mM/s."""
        return self.cells_per_ml / UL_PER_ML * self.mol_per_cell_s * NMOL_PER_MOL


def _check(name: str, value: float | None) -> None:
    if name == "bath_millimolar" and value is None:
        return
    least = 0.0 if name in _MAY_BE_ZERO else 1e-300
    if value is None or not (np.isfinite(value) and value >= least):
        raise FlowError(f"oxygen: {name} is {value}; give a number above 0")


CONSTANTS: Final = {
    "inlet_millimolar": (
        "in the medium",
        "mM",
        "in equilibrium with humid air at 37 °C (149 mmHg)",
    ),
    "cells_per_ml": ("cell density", "1/mL", "assumed, within what gels are seeded with: count"),
    "mol_per_cell_s": (
        "greatest uptake of a cell",
        "mol/s",
        "assumed: cultured cells range from 1e-18 to 3.5e-16 (Wagner et al. 2011, "
        "doi 10.1016/j.freeradbiomed.2011.05.024); measure",
    ),
    "half_millimolar": (
        "half uptake at (Michaelis' constant)",
        "mM",
        "Buchwald 2009, doi 10.1186/1742-4682-6-5, islets",
    ),
    "tissue_diffusivity_mm2_s": (
        "diffusivity in tissue",
        "mm²/s",
        "Buchwald 2009, tissue at 37 °C; dilute gels up to 2.7e-3",
    ),
    "medium_diffusivity_mm2_s": (
        "diffusivity in medium",
        "mm²/s",
        "Buchwald 2009, medium at 37 °C",
    ),
    "sherwood": (
        "Sherwood number",
        "",
        "48/11: parabolic profile, constant flux, developed; more near a vessel's begin",
    ),
    "threshold_millimolar": (
        "hypoxic below",
        "mM",
        "a convention (0.01 mM is 7 mmHg), not a limit of life",
    ),
    "bath_millimolar": ("at the tissue's surface", "mM", "nothing passes the surface"),
}
"""What each constant is, its unit, and where its default comes from."""


def assumptions(conditions: OxygenConditions) -> list[dict[str, object]]:
    """A row a constant: ``name``, ``what``, ``value``, ``unit``, ``source``.

    None of them was measured on the tissue, and ``measured`` says so.
    """
    default = OxygenConditions()
    rows: list[dict[str, object]] = []
    for name, (what, unit, source) in CONSTANTS.items():
        value = getattr(conditions, name)
        rows.append(
            {
                "name": name,
                "what": what,
                "value": value,
                "unit": unit,
                "measured": False,
                "source": source if value == getattr(default, name) else "given by the user",
            }
        )
    return rows
