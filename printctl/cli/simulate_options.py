"""Typer options of `printctl simulate` for the ink prediction: lag, design, origin, voxel size."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from design.units import LengthUnit


@dataclass(frozen=True)
class BeadChoices:
    """What the options say; None for what wasn't given."""

    out: Path | None = None
    lag_s: float | None = None
    network: Path | None = None
    unit: LengthUnit | None = None
    place: str | None = None
    voxel_um: float | None = None
    window: str | None = None

    @property
    def asks(self) -> bool:
        """Whether anything of this is wanted."""
        return self != BeadChoices()
