"""Least-squares equations that lay a scanned plane face or vessel axis on its designed one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.geometry.polyline import vectors_across
from kernels.arrays import FloatArray
from registration.errors import DatumError
from registration.measuring.geometry.faces import Face
from registration.measuring.geometry.filters import cells
from registration.measuring.geometry.fit_state import Setting, light_across
from registration.measuring.geometry.frame import motion
from registration.measuring.geometry.lumen import Lumen
from registration.measuring.geometry.nested import Rows

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
