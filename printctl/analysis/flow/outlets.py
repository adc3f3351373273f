"""Outlet boundary conditions (pressure, resistance, Windkessel) from a recipe or a CSV file."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np

from design.hemodynamics import (
    OutletLoad,
    PressureOutlet,
    ResistanceOutlet,
    WindkesselOutlet,
)
from design.hemodynamics.waveforms import Constant
from design.network import VesselNetwork
from design.units import PA_PER_MMHG, UL_S_PER_ML_MIN
from printctl.errors import UsageError
from printctl.recipe.parts import PulseOutlet

Outlet = PressureOutlet | ResistanceOutlet | WindkesselOutlet

_RESISTANCE: Final = PA_PER_MMHG / UL_S_PER_ML_MIN
_COMPLIANCE: Final = 1000.0 / PA_PER_MMHG
_VALUES: Final = (
    "pressure_mmhg", "resistance_mmhg_min_ml", "proximal_mmhg_min_ml", "compliance_ml_mmhg",
)  # fmt: skip


def outlet_of(given: PulseOutlet | None, distal_pa: float, volume: float = 1.0) -> Outlet:
    """Outlet condition in the design's units, of a print ``volume`` times the size."""
    if given is None:
        return PressureOutlet(Constant(distal_pa))
    resistance = given.resistance_mmhg_min_ml * _RESISTANCE / volume
    if given.proximal_mmhg_min_ml is None or given.compliance_ml_mmhg is None:
        return ResistanceOutlet(resistance, distal_pa)
    proximal = given.proximal_mmhg_min_ml * _RESISTANCE / volume
    compliance = given.compliance_ml_mmhg * _COMPLIANCE * volume
    return WindkesselOutlet(proximal, compliance, resistance, distal_pa)


def steady_of(outlet: Outlet) -> OutletLoad:
    """The same in steady flow."""
    if isinstance(outlet, ResistanceOutlet):
        return OutletLoad(outlet.resistance, outlet.distal_pa)
    if isinstance(outlet, WindkesselOutlet):
        return OutletLoad(outlet.proximal + outlet.distal, outlet.distal_pa)
    return OutletLoad(0.0, float(outlet.waveform.at(np.zeros(1))[0]))


def read_outlets(path: Path, network: VesselNetwork, volume: float = 1.0) -> dict[int, Outlet]:
    """Read a row for each outlet of ``network``, whose other numbers are those of a recipe.

    Raises
    ------
    UsageError
        For a missing or unknown column, a cell that is no number, a row that isn't an outlet's or
        is its second, an outlet without a row.
    OSError
        When the file can't be read.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as handle:
            reader = csv.DictReader(handle)
            rows, names = list(reader), reader.fieldnames or []
    except (UnicodeDecodeError, csv.Error) as exc:
        raise UsageError(f"{path} isn't a CSV file: {exc}") from exc
    key = next((name for name in ("node", "vessel") if name in names), None)
    strange = [name for name in names if name not in ("node", "vessel", *_VALUES)]
    if key is None or strange:
        wrong = f"has a column {strange[0]!r}" if strange else "has no column node or vessel"
        raise UsageError(f"{path} {wrong}; its first line names node,{','.join(_VALUES)}")
    ends = network.outlets()
    outlets: dict[int, Outlet] = {}
    for line, row in enumerate(rows, 2):
        place = f"{path}, line {line}"
        node = _node(place, key, row, network)
        if node not in ends or node in outlets:
            wrong = "has a row already" if node in outlets else "isn't one of the outlets"
            raise UsageError(f"{place}: {key} {row[key]} {wrong}; outlets are the nodes "
                             f"{', '.join(map(str, ends[:8]))}")  # fmt: skip
        outlets[node] = _row(place, row, volume)
    bare = [int(node) for node in ends if node not in outlets]
    if bare:
        raise UsageError(
            f"{path}: outlet {bare[0]} has no condition ({len(bare)} of {len(ends)} such); give it "
            "a row with its pressure or resistance"
        )
    return outlets


def _node(place: str, key: str, row: Mapping[str, str], network: VesselNetwork) -> int:
    number = _number(place, key, row)
    if number is None or number != int(number) or number < 0:
        raise UsageError(f"{place}: {key} {row[key]!r} is no number of a {key}")
    if key == "node":
        return int(number)
    if number >= network.vessel_count:
        raise UsageError(
            f"{place}: there is no vessel {int(number)}; the network has 0 to "
            f"{network.vessel_count - 1}"
        )
    return int(network.vessel_nodes[int(number), 1])


def _row(place: str, row: Mapping[str, str], volume: float) -> Outlet:
    pressure, *rest = (_number(place, name, row) for name in _VALUES)
    resistance, proximal, compliance = rest
    if resistance is None:
        if pressure is None or proximal is not None or compliance is not None:
            raise UsageError(f"{place}: give pressure_mmhg or resistance_mmhg_min_ml")
        return PressureOutlet(Constant(pressure * PA_PER_MMHG))
    if (proximal is None) != (compliance is None):
        raise UsageError(f"{place}: a Windkessel has proximal_mmhg_min_ml, compliance_ml_mmhg and "
                         "resistance_mmhg_min_ml; give all three, or the last alone")  # fmt: skip
    for name, value in zip(_VALUES[1:], rest, strict=True):
        if value is not None and value <= 0.0:
            raise UsageError(f"{place}: {name} is {value:g}; give a number above 0")
    given = PulseOutlet(
        resistance_mmhg_min_ml=resistance,
        proximal_mmhg_min_ml=proximal,
        compliance_ml_mmhg=compliance,
    )
    return outlet_of(given, (pressure or 0.0) * PA_PER_MMHG, volume)


def _number(place: str, name: str, row: Mapping[str, str]) -> float | None:
    text = (row.get(name) or "").strip()
    if not text:
        return None
    try:
        value = float(text)
    except ValueError as exc:
        raise UsageError(f"{place}: {name} {text!r} is no number") from exc
    if not np.isfinite(value):
        raise UsageError(f"{place}: {name} is {text}; give a number")
    return value
