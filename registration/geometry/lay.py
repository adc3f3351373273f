"""Lay the part's frame on chosen datums of a scan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from design.network import VesselNetwork
from registration.alignment import Fit
from registration.errors import DatumError
from registration.gauging.outlines import Outlines
from registration.geometry.datum import Datum
from registration.geometry.designed import designed_mouth, designed_mouths, straight_axis
from registration.geometry.faces import Face
from registration.geometry.features import (
    Setting,
    axis_rows,
    mouth,
    mouth_rows,
    plane_rows,
    stacked,
)
from registration.geometry.frame import Frame, strains
from registration.geometry.lumen import LEAST_SECTIONS, Line, Lumen, lumen
from registration.geometry.nested import Held, Rows, free_words, hold
from registration.uncertainty import ScanErrors

FloatArray = NDArray[np.float64]

LEAST_SEEN = 0.2
"""Share of a face that must be seen for a datum."""
LEAST_POINTS = 200
_STEPS = 5
_NEARLY = 0.94
"""Cosine of 20 degrees: a face looks a way when its normal is nearer to it."""


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


def lay_on_datums(datums: Sequence[Datum], start: Fit, scene: Scene) -> Frame:
    """Return the frame that datums define, each in what those before it left free.

    Raises
    ------
    DatumError
        When one isn't in the design, isn't seen, or all together leave a motion free.
    """
    fit = start
    for _ in range(_STEPS):
        setting = Setting(fit, scene.errors, strains(fit, scene.errors))
        stages = [_rows(datum, scene, setting) for datum in datums]
        held = hold(stages, _reach(scene.network, scene.faces))
        _refuse_free(datums, held)
        before, fit = fit, _moved(fit, held.twist)
        if np.abs(fit.matrix - before.matrix).max() < 1e-7:
            break
    stretch = strains(fit, scene.errors)
    frame = Frame(
        fit, tuple(map(str, datums)), _words(datums), held.pulls,
        tuple(zip(stretch, held.strained, strict=True)),
    )  # fmt: skip
    return replace(frame, places=_places(datums, frame, start, scene))


def _rows(datum: Datum, scene: Scene, setting: Setting) -> Rows:
    if datum.kind == "face":
        return plane_rows(named_face(datum, scene.faces), setting)
    if datum.kind == "axis":
        return axis_rows(_axis(datum, scene, setting.fit), setting)
    if datum.kind == "ports":
        ends = scene.mouths()
        found = [one for one in (_mouth(v, e, scene, setting) for v, e in ends) if one is not None]
        if len(found) < 2:
            raise DatumError(
                f"datum ports: {len(found)} of {len(ends)} mouths are seen, at least 2 are needed; "
                "scan more of the part, or name faces"
            )
        return stacked(found)
    vessel, last = designed_mouth(datum, scene.network)
    rows = _mouth(vessel, last, scene, setting)
    if rows is None:
        raise DatumError(
            f"datum {datum} isn't seen: no section was measured within a diameter of it; scan that "
            "end too, or choose another datum"
        )
    return rows


def named_face(datum: Datum, faces: Sequence[Face]) -> Face:
    """Return the face that a datum names: of those that look that way the farthest out.

    Raises
    ------
    DatumError
        When there is none, or too little of it is seen.
    """
    way = np.zeros(3)
    way["xyz".index(datum.where[1])] = 1.0 if datum.where[0] == "+" else -1.0
    there = [f for f in faces if f.normal is not None and f.normal @ way > _NEARLY]
    if not there:
        have = ", ".join(f.name for f in faces if f.normal is not None) or "none"
        raise DatumError(
            f"datum {datum}: the design has no planar outer face that looks that way (it has: "
            f"{have}); name one of those"
        )
    face = max(there, key=lambda f: float(f.point @ way))
    if face.seen < LEAST_SEEN or len(face.scanned) < LEAST_POINTS:
        raise DatumError(
            f"datum {datum} isn't seen: {100 * face.seen:.0f} % of it by {len(face.scanned)} "
            f"points, at least {100 * LEAST_SEEN:.0f} % and {LEAST_POINTS} are needed; choose a "
            "face that the scan shows"
        )
    return face


def _axis(datum: Datum, scene: Scene, fit: Fit) -> Lumen:
    straight_axis(datum, scene.network)
    found = scene.lumen(datum.vessel, fit)
    if found is None:
        raise DatumError(
            f"datum {datum} isn't seen: fewer than {LEAST_SECTIONS} whole sections of vessel "
            f"{datum.vessel} were measured; {_seen_axes(scene, fit)}"
        )
    return found


def _seen_axes(scene: Scene, fit: Fit) -> str:
    seen = [
        str(v)
        for v in range(scene.network.vessel_count)
        if Line.of(scene.network, v).straight and scene.lumen(v, fit) is not None
    ]
    if not seen:
        return "no straight vessel has so many; name faces or mouths"
    return f"straight vessels with so many: {', '.join(seen)}"


def _mouth(vessel: int, last: bool, scene: Scene, setting: Setting) -> Rows | None:
    found = scene.lumen(vessel, setting.fit)
    there = None if found is None else mouth(found, last)
    return None if there is None else mouth_rows(there, scene.face_at(there.node), setting)


def _refuse_free(datums: Sequence[Datum], held: Held) -> None:
    left = free_words(held.free)
    if left:
        names = ", ".join(map(str, datums))
        raise DatumError(
            f"the datums {names} hold {6 - len(left)} of 6 degrees of freedom; still free: "
            f"{', '.join(left)}; add a datum that holds them, like another face or mouth"
        )


def _moved(fit: Fit, twist: FloatArray) -> Fit:
    """The fit followed by a small motion of the part."""
    turn = Rotation.from_rotvec(twist[:3]).as_matrix()
    shift = turn @ (fit.shift - fit.centre) + fit.centre + twist[3:]
    return replace(fit, rotation=turn @ fit.rotation, shift=shift)


def _reach(network: VesselNetwork, faces: Sequence[Face]) -> float:
    points = np.vstack([network.points, *(face.point for face in faces)])
    return float(np.linalg.norm(np.ptp(points, axis=0))) / 2


def _words(datums: Sequence[Datum]) -> str:
    order = ("primary", "secondary", "tertiary")
    said = ", ".join(f"{one} ({name})" for one, name in zip(datums, order, strict=False))
    return (
        f"Datums: {said}. The design is laid, without stretching it, so that it meets the primary "
        "datum as measured; each further datum only settles what those before it left free. "
        'Planes and axes of datums are least squares fits. "Rigid" in this report is that frame.'
    )


def _places(
    datums: Sequence[Datum], frame: Frame, start: Fit, scene: Scene
) -> tuple[tuple[str, float, float], ...]:
    """Each datum's interval, µm, and by how much the frame moved there from the best fit."""
    move = frame.fit.matrix @ np.linalg.inv(start.matrix)
    out = []
    for datum in datums:
        for name, place, way, flat in _where(datum, scene):
            u = frame.along_mm(place, way) if flat else frame.across_mm(place, way)
            by = move[:3, :3] @ place + move[:3, 3] - place
            moved = abs(by @ way) if flat else float(np.linalg.norm(by - (by @ way) * way))
            out.append((name, 1e3 * u, 1e3 * float(moved)))
    return tuple(out)


def _where(datum: Datum, scene: Scene) -> list[tuple[str, FloatArray, FloatArray, bool]]:
    """Name, place and direction of a datum, and whether it is a plane."""
    if datum.kind == "face":
        face = named_face(datum, scene.faces)
        normal = np.zeros(3) if face.normal is None else face.normal
        return [(str(datum), face.point, normal, True)]
    if datum.kind == "axis":
        line = Line.of(scene.network, datum.vessel)
        way = line.points[-1] - line.points[0]
        middle = (line.points[-1] + line.points[0]) / 2
        return [(str(datum), middle, way / np.linalg.norm(way), False)]
    ends = [(datum.vessel, datum.kind == "outlet")]
    if datum.kind == "ports":
        ends = scene.mouths()
    out = []
    for vessel, last in ends:
        node, way, _ = Line.of(scene.network, vessel).end(last)
        out.append((f"{'outlet' if last else 'inlet'} {vessel}", node, way, False))
    return out
