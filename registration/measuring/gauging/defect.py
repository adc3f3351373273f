"""Record of a defect: kind, vessel, extent and size of a significant difference from the design."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

DefectKind = Literal["bulge", "stenosis", "occlusion", "missing", "leak", "bridge"]
Doubt = Literal["", "shade", "faint"]


@dataclass(frozen=True)
class Defect:
    """A place where the print differs from its design by more than the measurement's noise.

    Attributes
    ----------
    kind : str
        ``bulge`` and ``stenosis``: the lumen is wider or narrower than the rest of its vessel;
        ``occlusion``: gel fills it over a stretch; ``missing``: over all that was seen of it;
        ``leak``: a way through the gel to the outside; ``bridge``: one to another vessel.
    vessel : int
        In the network; of a bridge the lower number.
    other : int or None
        The vessel that a bridge leads to.
    from_mm, to_mm, at_mm : float, mm
        Along the vessel from its first node: extent, and where it is worst.
    point_mm : (x, y, z), mm
        That place on the designed axis (of a leak: in the middle of its way), part frame.
    size_um : float, µm
        Bulge and stenosis: by how much the diameter of equal area differs, signed. Occlusion: its
        length. Missing vessel: the designed diameter, none of which is there. Leak and bridge:
        the diameter of the way.
    error_um : float, µm
        Half width of the size's 95 % interval: noise of the sections themselves and, of a short
        bulge or stenosis, what blur along the vessel may have taken from it (`gauging.peak`).
    percent : float
        Of bulge and stenosis: the size over the rest of the vessel's diameter; else NaN.
    wall_um : float, µm
        Of bulge and stenosis: the wall's largest displacement, outward positive; of a one-sided
        one that is what stands out; else NaN.
    significance : float
        Size over its standard error; inf where what is seen isn't a matter of degree.
    seen : bool
        Whether all of its extent, and what borders on it, was seen; where not, the size is what
        was seen of it.
    doubt : str
        Of leaks and bridges: ``shade`` where gel in the shade of a bubble or a particle would look
        alike, ``faint`` where so much gel is left that it may be a crack or thinner gel; else "".
    """

    kind: DefectKind
    vessel: int
    other: int | None
    from_mm: float
    to_mm: float
    at_mm: float
    point_mm: tuple[float, float, float]
    size_um: float
    error_um: float
    percent: float
    wall_um: float
    significance: float
    seen: bool
    doubt: Doubt = ""
