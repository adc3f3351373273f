"""Model of ink's profile across a line, fitted to a view.

A view is modelled as ground plus, for each line that passes a pixel, its share of ink times a
profile over the distance from its middle (superposition: exact for the logarithm of light through
translucent ink by Beer and Lambert's law, and for the cover of blurred lines that touch). A profile
is a piecewise linear function of distance with five parts: even in distance; odd, times the two
components of the line's normal (slopes lit from one side: Lambert's cosine law to first order); and
even, times cosine and sine of twice its direction (rims that mirror light from one side). Fresh ink
over the ground, fresh ink over older ink, and older ink have profiles of their own. They are found
by weighted least squares over all pixels at once.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import BoolArray, FloatArray, IntArray
from kernels.compile import jit
from printctl.inspection.ink.passes import REACH_WIDTHS, Passes
from printctl.inspection.path_samples import PathSamples, from_stroke_begin
from printctl.inspection.values import ExpectedLines, FloatImage

NODES: Final = 15
"""Nodes of a profile, a tenth of a width apart, from the middle to the reach, where it is 0."""
PARTS: Final = 5
"""Parts of a profile: even, two odd, two even by direction."""
EVEN: Final = (0, 3, 4)
ODD: Final = (1, 2)
CLASSES: Final = 3
"""Classes of ink with a profile each."""
_OLDER_CLASS: Final = 2
"""Class of older ink; 0 is fresh ink over ground, 1 fresh ink over older ink."""
_GROUP_SUMS: Final = ((0, 1, 2), (1, 2), (0, 2))
"""Groups of places whose sums are added: all; those that judge group 0, and group 1."""
_MAX_FITTED_PX: Final = 150_000
"""Largest number of fitted pixels near lines; of more, an evenly spread part."""
_ROW_SKEW_PX: Final = 7
"""Offset of a row's fitted pixels against the last row's."""
_MIN_DRAWN_NOISES: Final = 1e-4
"""Size of profile parts below which they aren't rendered, in the ground's noise."""
_UNKNOWN_COUNT: Final = CLASSES * PARTS * NODES
_RIDGE_SHARES: Final = (1e-3, 1e-2, 1e-2, 1e-2, 1e-2)
"""Ridge of each part, relative to the largest power of a node."""
_KNOWN_RIDGE_FACTOR: Final = 100.0
"""Factor on the ridge of a profile known from an earlier look or the layer's height."""
_CLASS_RIDGE_FACTORS: Final = (1.0, 10.0, 0.01)
"""Factor on the ridge by class: where fresh ink lies over older ink only, the older explains it."""
_EDGE_WIDTHS, _EDGE_BLUR_WIDTHS = 0.5, 0.15
"""Distance of a line's edge from its middle, and half of its blur, in widths."""
_BESIDE_RIDGE_FACTOR: Final = 30.0
"""Factor on the ridge beyond a line's edge, so that lines that touch share little there."""
_CORRELATION_NODES: Final = 1.5
"""Correlation length of the prior profile, in nodes."""
_ABSENT_PART_RIDGE: Final = 1e6
"""Ridge of parts that are absent."""
_CURVATURE_RIDGE: Final = 3e-3
"""Ridge on second differences along a profile."""


