"""Datum equations of faces, axes and ports, solved in their order (ISO 5459)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from design.geometry.polyline import vectors_across
from kernels.arrays import FloatArray
from registration.alignment import Fit
from registration.alignment.uncertainty import ScanErrors
from registration.errors import DatumError
from registration.measuring.geometry.datum import Datum
from registration.measuring.geometry.faces import Face
from registration.measuring.geometry.frame import motion
from registration.measuring.geometry.lumen import LEAST_SECTIONS, Line, Lumen, cells, open_filter
from registration.measuring.geometry.scene import (
    LEAST_POINTS,
    LEAST_SEEN,
    Scene,
    designed_mouth,
    straight_axis,
)


@dataclass(frozen=True)
class Setting:
    """What all datum features of a scan share.

    Attributes
    ----------
    fit : Fit
        Scan to part, so far.
    errors : ScanErrors
    strains : tuple of (3, 3) float64
        See `frame.strains`.
    """

    fit: Fit
    errors: ScanErrors
    strains: tuple[FloatArray, ...]

    def stretched(self, place: FloatArray) -> list[FloatArray]:
        """Motion (3,) of a place by each stretch."""
        return [strain @ (place - self.fit.centre) for strain in self.strains]


def light_shift(there: Setting) -> float:
    """Standard uncertainty of a lumen's middle along the light, mm.

    The wall above and the one below it face the light otherwise and may err apart: the middle is
    half of the difference of two errors.
    """
    return float(np.hypot(there.errors.level_mm, there.errors.facing_mm) / np.sqrt(2))


def light_across(there: Setting, u: FloatArray, v: FloatArray) -> tuple[float, float]:
    """Return `light_shift` along two unit vectors (3,), mm."""
    beam = there.fit.rotation @ there.errors.beam
    size = light_shift(there)
    return float(size * (beam @ u)), float(size * (beam @ v))


LEAST_HOLD = 0.02
"""Share of its full hold below which a datum doesn't hold a freedom."""
_NAMED = 0.99


@dataclass(frozen=True)
class Rows:
    """What one datum asks of a twist ξ (6,): ``matrix`` ξ = ``asked``.

    Attributes
    ----------
    matrix : (k, 6) float64
        Of turn (mm a rad) and shift.
    asked : (k,) float64, mm
    pulls : (g, k) float64, mm
        Change of `asked` by one standard deviation of each independent error.
    strained : (s, k) float64, mm
        The same by each stretch of the whole scan.
    """

    matrix: FloatArray
    asked: FloatArray
    pulls: FloatArray
    strained: FloatArray


@dataclass(frozen=True)
class DatumTwist:
    """Twist that brings the datums to their places, and what they leave free.

    Attributes
    ----------
    twist : (6,) float64
    free : (6, f) float64
        Twists that no datum holds.
    pulls : (g, 6) float64
    strained : (s, 6) float64
    """

    twist: FloatArray
    free: FloatArray
    pulls: FloatArray
    strained: FloatArray


def hold(stages: Sequence[Rows], reach_mm: float) -> DatumTwist:
    """Solve the datums in their order: each only moves what those before it left free.

    Parameters
    ----------
    stages : sequence of Rows
        Primary, secondary, tertiary.
    reach_mm : float, mm
        Half of the part's size: a turn counts by what it moves there.
    """
    scale = np.concatenate([np.full(3, 1 / reach_mm), np.ones(3)])
    free = np.diag(scale)
    twist = np.zeros(6)
    answers: list[FloatArray] = []  # (6, k) each: twist per what a stage is asked
    for rows in stages:
        u, size, vt = np.linalg.svd(rows.matrix @ free)
        rank = int((size > LEAST_HOLD).sum())
        inverse = free @ vt[:rank].T @ (u[:, :rank].T / size[:rank, None])
        answers = [old - inverse @ (rows.matrix @ old) for old in answers]
        answers.append(inverse)
        twist = twist + inverse @ (rows.asked - rows.matrix @ twist)
        free = free @ vt[rank:].T
    strained = sum(rows.strained @ one.T for rows, one in zip(stages, answers, strict=True))
    pulls = [rows.pulls @ one.T for rows, one in zip(stages, answers, strict=True)]
    return DatumTwist(twist, free, np.vstack(pulls), np.asarray(strained))


def free_words(free: FloatArray) -> list[str]:
    """Say which motions (6, f) are left: "shift along x", "turn about z"."""
    if not free.shape[1]:
        return []
    _, size, vt = np.linalg.svd(free[:3])
    size = np.concatenate([size, np.zeros(free.shape[1] - len(size))])
    still = size < 1e-6 * max(float(size.max()), 1.0)
    shifts = free[3:] @ vt[still].T
    turns = free[:3] @ vt[~still].T
    return [f"shift along {way}" for way in _ways(shifts)] + [
        f"turn about {way}" for way in _ways(turns)
    ]


