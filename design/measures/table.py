"""Convert network measures to nested dictionaries of plain numbers, for `report.json`."""

from __future__ import annotations

from dataclasses import asdict, is_dataclass
from typing import Any

import numpy as np

from design.measures.measure import NetworkMeasures
from design.measures.morphometry import Morphometry
from design.measures.supply import BEYOND_UM, Supply


def measures_dict(measures: NetworkMeasures) -> dict[str, Any]:
    """Nested dictionaries, lists, numbers and None; keys name their units.

    ``supply`` and ``printable`` hold shares of the tissue beyond each distance under ``beyond``,
    by the distance in µm. ``morphometry`` has a table per kind of vessel, its lists by order from
    1; per-vessel orders are left out.
    """
    table = {
        name: _plain(value)
        for name, value in vars(measures).items()
        if name not in ("supply", "printable", "morphometry")
    }
    table["supply"] = _supply(measures.supply)
    table["printable"] = _supply(measures.printable)
    table["morphometry"] = {
        each.kind.name.lower(): _morphometry(each) for each in measures.morphometry
    }
    return table


def _supply(supply: Supply | None) -> dict[str, Any] | None:
    if supply is None:
        return None
    table: dict[str, Any] = _plain(supply)
    table["beyond"] = {f"{um:g}_um": p for um, p in zip(BEYOND_UM, supply.beyond, strict=True)}
    return table


def _morphometry(each: Morphometry) -> dict[str, Any]:
    return {
        "strahler": _plain(each.strahler),
        "diameter_defined": _plain(each.diameter_defined),
        "diameter_order_change": each.diameter_order_change,
    }


def _plain(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        return _plain(asdict(value))
    if isinstance(value, dict):
        return {name: _plain(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, np.ndarray):
        return value.tolist()
    return value.item() if isinstance(value, np.generic) else value
