"""Settings that convert E (by syringe bore) or open-valve time (by flow) to ink volume."""

from __future__ import annotations

from dataclasses import dataclass, field

from firmware_profiles import Printer
from firmware_profiles.materials.bead import BeadSection


@dataclass(frozen=True)
class Pushing:
    """How E, or an open valve, becomes a volume.

    Attributes
    ----------
    printer : Printer
        Whose firmware reads the file, and whose head writes it.
    bore_mm : float or None, mm
        Of the syringe, or the filament's diameter; None takes what the file itself says.
    bore_said : str
        Where the bore comes from, in words.
    syringe_mm : float, mm
        The bore where neither the user nor the file says one.
    syringe_said : str
    flow_ul_s : float or None, µL/s
        Of a pneumatic head while its valve is open; None takes the profile's measured one.
    layer_mm : float or None, mm
        Height of the lines; None takes what the file says, or the spacing of its levels.
    bead : BeadSection
        Cross-section of lines in layers.
    """

    printer: Printer
    bore_mm: float | None
    bore_said: str
    syringe_mm: float
    syringe_said: str
    flow_ul_s: float | None = None
    layer_mm: float | None = None
    bead: BeadSection = field(default_factory=BeadSection)
