"""Find a datum (face, axis, port) in a scan; form linear equations for the part's pose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from registration.alignment import Fit
from registration.errors import DatumError
from registration.measuring.geometry.datum import Datum
from registration.measuring.geometry.designed import designed_mouth, straight_axis
from registration.measuring.geometry.faces import Face
from registration.measuring.geometry.features import axis_rows, plane_rows, stack_features
from registration.measuring.geometry.fit_state import Setting
from registration.measuring.geometry.line import Line
from registration.measuring.geometry.lumen import LEAST_SECTIONS, Lumen
from registration.measuring.geometry.mouth import mouth, mouth_rows
from registration.measuring.geometry.nested import Rows
from registration.measuring.geometry.scene import LEAST_POINTS, LEAST_SEEN, Scene

_NEARLY = 0.94
"""Cosine of 20 degrees: a face looks a way when its normal is nearer to it."""


def rows_of(datum: Datum, scene: Scene, setting: Setting) -> Rows:
    """Return what a datum asks of the frame.

    Raises
    ------
    DatumError
        When it isn't in the design, or isn't seen.
    """
    if datum.kind == "face":
        return plane_rows(named_face(datum, scene.faces), setting)
    if datum.kind == "axis":
        return axis_rows(_axis(datum, scene, setting.fit), setting)
    if datum.kind == "ports":
        return _ports(scene, setting)
    vessel, last = designed_mouth(datum, scene.network)
    rows = _mouth(vessel, last, scene, setting)
    if rows is None:
        raise DatumError(
            f"datum {datum} isn't seen: no section was measured within a diameter of it; scan that "
            "end too, or choose another datum"
        )
    return rows


def _ports(scene: Scene, setting: Setting) -> Rows:
    """All mouths that are seen, as one datum."""
    ends = scene.mouths()
    mouths = [one for one in (_mouth(v, e, scene, setting) for v, e in ends) if one is not None]
    if len(mouths) < 2:
        raise DatumError(
            f"datum ports: {len(mouths)} of {len(ends)} mouths are seen, at least 2 are needed; "
            "scan more of the part, or name faces"
        )
    return stack_features(mouths)


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
    lumen = scene.lumen(datum.vessel, fit)
    if lumen is None:
        raise DatumError(
            f"datum {datum} isn't seen: fewer than {LEAST_SECTIONS} whole sections of vessel "
            f"{datum.vessel} were measured; {_seen_axes(scene, fit)}"
        )
    return lumen


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
    lumen = scene.lumen(vessel, setting.fit)
    there = None if lumen is None else mouth(lumen, last)
    return None if there is None else mouth_rows(there, scene.face_at(there.node), setting)
