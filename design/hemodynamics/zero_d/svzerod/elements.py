"""Table of svZeroDSolver's block kinds; equations of vessels, outlets and junctions.

An element's variables are pressure and flow of each connection, inlets first, then its own. Its
equations are rows of E ẏ + F y + c = 0. As in the project's documentation:

* BloodVessel: R, then C to ground, then L; BloodVesselCRL: C, then R and L.
* RCR: Rp, then C to ground and Rd to Pd, with the pressure at C as variable.
* CORONARY (Kim et al. 2010, doi 10.1007/s10439-010-0083-6): Ra1, Ca to ground, Ra2, Cc to the
  intramyocardial pressure, Rv1 to P_v, with the change of Cc's volume as variable.
* Junctions: equal pressures; a resistance in each connection; R and L in each outlet.

Chambers and valves stand in `chambers`, heart and closed-loop outlets in `closed_loop`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Final, Literal

import numpy as np

from design.errors import FlowError
from design.hemodynamics.zero_d.svzerod import chambers, closed_loop
from design.hemodynamics.zero_d.svzerod.stamps import Group, Stamps
from design.hemodynamics.zero_d.svzerod.terms import AFFINE, Moments
from kernels.arrays import FloatArray

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
    written : bool
        Whether a table of vessels has its flow and pressure at both ends, as svZeroDSolver's has.
    """

    needed: tuple[str, ...]
    stamp: Callable[[Group, Stamps], None]
    ports: Ports
    optional: Mapping[str, float] = field(default_factory=dict)
    own: tuple[str, ...] = ()
    table: str = ""
    written: bool = False

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
    to.losses(0, 1, stenosis)
    to.stored_losses(1, 1, stenosis * compliance)


def _vessel_crl(group: Group, to: Stamps) -> None:
    resistance, compliance, inertance, stenosis = group.values.T
    to.f(0, {0: 1.0, 3: -resistance, 2: -1.0})
    to.e(0, {3: -inertance})
    to.f(1, {1: 1.0, 3: -1.0})
    to.e(1, {0: -compliance})
    to.losses(0, 3, stenosis)


def _vessel_rc(group: Group, to: Stamps) -> None:
    """Add C dP/dt + (P - P_out)/R = Q, by which C takes in pressure and no volume."""
    resistance, compliance = group.values.T
    to.e(0, {0: compliance})
    to.f(0, {0: 1.0 / resistance, 1: -1.0, 2: -1.0 / resistance})
    to.f(1, {1: 1.0, 3: -1.0})


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
    tables, behind = group.tables, distal - offset

    def timed(at: Moments) -> tuple[FloatArray, ...]:
        resistance = _contracting(at, least, most, rise, fall)
        across = at.sampled[:, tables] - behind
        return -resistance, -resistance * muscle * vein, -muscle * across

    to.add(AFFINE, (1,), (2,), ((0, 0),), timed=timed)


def _contracting(
    at: Moments, least: FloatArray, most: FloatArray, rise: FloatArray, fall: FloatArray
) -> FloatArray:
    """Return a coronary's resistance in the contracting muscle, (s, m).

    √R goes from √least to √most along half a cosine in the time of contraction, and back in the
    time of relaxation.
    """
    time = np.fmod(at.times, at.period)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        up = 0.5 * (1.0 - np.cos(np.pi * time / rise))
        down = 0.5 * (1.0 + np.cos(np.pi * (time - rise) / fall))
    share = np.where(time <= rise, up, np.where(time <= rise + fall, down, 0.0))
    root = np.sqrt(least) + (np.sqrt(most) - np.sqrt(least)) * share
    return np.asarray(root**2)


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
        to.losses(k + 1, flow, stenosis)
    _conserve(group, to, 0)


def _conserve(group: Group, to: Stamps, row: int) -> None:
    signs = {2 * k + 1: 1.0 if k < group.inlets else -1.0 for k in range(group.ports)}
    to.f(row, signs)