def _ways(vectors: FloatArray) -> list[str]:
    """Names of the directions that (3, k) vectors span."""
    if not vectors.shape[1]:
        return []
    u, size, _ = np.linalg.svd(vectors, full_matrices=False)
    span = u[:, size > 1e-6 * size.max()]
    named = [k for k in range(3) if np.linalg.norm(span[k]) > _NAMED]
    if len(named) >= span.shape[1]:
        return ["xyz"[k] for k in named[: span.shape[1]]]
    rest = span - sum((np.outer(np.eye(3)[k], span[k]) for k in named), start=np.zeros_like(span))
    u, _, _ = np.linalg.svd(rest, full_matrices=False)
    others = u[:, : span.shape[1] - len(named)].T
    return ["xyz"[k] for k in named] + [_vector(v) for v in others]


def _vector(way: FloatArray) -> str:
    text = ", ".join(f"{v:.2f}" for v in way + 0.0)
    return f"({text})".replace("-", "\N{MINUS SIGN}")


PATCH_MM = 0.5
"""Surface points nearer than this err together."""


def plane_rows(face: Face, there: Setting) -> Rows:
    """Return what a planar face asks: its least squares plane on the designed one.

    Two tilts, as motion at the face's edge, and the distance.

    Raises
    ------
    DatumError
        When the face isn't planar.
    """
    if face.normal is None:
        raise DatumError(f"{face.name} has no plane; name a planar face")
    plane = _Plane.of(there.fit.apply(face.scanned), face.normal, face.size_mm / 2)
    deviation = plane.terms.T @ ((plane.points - face.point) @ plane.normal)
    asked = -(plane.bread @ deviation)
    pulls = np.vstack([plane.noise(face.point, asked), plane.level(there)])
    return Rows(plane.matrix(there), asked, -pulls, -plane.strained(there))


@dataclass(frozen=True)
class _Plane:
    """Points (k, 3), mm, of a planar face, and the terms (k, 3) of a plane's height at them."""

    points: FloatArray
    normal: FloatArray
    reach: float
    terms: FloatArray
    bread: FloatArray

    @staticmethod
    def of(points: FloatArray, normal: FloatArray, reach: float) -> _Plane:
        away = points - points.mean(axis=0)
        tilts = [away @ side / reach for side in vectors_across(normal)]
        terms = np.column_stack([*tilts, np.ones(len(points))])
        return _Plane(points, normal, reach, terms, np.linalg.inv(terms.T @ terms))

    def matrix(self, there: Setting) -> FloatArray:
        """By how much small motions change tilts and distance, (3, 6).

        A point's height changes by n · (ω × (p - c) + t); the plane's numbers are linear in it.
        """
        still = motion(np.zeros(3))
        tilts = [
            self.reach * (self.normal @ (motion(way) - still))
            for way in vectors_across(self.normal)
        ]
        return np.vstack([*tilts, self.normal @ motion(self._arm(there))])

    def noise(self, point: FloatArray, asked: FloatArray) -> FloatArray:
        """Pulls of patches of the face, whose points err together, (g, 3), mm."""
        rest = (self.points - point) @ self.normal + self.terms @ asked
        patch = cells(self.points, PATCH_MM)
        sums = [np.bincount(patch, rest * column) for column in self.terms.T]
        return np.column_stack(sums) @ self.bread

    def level(self, there: Setting) -> FloatArray:
        """Pulls of what all the face shares: its level, and light on it, (2, 3), mm."""
        errors = there.errors
        light = float((self.normal @ (there.fit.rotation @ errors.beam)) ** 2)
        level = np.hypot(errors.outer_mm, errors.faint_mm)
        return np.array([[0, 0, level], [0, 0, light * errors.facing_mm]])

    def strained(self, there: Setting) -> FloatArray:
        """Tilts and distance by each stretch, (s, 3), mm."""
        n, arm = self.normal, self._arm(there)
        u, v = vectors_across(n)
        return np.array(
            [[self.reach * (n @ s @ u), self.reach * (n @ s @ v), n @ s @ arm]
             for s in there.strains]
        )  # fmt: skip

    def _arm(self, there: Setting) -> FloatArray:
        return np.asarray(self.points.mean(axis=0) - there.fit.centre)


