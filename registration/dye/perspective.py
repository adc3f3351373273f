"""A plane seen by a tilted camera: the homography through marked points.

Direct linear transform on normalised coordinates (Hartley 1997, doi 10.1109/34.601246), then
least squares of the distances in the picture.
"""

from __future__ import annotations

from itertools import combinations
from typing import Final

import numpy as np
from scipy.optimize import least_squares

from registration.dye.marks import FloatArray

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
        With a last element of 1 about the places' middle.
    (9, 9) float64
        Covariance of its elements, row by row, for pixels read to a deviation of 1 px.
    """
    into, onto = _normaliser(places), _normaliser(pixels)
    a, b = mapped(into, places), mapped(onto, pixels)
    one, none = np.ones((len(a), 1)), np.zeros((len(a), 3))
    whole = np.hstack([a, one])
    rows = np.vstack([
        np.hstack([whole, none, -b[:, :1] * whole]), np.hstack([none, whole, -b[:, 1:] * whole]),
    ])  # fmt: skip
    first = np.linalg.svd(rows)[2][-1]
    free = (first / first[-1])[:8]

    def misfit(values: FloatArray) -> FloatArray:
        return np.asarray((mapped(np.append(values, 1.0).reshape(3, 3), a) - b).ravel())

    solved = least_squares(misfit, free, x_scale="jac")
    found = np.append(solved.x, 1.0).reshape(3, 3)
    back = np.linalg.inv(onto)
    # One pixel is onto[0, 0] normalised; elements are linear in those of the normalised matrix.
    spread = np.zeros((9, 9))
    spread[:8, :8] = onto[0, 0] ** 2 * np.linalg.pinv(solved.jac.T @ solved.jac)
    turn = np.kron(back, into.T)
    return back @ found @ into, turn @ spread @ turn.T


def reading_error(matrix: FloatArray, spread: FloatArray, places: FloatArray) -> FloatArray:
    """Deviation in px at places (n, 2) of a view whose marks are read to 1 px, (n,)."""
    whole = np.hstack([places, np.ones((len(places), 1))])
    weight = (whole @ matrix[2])[:, None]
    seen, none = mapped(matrix, places), np.zeros_like(whole)
    by_u = np.hstack([whole, none, -seen[:, :1] * whole]) / weight
    by_v = np.hstack([none, whole, -seen[:, 1:] * whole]) / weight
    variance = sum(np.einsum("ni,ij,nj->n", by, spread, by) for by in (by_u, by_v))
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def _normaliser(places: FloatArray) -> FloatArray:
    """Moves the places' middle to 0 and scales their mean distance from it to √2, (3, 3)."""
    middle = places.mean(axis=0)
    scale = np.sqrt(2.0) / max(float(np.hypot(*(places - middle).T).mean()), 1e-12)
    return np.array([
        [scale, 0.0, -scale * middle[0]], [0.0, scale, -scale * middle[1]], [0.0, 0.0, 1.0],
    ])  # fmt: skip
