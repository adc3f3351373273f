"""Coefficients of pressure losses at bifurcations and stenoses, in steady flow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from design.errors import FlowInputError
from design.network import VesselNetwork
from kernels.arrays import FloatArray

EXPANSION: Final = 1.52
"""K_t of Young & Tsai 1973: the loss where a jet widens, over that of Borda and Carnot."""


@dataclass(frozen=True)
class Stenosis:
    """A short narrow place in a vessel.

    Young & Tsai 1973 (doi 10.1016/0021-9290(73)90099-7), with the length of Seeley & Young 1976
    (doi 10.1016/0021-9290(76)90086-5), L_a = 0.83 L_s + 1.64 D_s:

        Δp = 128 μ L_a Q/(π D_s⁴) + K_t ϱ (A₀/A_s - 1)² Q|Q|/(2 A₀²),  K_t = 1.52.

    The first takes the place of what Poiseuille's law gives for the same length unnarrowed. Found
    on rigid, blunt, axisymmetric plugs of 56 to 89 % of the area at Reynolds numbers of some 100 to
    5,000; steady flow only.

    Attributes
    ----------
    vessel : int
    diameter_share : float
        D_s/D₀, of the vessel's mean diameter; 0.1 to 1.
    length_mm : float
        L_s.
    """

    vessel: int
    diameter_share: float
    length_mm: float

    def __post_init__(self) -> None:
        if not 0.1 <= self.diameter_share <= 1.0:
            raise FlowInputError(
                f"the stenosis in vessel {self.vessel} leaves {self.diameter_share:g} of its "
                "diameter; give 0.1 to 1"
            )
        if not (np.isfinite(self.length_mm) and self.length_mm > 0.0):
            raise FlowInputError(
                f"the stenosis in vessel {self.vessel} is {self.length_mm:g} mm long; give a "
                "length above 0"
            )


@dataclass(frozen=True)
class Losses:
    """Inertial pressure losses to include.

    Attributes
    ----------
    junction : float
        K of Δp = K ϱ u²/2 at each vessel's begin, as the flow goes, where three vessels or more
        meet; u is the mean speed in the vessel. 0 for none. For smooth symmetric bifurcations of
        30° to 90° K is of the order of 0.5 to 1, sharper turns cost more (Idelchik, Handbook of
        Hydraulic Resistance, chapter 7). A constant K holds in inertial flow, at Reynolds numbers
        of some 100 and more; in creeping flow the loss is small beside viscosity's, whatever K.
        Pressure regained where flow slows down isn't counted, so that no loss is negative.
    stenoses : tuple of Stenosis
    """

    junction: float = 0.0
    stenoses: tuple[Stenosis, ...] = ()

    def __post_init__(self) -> None:
        if not 0.0 <= self.junction <= 100.0:
            raise FlowInputError(f"the junctions' K is {self.junction:g}; give 0 to 100")

    @property
    def any(self) -> bool:
        """Whether there are some."""
        return self.junction > 0.0 or bool(self.stenoses)

    def in_part(self, number: Mapping[int, int]) -> Losses:
        """The losses in a part of the network, whose vessels have the numbers of ``number``."""
        kept = (each for each in self.stenoses if each.vessel in number)
        return replace(
            self, stenoses=tuple(replace(each, vessel=number[each.vessel]) for each in kept)
        )


@dataclass(frozen=True)
class LossTerms:
    """What a network's losses are, all (v,).

    Attributes
    ----------
    viscous : float64, mm⁻³
        To be added to the resistance for viscosity 1.
    forth, back : float64, Pa·s²/µL²
        b of Δp = b Q|Q|, for flow along the vessel and against it.
    """

    viscous: FloatArray
    forth: FloatArray
    back: FloatArray


def loss_terms(
    network: VesselNetwork, radius: FloatArray, losses: Losses, density: float
) -> LossTerms:
    """Losses of a network whose mean radii (v,) are known; ``density`` in Pa·s²/mm².

    Raises
    ------
    FlowInputError
        For a stenosis in no vessel, or stenoses longer than their vessel.
    """
    _check(network, losses.stenoses)
    head = 0.5 * density / (np.pi * radius**2) ** 2
    meets = network.degree() >= 3
    first, last = network.vessel_nodes.T
    forth = losses.junction * np.where(meets[first], head, 0.0)
    back = losses.junction * np.where(meets[last], head, 0.0)
    viscous = np.zeros(network.vessel_count)
    for each in losses.stenoses:
        v, share = each.vessel, each.diameter_share
        whole, narrow = 2.0 * radius[v], 2.0 * radius[v] * share
        apparent = 0.83 * each.length_mm + 1.64 * narrow
        viscous[v] += 128.0 / np.pi * (apparent / narrow**4 - each.length_mm / whole**4)
        for b in (forth, back):
            b[v] += EXPANSION * (share**-2.0 - 1.0) ** 2 * head[v]
    return LossTerms(viscous, forth, back)


def _check(network: VesselNetwork, stenoses: tuple[Stenosis, ...]) -> None:
    whole = network.lengths()
    narrow: dict[int, float] = {}
    for each in stenoses:
        if not 0 <= each.vessel < network.vessel_count:
            raise FlowInputError(
                f"a stenosis is in vessel {each.vessel}, and the network has 0 to "
                f"{network.vessel_count - 1}"
            )
        narrow[each.vessel] = narrow.get(each.vessel, 0.0) + each.length_mm
    for vessel, length in narrow.items():
        if length > whole[vessel]:
            raise FlowInputError(
                f"the stenosis in vessel {vessel} is {length:g} mm long (several count together), "
                f"and the vessel {whole[vessel]:g} mm"
            )
