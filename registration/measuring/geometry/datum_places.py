"""Uncertainty of the part's frame at each datum, and its shift there from the best fit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kernels.arrays import FloatArray
from registration.alignment import Fit
from registration.measuring.geometry.datum import Datum
from registration.measuring.geometry.datum_rows import named_face
from registration.measuring.geometry.frame import Frame
from registration.measuring.geometry.line import Line
from registration.measuring.geometry.scene import Scene


def places_of(
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
