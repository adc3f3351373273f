"""Key figures of a run, read from the results of its stages."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from design.units import PA_PER_MMHG
from printctl.run_folder.manifest import Manifest

Stages = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True)
class Figure:
    """Key figure of a run.

    Attributes
    ----------
    key : str
    name : str
        As people are told.
    value : float or str
    unit : str
    """

    key: str
    name: str
    value: float | str
    unit: str = ""

    @property
    def text(self) -> str:
        """Value and unit, to be read."""
        shown = self.value if isinstance(self.value, str) else f"{self.value:.4g}"
        return f"{shown} {self.unit}".strip()


def _of(stage: str, key: str, factor: float = 1.0) -> Callable[[Stages], float | str | None]:
    def found(stages: Stages) -> float | str | None:
        value = stages.get(stage, {}).get(key)
        if isinstance(value, bool) or not isinstance(value, int | float):
            return None
        return float(value) * factor

    return found


def _pressure_pa(stages: Stages) -> float | str | None:
    pressure = _of("flow", "pressure_drop_pa")(stages)
    return pressure if isinstance(pressure, float) and pressure < PA_PER_MMHG else None


def _pressure_mmhg(stages: Stages) -> float | str | None:
    return None if _pressure_pa(stages) is not None else _of("flow", "pressure_drop_mmhg")(stages)


def _lumens(stages: Stages) -> float | str | None:
    lumens = stages.get("lumens")
    if not lumens or not lumens.get("checked"):
        return None
    summary = lumens.get("summary", {})
    counted = f"{summary.get('closed', 0)} of {summary.get('lumens', 0)} closed"
    leaks = f"{summary.get('leaks', 0)} leaks"
    return f"{'open' if lumens.get('passed') else 'not as designed'}: {counted}, {leaks}"


def _checks(stages: Stages) -> float | str | None:
    checks = stages.get("dry run", {}).get("checks")
    if not isinstance(checks, list):
        return None
    failed = [one for one in checks if isinstance(one, dict) and one.get("passed") is False]
    warnings = sum(1 for one in failed if one.get("weight") == "warns")
    refused = len(failed) - warnings
    return f"{len(checks) - len(failed)} passed, {warnings} warn, {refused} refuse"


_FIGURES: Final[tuple[tuple[str, str, str, Callable[[Stages], float | str | None]], ...]] = (
    ("vessels", "Vessels", "", _of("vasculature", "vessels")),
    ("terminals", "Terminals", "", _of("vasculature", "terminals")),
    ("length", "Length of all vessels", "mm", _of("vasculature", "length_mm")),
    ("diameter_min", "Narrowest vessel", "mm", _of("vasculature", "diameter_min_mm")),
    ("diameter_max", "Widest vessel", "mm", _of("vasculature", "diameter_max_mm")),
    ("tissue", "Tissue", "mm³", _of("tissue", "volume_mm3")),
    ("lumen", "Volume of the lumens", "mm³", _of("vasculature", "volume_mm3")),
    ("inflow", "Flow", "mL/min", _of("flow", "inflow_ml_min")),
    ("drop_pa", "Pressure drop", "Pa", _pressure_pa),
    ("drop_mmhg", "Pressure drop", "mmHg", _pressure_mmhg),
    ("shear_max", "Greatest wall shear", "Pa", _of("flow", "wall_shear_max_pa")),
    ("shear_median", "Median wall shear", "Pa", _of("flow", "wall_shear_median_pa")),
    ("print_time", "Print time", "min", _of("dry run", "print_time_s", 1 / 60)),
    ("ink", "Ink needed", "µL", _of("dry run", "ink_needed_ul")),
    ("fillings", "Fillings of the syringe", "", _of("dry run", "fillings")),
    ("checks", "Checks of the dry run", "", _checks),
    ("lumens", "Lumens by the G-code", "", _lumens),
)


def key_figures(folder: Path) -> list[Figure]:
    """What a run's stages have said so far, in the order of their making."""
    manifest = Manifest.load(folder)
    stages = {name: record.summary for name, record in manifest.stages.items()}
    figures = ((key, name, of(stages), unit) for key, name, unit, of in _FIGURES)
    return [
        Figure(key, name, value, unit) for key, name, value, unit in figures if value is not None
    ]
