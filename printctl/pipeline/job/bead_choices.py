"""Settings of the ink's prediction: its lag, the design it is held against, the files written."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from design.units import LengthUnit
from printctl.settings import opt, settings


@settings
class BeadOptions:
    """What is asked of the prediction; None for what wasn't given."""

    lag_s: float | None = opt("τ of the ink's flow, instead of its profile's.", min=0.0, max=100)
    network: Path | None = opt(
        "The designed vessels, for the diameter of each: a file or a run folder."
    )
    unit: LengthUnit | None = opt("Of the network's file, if it doesn't say.")
    voxel_um: float | None = opt("Write voxels (NRRD) and a surface (PLY).", min=1, max=2000)
    window_s: str | None = opt("Of the time line; the whole job if not.", metavar="FROM,TO")


@dataclass(frozen=True)
class BeadChoices(BeadOptions):
    """The same, with the folder that is written to and where the network's origin stands, mm."""

    out: Path | None = None
    place_mm: tuple[float, float, float] | None = None

    @property
    def asks(self) -> bool:
        """Whether anything of this is wanted."""
        return self != BeadChoices()