@dataclass(frozen=True)
class InkModel:
    """Profiles of ink in each channel.

    Attributes
    ----------
    profile : (3, 5, 16, c) float64
        By class, part, node of distance.
    node_covariance : (3, 16, 16) float64
        Covariance of even parts' nodes, by class; mean of all channels.
    """

    profile: FloatArray
    node_covariance: FloatArray = field(
        default_factory=lambda: np.zeros((CLASSES, NODES + 1, NODES + 1))
    )

    def covariance_across(self, which: int, distance: FloatArray) -> FloatArray:
        """Return the covariance (u, u) of a class's full ink at distances (u,), widths."""
        size = np.minimum(np.abs(distance) * (NODES / REACH_WIDTHS), NODES - 1e-9)
        low = size.astype(np.int64)
        hat = np.zeros((len(distance), NODES + 1))
        row = np.arange(len(distance))
        hat[row, low], hat[row, low + 1] = 1.0 - (size - low), size - low
        return np.asarray(hat @ self.node_covariance[which] @ hat.T)

    @staticmethod
    def cover(height: float) -> InkModel:
        """Return fresh ink of one ``height`` over a line's width, 0 beside it."""
        profile = np.zeros((CLASSES, PARTS, NODES + 1, 1))
        profile[:2, 0, :, 0] = height * cover_at(np.arange(NODES + 1) * (REACH_WIDTHS / NODES))
        return InkModel(profile)

    def at(self, which: int, distance: FloatArray, normal: FloatArray) -> FloatArray:
        """Return the profile of a class, (n, u, c).

        At distances (u,), widths, towards normals (n, 2), unit vectors in the picture.
        """
        size = np.minimum(np.abs(distance) * (NODES / REACH_WIDTHS), NODES - 1e-9)
        low = size.astype(np.int64)
        part = (size - low)[:, None]
        weight = _weights(normal)
        sign = np.where(distance < 0, -1.0, 1.0)
        total = np.zeros((len(normal), len(distance), self.profile.shape[3]))
        for k, nodes in enumerate(self.profile[which]):
            own = nodes[low] * (1 - part) + nodes[low + 1] * part
            odd = sign[:, None] if k in ODD else 1.0
            total += weight[k][:, None, None] * odd * own
        return total

    def parts(self) -> IntArray:
        """Return the indices of the parts that profiles have."""
        return np.flatnonzero(np.abs(self.profile).max(axis=(0, 2, 3)) > _MIN_DRAWN_NOISES)

    def render(self, passes: Passes, over: FloatImage, share: ShareOfPiece) -> FloatImage:
        """Return the modelled ink, (h, w, c), 0 where there is only ground."""
        out = np.zeros((*passes.number.shape, self.profile.shape[3]), dtype=np.float32)
        _draw(passes, over, share, self.parts(), np.ascontiguousarray(self.profile), out)
        return out


class ShareOfPiece(NamedTuple):
    """Share of ink along fresh pieces, by their sample points.

    Attributes
    ----------
    kind : (n,) int64
        0 of the layer, 1 older.
    first, sample_count : (n,) float64
        Number of the place where a piece begins, and places along it.
    low, high : (n,) int64
        First and last place of its run.
    value : (m,) float64
        Share at each place; one more at the end, for older pieces.
    """

    kind: IntArray
    first: FloatArray
    sample_count: FloatArray
    low: IntArray
    high: IntArray
    value: FloatArray

    @staticmethod
    def along(samples: PathSamples, lines: ExpectedLines, value: FloatArray) -> ShareOfPiece:
        """Assign the shares (m - 1,) of sample points to the pieces they lie on."""
        count, n = len(samples), len(lines)
        length = np.linalg.norm(lines.end - lines.start, axis=1)
        begin = from_stroke_begin(lines.stroke, length)
        first, sample_count = np.full(n, float(count)), np.zeros(n)
        low = np.full(n, count)
        high = low.copy()
        starts = np.flatnonzero(np.concatenate([[True], np.diff(samples.run) != 0]))
        for a, past in zip(starts, np.append(starts[1:], count), strict=True):
            rows = np.arange(samples.piece[a], samples.piece[past - 1] + 1)
            zero = samples.along[a] - 0.5 * samples.step[a]
            first[rows] = a + (begin[rows] - zero) / samples.step[a]
            sample_count[rows] = length[rows] / samples.step[a]
            low[rows], high[rows] = a, past - 1
        kind = np.where(lines.fresh, 0, 1).astype(np.int64)
        return ShareOfPiece(kind, first, sample_count, low, high, np.append(value, 1.0))