def axis_rows(lumen: Lumen, there: Setting) -> Rows:
    """Return what a straight vessel's axis asks: its least squares line on the designed one."""
    first, last = lumen.line.points[0], lumen.line.points[-1]
    way = (last - first) / np.linalg.norm(last - first)
    u, v = vectors_across(way)
    middle = lumen.raw.mean(axis=0)
    along = (lumen.raw - middle) @ way
    reach = lumen.line.length / 2
    design = np.column_stack([along / reach, np.ones(len(along))])
    weights = np.linalg.inv(design.T @ design) @ design.T
    arm = middle - there.fit.centre
    matrix, asked, pulls, strained = [], [], [], []
    for side in (u, v):
        off = weights @ ((lumen.raw - first) @ side)
        turn = reach * (side @ (motion(way) - motion(np.zeros(3))))
        matrix += [turn, side @ motion(arm)]
        asked += [-off[0], -off[1]]
        pulls += [lumen.shared(weights[0]), lumen.shared(weights[1])]
        strained.append([[reach * (side @ s @ way), side @ s @ arm] for s in there.strains])
    beside = light_across(there, u, v)
    shared = np.array([[0, beside[0], 0, beside[1]]])
    return Rows(
        np.array(matrix), np.array(asked), np.vstack([np.diag(pulls), shared]),
        -np.concatenate([np.array(one) for one in strained], axis=1),
    )  # fmt: skip


def stack_features(parts: list[Rows]) -> Rows:
    """Several features as one datum: all together by least squares."""
    width = sum(len(one.asked) for one in parts)
    blocks, at = [], 0
    for one in parts:
        block = np.zeros((len(one.pulls), width))
        block[:, at : at + len(one.asked)] = one.pulls
        blocks.append(block)
        at += len(one.asked)
    return Rows(
        np.vstack([one.matrix for one in parts]),
        np.concatenate([one.asked for one in parts]),
        np.vstack(blocks),
        np.hstack([one.strained for one in parts]),
    )


MOUTH_DIAMETERS = 2.0
"""Of a vessel that its mouth is told from."""


@dataclass(frozen=True)
class AxisEnd:
    """Where a lumen's axis reaches its free end.

    Attributes
    ----------
    node, way : (3,) float64, mm
        As designed: the end of the axis, and the unit way out.
    off : (3,) float64, mm
        Measured less designed, across that way.
    noise_mm : float, mm
        Standard deviation of one coordinate.
    """

    node: FloatArray
    way: FloatArray
    off: FloatArray
    noise_mm: float


def mouth(lumen: Lumen, last: bool) -> AxisEnd | None:
    """Carry the axis on to a free end; None where no section near it was measured.

    A straight line through the offsets of the sections within two diameters of the end; the
    nearest must lie within one.
    """
    node, way, radius = lumen.line.end(last)
    from_end = lumen.line.length - lumen.along if last else lumen.along
    near = from_end < 2 * radius * MOUTH_DIAMETERS
    if near.sum() < 3 or from_end[near].min() > 2 * radius:
        return None
    off = lumen.raw - lumen.line.nearest(lumen.raw)[0]
    off = off - (off @ way)[:, None] * way
    weights = np.zeros(len(off))
    # Wide weights: a straight line through all of them.
    weights[near] = open_filter(from_end[near], 100.0 * radius, np.zeros(1))[0]
    return AxisEnd(node, way, weights @ off, lumen.shared(weights))


def mouth_rows(end: AxisEnd, face: Face | None, there: Setting) -> Rows:
    """Return what a mouth asks: its middle, and where it was seen the face around it."""
    u, v = vectors_across(end.way)
    arm = end.node - there.fit.centre
    light = light_across(there, u, v)
    matrix = [side @ motion(arm) for side in (u, v)]
    asked = [-(side @ end.off) for side in (u, v)]
    pulls = [[end.noise_mm, 0], [0, end.noise_mm], list(light)]
    strained = [[-(side @ s @ arm) for side in (u, v)] for s in there.strains]
    rows = Rows(np.array(matrix), np.array(asked), np.array(pulls), np.array(strained))
    if face is None or face.normal is None:
        return rows
    plane = plane_rows(face, there)
    # The plane's distance at the mouth, from that at its middle and both tilts.
    reach = face.size_mm / 2
    away = end.node - there.fit.apply(face.scanned).mean(axis=0)
    s, t = (away @ side / reach for side in vectors_across(face.normal))
    here = np.array([s, t, 1.0])
    both = np.zeros((len(rows.pulls) + len(plane.pulls), 3))
    both[: len(rows.pulls), :2] = rows.pulls
    both[len(rows.pulls) :, 2] = plane.pulls @ here
    return Rows(
        np.vstack([rows.matrix, here @ plane.matrix]),
        np.append(rows.asked, here @ plane.asked),
        both,
        np.column_stack([rows.strained, plane.strained @ here]),
    )


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
