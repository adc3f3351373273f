"""Fit the part's frame to chosen datums of a scan, with its uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from design.network import VesselNetwork
from kernels.arrays import FloatArray
from registration.alignment import Fit
from registration.errors import DatumError
from registration.measuring.geometry.datum import Datum
from registration.measuring.geometry.datum_fit import (
    DatumTwist,
    Setting,
    free_words,
    hold,
    named_face,
    rows_of,
)
from registration.measuring.geometry.faces import Face
from registration.measuring.geometry.frame import Frame, strains
from registration.measuring.geometry.lumen import Line
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


_STEPS = 5


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
        stages = [rows_of(datum, scene, setting) for datum in datums]
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
    return replace(frame, places=places_of(datums, frame, start, scene))


def _refuse_free(datums: Sequence[Datum], held: DatumTwist) -> None:
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
    names = ", ".join(f"{one} ({name})" for one, name in zip(datums, order, strict=False))
    return (
        f"Datums: {names}. The design is laid, without stretching it, so that it meets the primary "
        "datum as measured; each further datum only settles what those before it left free. "
        'Planes and axes of datums are least squares fits. "Rigid" in this report is that frame.'
    )