@dataclass(frozen=True)
class CrossFit:
    """Profiles fitted to a whole view, and to each of two groups of places without it.

    A profile fitted to places explains them even where it is noise. So each group is judged by a
    profile fitted to the other group alone (cross-validation, Stone 1974).

    Attributes
    ----------
    whole : InkModel
    other : (InkModel, InkModel)
        For the places of group 0 and of group 1.
    """

    whole: InkModel
    other: tuple[InkModel, InkModel]


def fit_profiles(
    image: FloatImage,
    use: BoolArray,
    passes: Passes,
    over: FloatImage,
    share: ShareOfPiece,
    group: IntArray,
    parts: tuple[int, ...] = tuple(range(PARTS)),
    known: InkModel | None = None,
    plain: bool = True,
    inkless: int = 0,
    cell_px: float = 1.0,
) -> CrossFit:
    """Fit profiles to a view whose light is removed.

    Parameters
    ----------
    image : (h, w, c) float32
        0 where there is ground alone.
    use : (h, w) bool
        Pixels that are fitted.
    passes : Passes
    over : (h, w) float32
        Share of older ink, 0 to 1.
    share : ShareOfPiece
    group : (m,) int64
        Cross-fit group 0 or 1 of each place; 2 at the end, for pixels used by both.
    parts : tuple of int
        Indices of the parts that profiles may have.
    known : InkModel or None
        Prior mean of the profiles.
    plain : bool
        Whether the prior mean is a cover of the line's width otherwise, and not 0.
    inkless : int
        Number of first channels without fresh ink, from the picture before.
    cell_px : float
        Pixels per independent one.
    """
    channels = image.shape[2]
    every = 1 + int((passes.number > 0).sum()) // _MAX_FITTED_PX
    power = np.zeros((3, _UNKNOWN_COUNT, _UNKNOWN_COUNT))
    score = np.zeros((3, _UNKNOWN_COUNT, channels))
    _accumulate(image, use, passes, over, share, np.array(parts), every, group, power, score)
    power = power + np.tril(power, -1).transpose(0, 2, 1)
    sums = [(power[list(k)].sum(axis=0), score[list(k)].sum(axis=0)) for k in _GROUP_SUMS]
    whole, *other = (_solve(*one, parts, known, plain, inkless) for one in sums)
    seen = use & (passes.number > 0)
    square = float((image[seen][:, inkless:] ** 2).sum()) / every
    left = square - float((_flat(whole)[:, inkless:] * sums[0][1][:, inkless:]).sum())
    noise = max(left, 0.0) * every / max(float(seen.sum()) * (channels - inkless), 1.0)
    scale = max(noise, 1e-9) * max(1.0, cell_px / every)
    return CrossFit(_with_covariance(whole, sums[0][0] / scale, inkless), (other[0], other[1]))


def _flat(model: InkModel) -> FloatArray:
    return model.profile[:, :, :-1].reshape(_UNKNOWN_COUNT, -1)


