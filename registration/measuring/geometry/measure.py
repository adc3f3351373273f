"""Measure all geometric characteristics of a print: vessel axes, mouths, walls, outer faces."""

from __future__ import annotations

from registration.alignment.distance import ModelSurface
from registration.measuring.gauging.vessels import VesselGauge
from registration.measuring.geometry.characteristic import Characteristic
from registration.measuring.geometry.face_zones import face_zone
from registration.measuring.geometry.frame import Frame
from registration.measuring.geometry.line import Line
from registration.measuring.geometry.scene import Cut, Scene
from registration.measuring.geometry.vessel_rows import Case
from registration.measuring.geometry.vessel_zones import vessel_zones


def cuts_of(vessels: tuple[VesselGauge, ...]) -> tuple[Cut, ...]:
    """Return the measured sections of gauged vessels."""
    return tuple(Cut(v.along_mm, v.outlines, 1e-3 * v.noise_um) for v in vessels)


def characteristics(
    scene: Scene, gauged: tuple[float, ...], surface: ModelSurface, frame: Frame
) -> tuple[Characteristic, ...]:
    """Return the zones of every vessel, mouth and outer face.

    Parameters
    ----------
    scene : Scene
    gauged : tuple of float
        Share of each vessel's length with a measured section.
    surface : ModelSurface
    frame : Frame
    """
    ends: dict[int, list[bool]] = {}
    for vessel, last in scene.mouths():
        ends.setdefault(vessel, []).append(last)
    rows: list[Characteristic] = []
    for vessel, share in enumerate(gauged):
        line = Line.of(scene.network, vessel)
        case = Case(vessel, line, scene.lumen(vessel, frame.fit), share)
        rows += vessel_zones(case, ends.get(vessel, []), frame, scene.errors)
    return (*rows, *(face_zone(face, surface, frame, scene.errors) for face in scene.faces))
