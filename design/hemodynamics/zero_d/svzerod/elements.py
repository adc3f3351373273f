"""Elements of svZeroDSolver's input: their parameters, variables and equations.

An element's variables are pressure and flow of each connection, inlets first, then its own. Its
equations are rows of E ẏ + F y + c = 0. As in the project's documentation:

* BloodVessel: R, then C to ground, then L; BloodVesselCRL: C, then R and L.
* RCR: Rp, then C to ground and Rd to Pd, with the pressure at C as variable.
* CORONARY (Kim et al. 2010, doi 10.1007/s10439-010-0083-6): Ra1, Ca to ground, Ra2, Cc to the
  intramyocardial pressure, Rv1 to P_v, with the change of Cc's volume as variable.
* Junctions: equal pressures; a resistance in each connection; R and L in each outlet.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final, Literal

import numpy as np

from design.hemodynamics.zero_d.svzerod.stamps import Group, Stamps
from design.network import FloatArray

Ports = Literal["one", "two", "many"]


@dataclass(frozen=True)
class Element:
    """Kind of block.

    Attributes
    ----------
    needed : tuple of str
        Parameters that must be given.
    optional : mapping of str to float
        Parameters that may be, with their defaults.
    stamp : function
        Adds the equations of a group of blocks of this kind.
    ports : {"one", "two", "many"}
        Connections it takes.
    own : tuple of str
        Names of its own variables.
    table : str
        Parameter that is a table over the times ``t``; empty for none.
    """

    needed: tuple[str, ...]
    stamp: Callable[[Group, Stamps], None]
    ports: Ports
    optional: Mapping[str, float] = field(default_factory=dict)
    own: tuple[str, ...] = ()
    table: str = ""

    @cached_property
    def known(self) -> frozenset[str]:
        """Keys that its values may have."""
        table = (self.table, "t") if self.table else ()
        return frozenset((*self.needed, *self.optional, *table))


def _vessel(group: Group, to: Stamps) -> None:
    resistance, compliance, inertance, stenosis = group.values.T
    to.f(0, {0: 1.0, 1: -resistance, 2: -1.0})
    to.e(0, {3: -inertance})
    to.f(1, {1: 1.0, 3: -1.0})
    to.e(1, {0: -compliance, 1: compliance * resistance})
    narrow = stenosis != 0.0
    to.losses(0, 1, stenosis, narrow)
    to.stored_losses(1, 1, stenosis * compliance, narrow)


def _vessel_crl(group: Group, to: Stamps) -> None:
    resistance, compliance, inertance, stenosis = group.values.T
    to.f(0, {0: 1.0, 3: -resistance, 2: -1.0})
    to.e(0, {3: -inertance})
    to.f(1, {1: 1.0, 3: -1.0})
    to.e(1, {0: -compliance})
    to.losses(0, 3, stenosis, stenosis != 0.0)


def _flow(_: Group, to: Stamps) -> None:
    to.f(0, {1: 1.0})
    to.drive(0, -1.0)


def _pressure(_: Group, to: Stamps) -> None:
    to.f(0, {0: 1.0})
    to.drive(0, -1.0)


def _resistance(group: Group, to: Stamps) -> None:
    resistance, distal = group.values.T
    to.f(0, {0: 1.0, 1: -resistance})
    to.c(0, -distal)


def _windkessel(group: Group, to: Stamps) -> None:
    proximal, compliance, resistance, distal = group.values.T
    to.f(0, {0: 1.0, 1: -proximal, 2: -1.0})
    to.f(1, {1: resistance, 2: -1.0})
    to.c(1, distal)
    # The steady start leaves its capacitance out, and no vessel's.
    to.e(1, {2: 0.0 if to.steady else -resistance * compliance})


def _coronary(group: Group, to: Stamps) -> None:
    first, vein, _, muscle, distal, middle = group.values.T
    if to.steady:
        to.f(0, {2: 1.0})
        to.f(1, {0: -1.0, 1: first + middle + vein})
        to.c(1, distal)
        return
    _arterial(group, to)
    offset = _coronary_offset(group, to, middle)
    to.f(1, {2: -(vein + middle)})
    to.e(1, {2: -muscle * vein * middle})
    to.c(1, muscle * (middle * distal - (vein + middle) * offset))
    to.drive(1, -muscle * (vein + middle))


def _coronary_varying(group: Group, to: Stamps) -> None:
    first, vein, _, muscle, distal, least, most, rise, fall = group.values.T
    if to.steady:
        to.f(0, {2: 1.0})
        to.f(1, {0: -1.0, 1: first + least + vein})
        to.c(1, distal)
        return
    _arterial(group, to)
    offset = _coronary_offset(group, to, least)
    to.f(1, {2: -vein})
    to.c(1, -muscle * vein * offset)
    to.drive(1, -muscle * vein)
    to.contracting(1, 2, np.column_stack([muscle, vein, distal - offset, least, most, rise, fall]))


def _arterial(group: Group, to: Stamps) -> None:
    """Add what both coronary elements share in time: Ra1, Ca and the flow into Cc."""
    first, vein, arterial, muscle, distal = group.values.T[:5]
    scale = muscle * vein
    to.f(0, {1: scale, 2: -1.0})
    to.e(0, {0: -arterial * scale, 1: first * arterial * scale, 2: -scale})
    to.f(1, {0: scale, 1: -scale * first})
    middle = group.values[:, 5]
    to.c(0, muscle * (distal - _coronary_offset(group, to, middle)))
    to.drive(0, -muscle)


def _coronary_offset(group: Group, to: Stamps, middle: FloatArray) -> FloatArray:
    """Return pressure across Cc at the begin, from which its volume is counted."""
    first, arterial = group.values[:, 0], group.values[:, 2]
    value, rate = to.start
    behind = value[:, 0] - first * value[:, 1]
    through = value[:, 1] - arterial * (rate[:, 0] - first * rate[:, 1])
    return behind - middle * through - to.start_drive


def _junction(group: Group, to: Stamps) -> None:
    ports = group.ports
    for k in range(1, ports):
        to.f(k - 1, {0: 1.0, 2 * k: -1.0})
    _conserve(group, to, ports - 1)


def _resistive(group: Group, to: Stamps) -> None:
    centre = 2 * group.ports
    for k in range(group.ports):
        sign = 1.0 if k < group.inlets else -1.0
        to.f(k, {2 * k: sign, 2 * k + 1: -group.values[:, k], centre: -sign})
    _conserve(group, to, group.ports)


def _vessel_junction(group: Group, to: Stamps) -> None:
    outlets = group.ports - 1
    for k in range(outlets):
        resistance, inertance, stenosis = group.values[:, k::outlets].T
        flow = 3 + 2 * k
        to.f(k + 1, {0: 1.0, 2 + 2 * k: -1.0, flow: -resistance})
        to.e(k + 1, {flow: -inertance})
        to.losses(k + 1, flow, stenosis, stenosis != 0.0)
    _conserve(group, to, 0)


def _conserve(group: Group, to: Stamps, row: int) -> None:
    signs = {2 * k + 1: 1.0 if k < group.inlets else -1.0 for k in range(group.ports)}
    to.f(row, signs)


_VESSEL: Final = {"C": 0.0, "L": 0.0, "stenosis_coefficient": 0.0}
_CORONARY: Final = ("Ra1", "Rv1", "Ca", "Cc", "P_v")

VESSELS: Final = {
    "BloodVessel": Element(("R_poiseuille",), _vessel, "two", _VESSEL),
    "BloodVesselCRL": Element(("R_poiseuille",), _vessel_crl, "two", _VESSEL),
}
CONDITIONS: Final = {
    "FLOW": Element((), _flow, "one", table="Q"),
    "PRESSURE": Element((), _pressure, "one", table="P"),
    "RESISTANCE": Element(("R", "Pd"), _resistance, "one"),
    "RCR": Element(("Rp", "C", "Rd"), _windkessel, "one", {"Pd": 0.0}, ("pressure_c",)),
    "CORONARY": Element(
        (*_CORONARY, "Ra2"), _coronary, "one", own=("volume_im",), table="Pim"
    ),
    "CORONARY_VAR_RES": Element(
        (*_CORONARY, "Ra2_min", "Ra2_max", "T_vc", "T_vr"), _coronary_varying, "one",
        own=("volume_im",), table="Pim",
    ),
}  # fmt: skip
JUNCTIONS: Final = {
    "NORMAL_JUNCTION": Element((), _junction, "many"),
    "internal_junction": Element((), _junction, "many"),
    "resistive_junction": Element(("R",), _resistive, "many", own=("pressure_c",)),
    "BloodVesselJunction": Element(
        ("R_poiseuille", "L", "stenosis_coefficient"), _vessel_junction, "many"
    ),
}
ELEMENTS: Final = VESSELS | CONDITIONS | JUNCTIONS
