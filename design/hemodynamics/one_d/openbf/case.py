"""Data class of an openBF case: network, conditions, solver options, results to write."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from design.hemodynamics.one_d.options import OneDOptions
from design.hemodynamics.zero_d.pulsatile.conditions import PulsatileConditions
from design.network import VesselNetwork

QUANTITIES: Final = ("P", "Q", "A", "u")
"""Pressure, flow, cross-section and mean velocity, as ``write_results`` names them."""

PLACES: Final = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Of a vessel's length, where openBF keeps waves (there: the middles of these cells)."""


@dataclass(frozen=True)
class OpenBFCase:
    """What an openBF file asks for, in our units.

    Attributes
    ----------
    project : str
    labels : (v,) tuple of str
        Names of the vessels.
    network : VesselNetwork
        Lengths and radii as the file has them. It gives no places: every vessel goes out from one
        point and back.
    conditions : PulsatileConditions
    options : OneDOptions
    quantities : tuple of str
        Of `QUANTITIES`, to be written.
    shown : tuple of int
        Vessels to be written.
    folder : str or None
        ``output_directory``.
    tolerance_mmhg : float
        ``convergence_tolerance``.
    notes : tuple of str
        What the user should know of how the file was read.
    """

    project: str
    labels: tuple[str, ...]
    network: VesselNetwork
    conditions: PulsatileConditions
    options: OneDOptions
    quantities: tuple[str, ...]
    shown: tuple[int, ...]
    folder: str | None
    tolerance_mmhg: float
    notes: tuple[str, ...] = ()
