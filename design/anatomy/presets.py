"""Default Murray exponent and pressure drop of each organ template."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class Preset:
    """Growth by a template.

    Attributes
    ----------
    murray_exponent : float
    pressure_drop_mmhg : float
        From the inlet to the terminals; sets how slender vessels are.
    """

    murray_exponent: float
    pressure_drop_mmhg: float


PRESETS: Final = {
    # Between Murray's 3 and the 7/3 that Huo and Kassab find in coronary casts (PMC4913552). With
    # 7.3 mmHg elements are as slender as those of Kassab et al. 1993 (measures/published/).
    "heart": Preset(2.5, 7.3),
    # Nordsletten et al. 2006 find Murray's law. The drop is ours: no figure was confirmed.
    "kidney": Preset(3.0, 20.0),
    # Of the portal vein, to its terminals. Ours: no figure of these was confirmed.
    "liver": Preset(3.0, 5.0),
    # Helthuis et al. 2019 (Anat Rec 302:1434, PMC6767475) find Murray's law in human cerebral
    # arteries of 0.1 to 1 mm radius. The drop is ours.
    "cortex": Preset(3.0, 20.0),
}
