"""Record of a geometric characteristic (ISO 1101): zone width and its 95 % interval."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from kernels.arrays import FloatArray

Name = Literal["axis", "port", "cylindricity", "lumen", "face"]
LEVEL = 97.5


@dataclass(frozen=True)
class Characteristic:
    """Width of the least zone that holds a feature, with its 95 % interval.

    Attributes
    ----------
    name : str
        ``axis``: position of a vessel's axis, of a curved one profile of a line: diameter of the
        zone about the designed axis; ``port``: position of a mouth, diameter; ``cylindricity``:
        radial width; ``lumen``, ``face``: profile of a surface, width of the zone about the
        designed surface.
    feature : str
        Like ``vessel 3``, ``outlet 3``, ``face +x``.
    words : str
        Of the characteristic, to be read.
    vessel : int or None
    zone_um : float, µm
        As measured: twice the largest distance from the design, or a difference of radii. Nothing
        is taken off for noise, which makes a largest value larger. NaN where there is none.
    low_um, high_um : float, µm
        95 % interval of the true value.
    seen : float
        Share of the feature that the value holds for.
    note : str
        Why there is no value.
    """

    name: Name
    feature: str
    words: str
    vessel: int | None = None
    zone_um: float = float("nan")
    low_um: float = float("nan")
    high_um: float = float("nan")
    seen: float = 0.0
    note: str = ""


@dataclass(frozen=True)
class Zone:
    """A measured zone and what makes it uncertain, mm.

    Attributes
    ----------
    width : float, mm
        As measured.
    of_noise : (d,) float64, mm
        Widths that noise alone would show.
    at_place : float, mm
        Half width of the 95 % interval by noise of the value at the worst place alone.
    shared : float, mm
        Half width by what errs together: frame, level of walls, scales.
    """

    width: float
    of_noise: FloatArray
    at_place: float
    shared: float

    def interval(self) -> tuple[float, float]:
        """95 % interval of the true width, mm.

        A zone's width is subadditive. Measured = true + noise therefore is at most true width plus
        that of noise alone: true >= measured - noise's. It is at least what is seen at the place
        of the true extreme: true <= measured + error at one place. The first takes the whole bias
        of a maximum over noisy places, as if the true form were flat.
        """
        usual = float(np.mean(self.of_noise))
        beyond = float(np.percentile(self.of_noise, LEVEL)) - usual
        low = self.width - usual - float(np.hypot(beyond, self.shared))
        return max(low, 0.0), self.width + float(np.hypot(self.at_place, self.shared))
