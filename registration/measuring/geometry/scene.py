"""Inputs of datum fits and ISO 1101 characteristics; refusal of missing datums."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from design.network import VesselNetwork
from kernels.arrays import FloatArray
from registration.alignment import Fit
from registration.alignment.uncertainty import ScanErrors
from registration.errors import DatumError
from registration.measuring.gauging.on_walls import Outlines
from registration.measuring.geometry.datum import Datum
from registration.measuring.geometry.faces import Face
from registration.measuring.geometry.lumen import Line, Lumen, lumen

MOST_NAMED = 12
"""Mouths that a message names."""


def check_designed(datums: Sequence[Datum], network: VesselNetwork) -> None:
    """Raise if a datum's vessel or mouth isn't in the design, or its axis is curved.

    Raises
    ------
    DatumError
    """
    for datum in datums:
        if datum.kind == "axis":
            straight_axis(datum, network)
        elif datum.kind in ("inlet", "outlet"):
            designed_mouth(datum, network)


def straight_axis(datum: Datum, network: VesselNetwork) -> Line:
    """Return the designed axis that a datum names.

    Raises
    ------
    DatumError
        When there is no such vessel, or it is curved.
    """
    count = network.vessel_count
    if datum.vessel >= count:
        raise DatumError(
            f"datum {datum}: the design has vessels 0 to {count - 1}; name one of those"
        )
    line = Line.of(network, datum.vessel)
    if not line.straight:
        raise DatumError(
            f"datum {datum}: vessel {datum.vessel} is curved by design and has no one axis; name "
            "a straight vessel, or its mouths"
        )
    return line


def designed_mouth(datum: Datum, network: VesselNetwork) -> tuple[int, bool]:
    """Return vessel, and whether its last node, of the mouth that a datum names.

    Raises
    ------
    DatumError
        When no end of the design opens there.
    """
    mouths = designed_mouths(network)
    named = (datum.vessel, datum.kind == "outlet")
    if named not in mouths:
        names = [f"{'outlet' if last else 'inlet'} {v}" for v, last in mouths]
        have = ", ".join(names[:MOST_NAMED]) + (" ..." if len(names) > MOST_NAMED else "")
        raise DatumError(f"datum {datum}: no such mouth in the design; it has {have}")
    return named


def designed_mouths(network: VesselNetwork) -> list[tuple[int, bool]]:
    """Return vessel and whether its last node, of each end that opens."""
    degree = network.degree()[network.vessel_nodes]
    return [(int(v), bool(last)) for v, last in np.argwhere(degree == 1)]


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