_VESSEL: Final = {"C": 0.0, "L": 0.0, "stenosis_coefficient": 0.0}
_CORONARY: Final = ("Ra1", "Rv1", "Ca", "Cc", "P_v")
_LOOP_CORONARY: Final = ("Ra", "Ram", "Rv", "Ca", "Cim")
_SIGNED: Final = ("P", "V", "K", "alpha", "tdias", "tsys")
"""Begins of numbers that may be below 0: pressures, volumes, rates of activation, moments."""
_POSITIVE: Final = frozenset(("Rpd", "rho", "thick0", "radius0", "steepness", "tpwave", "Tsa"))
"""Numbers that something is divided by."""

_SPHERE: Final = Element(
    ("rho", "thick0", "radius0", "W1", "W2", "eta", "sigma_max", "alpha_max", "alpha_min", "tsys",
     "tdias", "steepness"),
    chambers.sphere, "two", own=("radius", "velo", "stress", "tau", "volume"), written=True,
)  # fmt: skip

VESSELS: Final = {
    "BloodVessel": Element(("R_poiseuille",), _vessel, "two", _VESSEL, written=True),
    "BloodVesselCRL": Element(("R_poiseuille",), _vessel_crl, "two", _VESSEL, written=True),
    "BloodVesselRC": Element(("Rpd", "Cp"), _vessel_rc, "two"),
    "ChamberSphere": _SPHERE,
}
COUPLINGS: Final = {
    "FLOW": Element((), _flow, "one", table="Q"),
    "PRESSURE": Element((), _pressure, "one", table="P"),
}
CONDITIONS: Final = COUPLINGS | {
    "RESISTANCE": Element(("R", "Pd"), _resistance, "one"),
    "RCR": Element(("Rp", "C", "Rd"), _windkessel, "one", {"Pd": 0.0}, ("pressure_c",)),
    "CORONARY": Element(
        (*_CORONARY, "Ra2"), _coronary, "one", own=("volume_im",), table="Pim"
    ),
    "CORONARY_VAR_RES": Element(
        (*_CORONARY, "Ra2_min", "Ra2_max", "T_vc", "T_vr"), _coronary_varying, "one",
        own=("volume_im",), table="Pim",
    ),
    "ClosedLoopRCR": Element(
        ("Rp", "C", "Rd"), closed_loop.closed_windkessel, "two", own=("P_c",)
    ),
    "ClosedLoopCoronaryLeft": Element(
        _LOOP_CORONARY, partial(closed_loop.closed_coronary, "P_LV"), "two", own=("volume_im",)
    ),
    "ClosedLoopCoronaryRight": Element(
        _LOOP_CORONARY, partial(closed_loop.closed_coronary, "P_RV"), "two", own=("volume_im",)
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
HEARTS: Final = {
    "ClosedLoopHeartAndPulmonary": Element(
        closed_loop.PARAMETERS, closed_loop.heart, "two", own=closed_loop.OWN
    ),
}
VALVES: Final = {
    "ValveTanh": Element(
        ("Rmax", "Rmin", "Steepness"), chambers.tanh_valve, "two", own=("valve_status",)
    ),
    "PiecewiseValve": Element(("Rmax", "Rmin"), chambers.jump_valve, "two", written=True),
}
CHAMBERS: Final = {
    "LinearElastanceChamber": Element(
        ("Emax", "Epass", "Vrest"), chambers.linear_chamber, "two", own=("Vc",), written=True
    ),
    "ChamberElastanceInductor": Element(
        ("Emax", "Emin", "Vrd", "Vrs", "Impedance"), chambers.inductor_chamber, "two", own=("Vc",)
    ),
    "ChamberElastanceInductorExponential": Element(
        ("Emax", "Impedance", "Kxp", "Kxv", "Vaso"), chambers.exponential_chamber, "two",
        own=("Vc",),
    ),
    "ChamberSphere": _SPHERE,
}  # fmt: skip
ELEMENTS: Final = VESSELS | CONDITIONS | JUNCTIONS | HEARTS | VALVES | CHAMBERS


def check_sign(least: float, key: str, place: str) -> None:
    """Check that a resistance, compliance, inertance or the like isn't below 0.

    Raises
    ------
    FlowError
        When it is, or is 0 where something is divided by it.
    """
    if least > 0.0 or key.startswith(_SIGNED) or (least == 0.0 and key not in _POSITIVE):
        return
    limit = "must be above 0" if key in _POSITIVE else "may not be below 0"
    raise FlowError(f"{place}: {key} is {least:g}; it {limit}")
