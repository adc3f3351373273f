"""Inputs for fitting datums and ISO 1101 characteristics: scanned faces and vessel sections."""

from __future__ import annotations

from dataclasses import dataclass

from design.network import VesselNetwork
from kernels.arrays import FloatArray
from registration.alignment import Fit
from registration.alignment.uncertainty import ScanErrors
from registration.measuring.gauging.outlines import Outlines
from registration.measuring.geometry.designed import designed_mouths
from registration.measuring.geometry.faces import Face
from registration.measuring.geometry.line import Line
from registration.measuring.geometry.lumen import Lumen, lumen

LEAST_SEEN = 0.2
"""Share of a face that must be seen for a datum."""
LEAST_POINTS = 200


@dataclass(frozen=True)
class Cut:
    """Measured sections of one vessel, (n,) of them.

    Attributes
    ----------
    along : (n,) float64, mm
    outlines : Outlines
    noise_mm : (n,) float64, mm
        Standard errors of the diameters.
    """

    along: FloatArray
    outlines: Outlines
    noise_mm: FloatArray

    def lumen(self, line: Line, fit: Fit, blur_mm: float) -> Lumen | None:
        """Return axis and wall in the frame of `fit`."""
        return lumen(line, self.along, self.outlines, self.noise_mm, fit, blur_mm)


@dataclass(frozen=True)
class Scene:
    """What datums are looked for in.

    Attributes
    ----------
    network : VesselNetwork
    faces : tuple of Face
    cuts : tuple of Cut
        One a vessel.
    errors : ScanErrors
    """

    network: VesselNetwork
    faces: tuple[Face, ...]
    cuts: tuple[Cut, ...]
    errors: ScanErrors

    def lumen(self, vessel: int, fit: Fit) -> Lumen | None:
        """Axis and wall of a vessel in the frame of `fit`."""
        line = Line.of(self.network, vessel)
        return self.cuts[vessel].lumen(line, fit, self.errors.blur_mm)

    def face_at(self, place: FloatArray) -> Face | None:
        """The seen planar face on which a place of the design lies."""
        for face in self.faces:
            if face.normal is None or len(face.scanned) < LEAST_POINTS:
                continue
            if face.seen >= LEAST_SEEN and abs((place - face.point) @ face.normal) < 0.01:
                return face
        return None

    def mouths(self) -> list[tuple[int, bool]]:
        """Vessel and whether its last node, of each end that opens."""
        return designed_mouths(self.network)
