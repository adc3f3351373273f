"""Fit the homography of a tilted camera to marked points; map plane points to pixels with it.

Direct linear transform on normalised coordinates (Hartley 1997, doi 10.1109/34.601246), then
least squares of the distances in the picture.
"""

from __future__ import annotations

from itertools import combinations
from typing import Final

import cv2
import numpy as np

from kernels.arrays import FloatArray

FEWEST: Final = 4
_LEAST_HEIGHT = 0.05
_TRIPLES: Final = tuple(combinations(range(FEWEST), 3))


def mapped(matrix: FloatArray, places: FloatArray) -> FloatArray:
    """Places (n, 2) through a homography (3, 3), (n, 2)."""
    seen = places @ matrix[:, :2].T + matrix[:, 2]
    return np.asarray(seen[:, :2] / seen[:, 2:])


def slopes(matrix: FloatArray, places: FloatArray) -> FloatArray:
    """Derivative of `mapped` at places (n, 2), (n, 2, 2)."""
    weight = places @ matrix[2, :2] + matrix[2, 2]
    pulled = mapped(matrix, places)[:, :, None] * matrix[2, :2]
    return np.asarray((matrix[:2, :2] - pulled) / weight[:, None, None])


def spread_out(places: FloatArray) -> bool:
    """Whether some four of the places (n, 2) have no three in line.

    In line: the triangle's least height is below 5 % of the places' extent.
    """
    extent = float(np.hypot(*np.ptp(places, axis=0)))
    fours = np.array(list(combinations(range(len(places)), FEWEST))).reshape(-1, FEWEST)
    height = np.full(len(fours), np.inf)
    for triple in _TRIPLES:
        a, b, c = (places[fours[:, k]] for k in triple)
        sides = [np.hypot(*(p - q).T) for p, q in ((a, b), (b, c), (c, a))]
        (x0, y0), (x1, y1) = (b - a).T, (c - a).T
        twice = np.abs(x0 * y1 - y0 * x1)
        height = np.minimum(height, twice / np.maximum(np.max(sides, axis=0), 1e-12))
    return bool(len(fours) and height.max() > _LEAST_HEIGHT * extent)


def find_homography(places: FloatArray, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The homography (3, 3) that takes places (n, 2), mm, to pixels (n, 2), and its covariance.

    Parameters
    ----------
    places, pixels : (n, 2) float64
        Four at least, `spread_out`.

    Returns
    -------
    (3, 3) float64
    (9, 9) float64
        Covariance of its elements, row by row, for pixels read to a deviation of 1 px.
    """
    matrix = np.asarray(cv2.findHomography(places, pixels, 0)[0])
    by_u, by_v = _by_elements(matrix, places)
    # The scale of the elements changes nothing seen: of nine unknowns eight are determined.
    inverse = np.linalg.pinv(np.concatenate([by_u, by_v]), rcond=1e-11)
    return matrix, inverse @ inverse.T


def reading_error(matrix: FloatArray, spread: FloatArray, places: FloatArray) -> FloatArray:
    """Deviation in px at places (n, 2) of a view whose marks are read to 1 px, (n,)."""
    by_u, by_v = _by_elements(matrix, places)
    variance = sum(np.einsum("ni,ij,nj->n", by, spread, by) for by in (by_u, by_v))
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def _by_elements(matrix: FloatArray, places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Derivatives of u and of v at places (n, 2) by the matrix's elements, (n, 9) each."""
    whole = np.hstack([places, np.ones((len(places), 1))])
    weight = (whole @ matrix[2])[:, None]
    seen, none = mapped(matrix, places), np.zeros_like(whole)
    by_u = np.hstack([whole, none, -seen[:, :1] * whole]) / weight
    by_v = np.hstack([none, whole, -seen[:, 1:] * whole]) / weight
    return by_u, by_v