def _with_covariance(model: InkModel, power: FloatArray, inkless: int) -> InkModel:
    """Add the covariance of even nodes to a model.

    ``power`` (u, u) is the view's normal matrix over its noise.
    """
    shown = model.profile[:, 0, : NODES // 2, inkless:]
    size = np.maximum((shown**2).mean(axis=(1, 2)), 1e-6)
    apart = np.abs(np.subtract.outer(np.arange(NODES), np.arange(NODES)))
    alike = np.exp(-0.5 * (apart / _CORRELATION_NODES) ** 2) + 1e-3 * np.eye(NODES)
    node_covariance = np.zeros((CLASSES, NODES + 1, NODES + 1))
    even = np.concatenate([np.arange(NODES) + k * PARTS * NODES for k in range(CLASSES)])
    information = power[np.ix_(even, even)]
    before = np.zeros_like(information)
    for k in range(CLASSES):
        own = slice(k * NODES, (k + 1) * NODES)
        before[own, own] = np.linalg.inv(size[k] * alike)
    whole = np.linalg.inv(information + before)
    for k in range(CLASSES):
        own = slice(k * NODES, (k + 1) * NODES)
        node_covariance[k, :NODES, :NODES] = whole[own, own]
    return replace(model, node_covariance=node_covariance)


def _solve(
    power: FloatArray,
    score: FloatArray,
    parts: tuple[int, ...],
    known: InkModel | None,
    plain: bool,
    inkless: int,
) -> InkModel:
    """Solve normal equations (u, u), (u, c) with the prior."""
    channels = score.shape[1]
    prior = _prior(power, parts) * (1.0 if known is None else _KNOWN_RIDGE_FACTOR)
    mean = _fit_covers(power, score) if plain else np.zeros_like(score)
    if known is not None:
        mean = known.profile[:, :, :-1].reshape(_UNKNOWN_COUNT, channels)
    solved = np.linalg.solve(power + prior, score + prior @ mean)
    if inkless:
        older = slice(_OLDER_CLASS * PARTS * NODES, None)
        own = power[older, older] + prior[older, older]
        solved[:, :inkless] = 0.0
        solved[older, :inkless] = np.linalg.solve(own, score[older, :inkless])
    nodes = solved.reshape(CLASSES, PARTS, NODES, channels)
    return InkModel(np.concatenate([nodes, np.zeros((CLASSES, PARTS, 1, channels))], axis=2))


def cover_at(distance: NDArray[Any]) -> NDArray[Any]:
    """Return the cover of a line with blurred edges at distances, widths."""
    return np.clip(
        (_EDGE_WIDTHS + _EDGE_BLUR_WIDTHS - np.abs(distance)) / (2.0 * _EDGE_BLUR_WIDTHS), 0.0, 1.0
    )


def _fit_covers(power: FloatArray, score: FloatArray) -> FloatArray:
    """Return the even profile of a cover of the line's width, scaled by least squares.

    Lines that touch determine only the sum of a profile's copies a pitch apart.
    """
    basis = np.zeros((_UNKNOWN_COUNT, CLASSES))
    cover = cover_at(np.arange(NODES) * (REACH_WIDTHS / NODES))
    for k in range(CLASSES):
        first = k * PARTS * NODES
        basis[first : first + NODES, k] = cover
    own = basis.T @ power @ basis
    scale = max(float(np.trace(own)) / CLASSES, 1e-9)
    own += scale * np.diag(np.array(_CLASS_RIDGE_FACTORS) * _RIDGE_SHARES[0])
    return np.asarray(basis @ np.linalg.solve(own, basis.T @ score))


def _prior(power: FloatArray, parts: tuple[int, ...]) -> FloatArray:
    """Return the prior's precision: ridges towards 0 and on curvature, (u, u)."""
    usual = max(float(np.diag(power).max()), 1.0)  # pixels
    bend = np.zeros((NODES, NODES))
    for j in range(1, NODES):
        row = np.zeros(NODES)
        row[j - 1], row[j] = 1.0, -2.0
        if j + 1 < NODES:
            row[j + 1] = 1.0
        bend += np.outer(row, row)
    at = np.arange(NODES) * (REACH_WIDTHS / NODES)
    beside = np.diag(
        np.where(at > _EDGE_WIDTHS + 1.5 * _EDGE_BLUR_WIDTHS, _BESIDE_RIDGE_FACTOR, 1.0)
    )
    prior = np.zeros_like(power)
    for k in range(CLASSES * PARTS):
        own = slice(k * NODES, (k + 1) * NODES)
        own_part, which = k % PARTS, k // PARTS
        stiff = (
            _RIDGE_SHARES[own_part] * _CLASS_RIDGE_FACTORS[which]
            if own_part in parts
            else _ABSENT_PART_RIDGE
        )
        prior[own, own] = usual * (stiff * beside + _CURVATURE_RIDGE * bend)
    return prior


def _weights(normal: FloatArray) -> tuple[FloatArray, ...]:
    """Return the factor of each part of a profile, (n,) each."""
    x, y = normal.T
    return np.ones(len(normal)), x, y, x * x - y * y, 2.0 * x * y


@jit
def _sample_index(share: ShareOfPiece, k: int, t: float) -> int:
    """Return the sample point at a share of the way along a piece."""
    at = int(share.first[k] + t * share.sample_count[k])
    return int(min(max(at, share.low[k]), share.high[k]))


@jit
def _terms(
    y: int,
    x: int,
    passes: Passes,
    over: float,
    share: ShareOfPiece,
    parts: IntArray,
    index: IntArray,
    weight: FloatArray,
) -> int:
    """Fill ``index`` and ``weight`` with a pixel's unknowns and factors; return their number."""
    n = 0
    for m in range(passes.number[y, x]):
        d = passes.distance[y, x, m]
        size = abs(d) * (NODES / REACH_WIDTHS)
        j = int(size)
        if j >= NODES:
            continue
        f = size - j
        sign = -1.0 if d < 0 else 1.0
        u, v = passes.normal[y, x, m, 0], passes.normal[y, x, m, 1]
        k = passes.piece[y, x, m]
        own = share.value[_sample_index(share, k, passes.part[y, x, m])]
        for c in range(CLASSES):
            if share.kind[k] == 0:
                amount = own * (1.0 - over if c == 0 else over) if c < 2 else 0.0
            else:
                amount = 1.0 if c == 2 else 0.0
            if amount == 0.0:
                continue
            for p in parts:
                w = amount
                if p == 1:
                    w *= sign * u
                elif p == 2:
                    w *= sign * v
                elif p == 3:
                    w *= u * u - v * v
                elif p == 4:
                    w *= 2.0 * u * v
                base = (c * PARTS + p) * NODES
                index[n] = base + j
                weight[n] = w * (1.0 - f)
                n += 1
                if j + 1 < NODES:
                    index[n] = base + j + 1
                    weight[n] = w * f
                    n += 1
    return n


@jit
def _accumulate(
    image: NDArray[Any],
    use: BoolArray,
    passes: Passes,
    over: NDArray[Any],
    share: ShareOfPiece,
    parts: IntArray,
    every: int,
    group: IntArray,
    power: FloatArray,
    score: FloatArray,
) -> None:
    """Accumulate each group's normal equations, lower half, over one in ``every`` pixels.

    A pixel is of the group of the nearest fresh line's place.
    """
    index = np.empty(200, dtype=np.int64)
    weight = np.empty(200)
    for y in range(image.shape[0]):
        for x in range(y * _ROW_SKEW_PX % every, image.shape[1], every):
            if not use[y, x] or passes.number[y, x] == 0:
                continue
            n = _terms(y, x, passes, over[y, x], share, parts, index, weight)
            own, least = 2, REACH_WIDTHS
            for m in range(passes.number[y, x]):
                k, away = passes.piece[y, x, m], abs(passes.distance[y, x, m])
                if share.kind[k] == 0 and away < least:
                    least = away
                    own = group[_sample_index(share, k, passes.part[y, x, m])]
            for a in range(n):
                ia, wa = index[a], weight[a]
                for b in range(a + 1):
                    twice = 2.0 if ia == index[b] and a != b else 1.0
                    power[own, max(ia, index[b]), min(ia, index[b])] += twice * wa * weight[b]
                for c in range(image.shape[2]):
                    score[own, ia, c] += wa * image[y, x, c]


@jit
def _draw(
    passes: Passes,
    over: NDArray[Any],
    share: ShareOfPiece,
    parts: IntArray,
    profile: FloatArray,
    out: NDArray[Any],
) -> None:
    """Render the lines' ink into each pixel."""
    index = np.empty(200, dtype=np.int64)
    weight = np.empty(200)
    for y in range(out.shape[0]):
        for x in range(out.shape[1]):
            if passes.number[y, x] == 0:
                continue
            n = _terms(y, x, passes, over[y, x], share, parts, index, weight)
            for a in range(n):
                row = index[a] // NODES
                for c in range(out.shape[2]):
                    own = profile[row // PARTS, row % PARTS, index[a] % NODES, c]
                    out[y, x, c] += weight[a] * own
