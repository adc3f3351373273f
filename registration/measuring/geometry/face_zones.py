"""Surface profile deviation of the part's outer faces (ISO 1101), filtered over each face."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix
from scipy.spatial import cKDTree

from kernels.arrays import FloatArray
from registration.alignment.distance import ModelSurface
from registration.alignment.uncertainty import ScanErrors
from registration.measuring.geometry.characteristic import Characteristic, Zone
from registration.measuring.geometry.faces import Face
from registration.measuring.geometry.filters import ALPHA, cells
from registration.measuring.geometry.frame import COVERAGE, Frame
from registration.measuring.geometry.lumen import DRAWS
from registration.measuring.geometry.vessel_rows import SURFACE

CUT_OFF_MM = 0.8
"""Of the Gaussian over a face (ISO 4288's and ISO 25178-3's usual nesting index)."""
CELL_MM = 0.2
APART_MM = 0.6
"""Between places whose noise is compared."""
NORMAL_QUARTILE = 0.6745
_LEAST_CELLS = 30


def face_zone(
    face: Face, surface: ModelSurface, frame: Frame, errors: ScanErrors
) -> Characteristic:
    """Twice the largest filtered distance of one outer face from the design.

    Places are averaged in cells of 0.2 mm and filtered by a Gaussian over distance (areal, after
    ISO 16610-61), cells weighed by their places.
    """
    characteristic = Characteristic("face", face.name, SURFACE, seen=face.seen, note="not seen")
    places = frame.fit.apply(face.scanned)
    if len(places) == 0:
        return characteristic
    height = _height(face, surface, places)
    cell = cells(places, CELL_MM)
    count = np.bincount(cell).astype(np.float64)
    if len(count) < _LEAST_CELLS:
        return characteristic
    middle = np.column_stack([np.bincount(cell, column) / count for column in places.T])
    mean = np.bincount(cell, height) / count
    smooth = _gaussian(middle, count)
    off = smooth @ mean
    drawn = smooth @ np.random.default_rng(0).standard_normal((len(count), DRAWS))
    drawn *= _noise(middle, off[:, None]) / max(_noise(middle, drawn), 1e-12)
    worst = int(np.abs(off).argmax())
    normal = face.normal if face.normal is not None else frame.fit.rotation @ errors.beam
    zone = Zone(
        2 * float(np.abs(off[worst])),
        2 * np.abs(drawn).max(axis=0),
        2 * COVERAGE * float(drawn.std()),
        2 * _shared(middle[worst], normal, frame, errors),
    )
    low, high = zone.interval()
    return Characteristic(
        "face", face.name, SURFACE, None, 1e3 * zone.width, 1e3 * low, 1e3 * high, face.seen
    )


def _height(face: Face, surface: ModelSurface, places: FloatArray) -> FloatArray:
    if face.normal is None:
        return surface.query(places).distance
    return np.asarray((places - face.point) @ face.normal)


def _gaussian(middle: FloatArray, count: FloatArray) -> csr_matrix:
    """Rows of weights that sum to 1."""
    reach = ALPHA * CUT_OFF_MM
    pairs = cKDTree(middle).query_pairs(reach, output_type="ndarray")
    a = np.concatenate([pairs[:, 0], pairs[:, 1], np.arange(len(count))])
    b = np.concatenate([pairs[:, 1], pairs[:, 0], np.arange(len(count))])
    away = ((middle[a] - middle[b]) ** 2).sum(axis=1)
    weight = coo_matrix((count[b] * np.exp(-np.pi * away / reach**2), (a, b))).tocsr()
    whole = np.asarray(weight.sum(axis=1)).reshape(-1)
    return csr_matrix(weight.multiply(1.0 / whole[:, None]))


def _noise(middle: FloatArray, off: FloatArray) -> float:
    """Standard deviation of filtered heights (n, k), by second differences along the axes.

    Robust. Places stand so far apart that they share no noise through the filter; a slope has none.
    """
    tree = cKDTree(middle)
    noises = []
    for way in APART_MM * np.eye(3):
        (ahead_mm, ahead), (back_mm, back) = tree.query(middle + way), tree.query(middle - way)
        both = np.maximum(ahead_mm, back_mm) < 0.75 * CELL_MM
        noises.append((off[ahead] - 2 * off + off[back])[both] / np.sqrt(6))
    return float(np.median(np.abs(np.concatenate(noises))) / NORMAL_QUARTILE)


def _shared(place: FloatArray, normal: FloatArray, frame: Frame, errors: ScanErrors) -> float:
    """Half width by frame and level, mm."""
    light = float((frame.fit.rotation @ errors.beam) @ normal) ** 2
    level = np.sqrt(errors.outer_mm**2 + errors.faint_mm**2 + (light * errors.facing_mm) ** 2)
    return float(np.hypot(frame.along_mm(place, normal), COVERAGE * level))
