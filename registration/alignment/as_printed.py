"""Explain a misfit by how the print went: it ended early, or layers were shifted sideways."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Protocol

import numpy as np
from manifold3d import Manifold
from numpy.typing import NDArray

from design.solids import Solid
from design.solids.manifolds import solid_manifold, unite
from kernels.arrays import BoolArray, FloatArray
from registration.alignment.align import Alignment
from registration.alignment.choice import thin_points
from registration.alignment.distance import ModelSurface, distance_grid
from registration.alignment.fit import RIGID, Fit, FitFreedom, linearised, refine
from registration.alignment.search import AlignmentOptions, Search
from registration.errors import AlignmentError
from registration.segmentation.volume import GelField, sample

KERNEL_MM: Final = 0.1
"""Distance from the design at which a point of the scan counts half as a misfit."""
SOUND: Final = 0.05
"""Mean misfit below which nothing needs an explanation: walls within 20 µm of the design."""
FITS: Final = 0.1
"""Mean misfit that an explanation may leave: sound prints have 0.02 to 0.05 by themselves."""
EXPLAINED: Final = 0.6
"""Of the misfit, what an explanation may leave. By few scans: two of sound prints left 0.92 and
0.94, six of prints that ended early or whose layers were shifted 0.03 to 0.25, and two of another
part 0.75 and 0.85 (with a misfit of 0.7)."""
POINTS: Final = 6000
SHIFT_RANGE_MM, SHIFT_STEP_MM = 1.5, 0.1
SLABS: Final = 40
FEWEST_SLABS: Final = 2
"""Of the height, on either side of a change: fewer are a face's roughness."""
SETTLED_MM: Final = 0.02
ROUNDS: Final = 3
LEAST_SHIFT_MM: Final = 0.05
"""A shift whose 95 % interval reaches below this isn't one."""
CLUSTER_MM: Final = 1.0
"""Errors of walls nearer to each other than this are correlated, and count as one."""
POSES: Final = 4
UPRIGHT: Final = 0.9
"""Cosine between the normal of a print's top and the vertical, at least."""


@dataclass(frozen=True)
class LayerShift:
    """A band of layers that stands aside.

    Attributes
    ----------
    from_mm, to_mm : float, mm
        Heights in the part; `to_mm` is inf where the band reaches the top.
    shift_mm, interval_mm : (2,) float64, mm
        Along x and y, and half widths of the 95 % intervals.
    """

    from_mm: float
    to_mm: float
    shift_mm: FloatArray
    interval_mm: FloatArray

    def holds(self, z: FloatArray) -> BoolArray:
        """Whether heights (n,), mm, belong to the band."""
        return np.asarray((z >= self.from_mm) & (z < self.to_mm))

    def is_close(self, other: LayerShift) -> bool:
        """Whether band and shift are the same within `SETTLED_MM`."""
        mine = [self.from_mm, self.to_mm, *self.shift_mm]
        return np.allclose(mine, [other.from_mm, other.to_mm, *other.shift_mm], 0, SETTLED_MM)

    @property
    def size_mm(self) -> tuple[float, float]:
        """How far aside, and the half width of its 95 % interval, mm."""
        size = float(np.hypot(*self.shift_mm))
        return size, float(np.abs(self.shift_mm) @ self.interval_mm) / max(size, 1e-9)


@dataclass(frozen=True)
class AsPrinted:
    """What became of a print, as far as that explains a misfit.

    Attributes
    ----------
    ends_mm : float or None, mm
        Height at which it ends, where that is before the design's.
    missing_mm : float, mm
        How far that is below the design's top.
    shift : LayerShift or None
    """

    ends_mm: float | None = None
    missing_mm: float = 0.0
    shift: LayerShift | None = None

    @property
    def is_known(self) -> bool:
        """Whether there is anything to tell."""
        return self.ends_mm is not None or self.shift is not None


@dataclass(frozen=True)
class Explanation:
    """An alignment to the design as it was printed.

    Attributes
    ----------
    alignment : Alignment
    surface : ModelSurface
        Of the design as it was printed.
    printed : AsPrinted
    """

    alignment: Alignment
    surface: ModelSurface
    printed: AsPrinted


class Align(Protocol):
    """Align the scan to a model."""

    def __call__(self, surface: ModelSurface) -> Alignment:
        """Return the pose; AlignmentError where there is none."""


@dataclass(frozen=True)
class Misfit:
    """A scan and the design that it may not fit.

    Attributes
    ----------
    model : Solid
    surface : ModelSurface
        Of the model.
    points : (n, 3) float64, mm
        The scanned surface, in the scan's frame.
    field : GelField
    is_lumen : bool
        The model is the lumens, not the gel around them.
    align : Align
    options : AlignmentOptions
    """

    model: Solid
    surface: ModelSurface
    points: FloatArray
    field: GelField
    is_lumen: bool
    align: Align
    options: AlignmentOptions

    def explained(self, plain: Alignment | None) -> Explanation | None:
        """Return how the print went, where that explains most of what doesn't fit.

        Parameters
        ----------
        plain : Alignment or None
            To the whole design; None where there was none.
        """
        before = 1.0 if plain is None else self._loss(self.surface, plain.scaled)
        if before < SOUND:
            return None
        found = [one for one in (self._ended(), self._shifted(plain)) if one is not None]
        left = [self._loss(one.surface, one.alignment.scaled) for one in found]
        best = int(np.argmin(left)) if left else 0
        return found[best] if left and left[best] < min(EXPLAINED * before, FITS) else None

    @cached_property
    def _manifold(self) -> Manifold:
        return solid_manifold(self.model, "the model")

    @cached_property
    def _some(self) -> FloatArray:
        return thin_points(self.points, POINTS)

    def _loss(self, surface: ModelSurface, fit: Fit) -> float:
        return float(_misfit(surface.query(fit.apply(self._some)).distance).mean())

    def _aligned(self, solid: Manifold) -> tuple[ModelSurface, Alignment] | None:
        mesh = solid.to_mesh64()
        corners = np.asarray(mesh.vert_properties[:, :3], dtype=np.float64)
        surface = ModelSurface.of(Solid(corners, np.asarray(mesh.tri_verts, dtype=np.int32)))
        try:
            return surface, self.align(surface)
        except AlignmentError:
            return None

    # The print ended early.

    def _ended(self) -> Explanation | None:
        """The design up to the height at which it has as much gel as the scan."""
        low, high = self.surface.bounds[:, 2]
        if self.is_lumen:
            return None
        end = self._height_of(self._gel_mm3())
        for _ in range(ROUNDS):
            if not low < end < high - SETTLED_MM:
                return None
            found = self._aligned(self._below(end))
            if found is None:
                return None
            surface, alignment = found
            before, end = end, self._top(surface, alignment.scaled, end)
            if abs(end - before) < SETTLED_MM:
                break
        return Explanation(alignment, surface, AsPrinted(end, float(high) - end))

    def _top(self, surface: ModelSurface, fit: Fit, end: float) -> float:
        """Height of the scanned top, mm, where all else lies on the whole design.

        Else a stretch along z would make up for a wrong height.
        """
        near = surface.query(fit.apply(self._some))
        top = (near.foot[:, 2] > end - 1e-6) & (np.abs(near.direction[:, 2]) > UPRIGHT)
        if not top.any() or top.all():
            return end
        across = np.array([*fit.stretch[:2], fit.stretch[:2].mean()])
        start = replace(fit, stretch=across)
        rest = refine(self.surface, self._some[~top], start, FitFreedom((0, 1), True))
        return float(np.median(rest.apply(self._some[top])[:, 2]))

    def _below(self, height: float) -> Manifold:
        return self._manifold.trim_by_plane((0.0, 0.0, -1.0), -height)

    def _gel_mm3(self) -> float:
        field = self.field
        gel = np.count_nonzero(field.sign * field.values > field.level)
        return float(gel * np.prod(field.voxel_mm))

    def _height_of(self, volume_mm3: float) -> float:
        """Height up to which the design has a volume, by bisection."""
        low, high = self.surface.bounds[:, 2]
        for _ in range(16):
            middle = (low + high) / 2
            enough = self._below(middle).volume() > volume_mm3
            low, high = (low, middle) if enough else (middle, high)
        return float(low)

    # Layers were shifted.

    def _shifted(self, plain: Alignment | None) -> Explanation | None:
        """The design with a band of layers moved aside."""
        shift = self._likeliest(plain)
        if shift is None:
            return None
        for _ in range(ROUNDS):
            found = self._aligned(self._with(shift))
            if found is None:
                return None
            surface, alignment = found
            better = self._measured(shift, surface, alignment.scaled)
            settled = better.is_close(shift)
            shift = better
            if settled:
                break
        size, half = shift.size_mm
        if size - half < LEAST_SHIFT_MM:
            return None
        return Explanation(alignment, surface, AsPrinted(shift=shift))

    def _with(self, shift: LayerShift) -> Manifold:
        """The design with the band moved."""
        below, rest = self._split(self._manifold, shift.from_mm)
        band, above = self._split(rest, shift.to_mm)
        x, y = shift.shift_mm.tolist()
        return unite([below, band.translate((x, y, 0.0)), above])

    @staticmethod
    def _split(solid: Manifold, height: float) -> tuple[Manifold, Manifold]:
        if not np.isfinite(height):
            return solid, Manifold()
        above, below = solid.split_by_plane((0.0, 0.0, 1.0), height)
        return below, above

    def _likeliest(self, plain: Alignment | None) -> LayerShift | None:
        """The band and the shift that explain most, of all poses that may be the right one."""
        grid = distance_grid(self.surface, SHIFT_RANGE_MM + 1.0, KERNEL_MM, most=600_000)
        poses = [] if plain is None else [plain.scaled]
        if plain is None or self._loss(self.surface, plain.scaled) > 2 * FITS:
            poses += Search(self.surface, grid, self.options).poses(self._some, POSES)
        found = []
        for pose in poses:
            places = pose.apply(self._some)

            def under(moved: FloatArray) -> FloatArray:
                where = (moved - grid.origin_mm) / grid.step_mm
                return _misfit(sample(grid.values, np.ascontiguousarray(where)))

            loss, shift = _best_band(places, under)
            found.append((loss, shift))
        return min(found, key=lambda one: one[0])[1] if found else None

    def _measured(self, shift: LayerShift, surface: ModelSurface, fit: Fit) -> LayerShift:
        """The shift by least squares beside the pose, and the band's ends by the points' heights.

        The covariance is that of clusters (Liang & Zeger 1986, 10.1093/biomet/73.1.13).
        """
        points = thin_points(self.points, 4 * POINTS)
        places = fit.apply(points)
        now = linearised(surface, points, fit, replace(RIGID, offset=True))
        band = shift.holds(places[:, 2])[:, None]
        jacobian = np.hstack([now.jacobian, -now.direction[:, :2] * band])
        weighted = jacobian * now.weight[:, None]
        normal = weighted.T @ jacobian + 1e-9 * np.eye(jacobian.shape[1])
        step = -np.linalg.solve(normal, weighted.T @ now.residual)
        left = now.residual + jacobian @ step
        _, cluster = np.unique(np.floor(places / CLUSTER_MM), axis=0, return_inverse=True)
        sums = np.zeros((cluster.max() + 1, jacobian.shape[1]))
        np.add.at(sums, cluster.reshape(-1), weighted * left[:, None])
        inverse = np.linalg.inv(normal)
        covariance = inverse @ (sums.T @ sums) @ inverse
        moved = shift.shift_mm + step[-2:]
        half = 1.96 * np.sqrt(np.maximum(np.diag(covariance)[-2:], 0.0))
        return self._ends_found(LayerShift(shift.from_mm, shift.to_mm, moved, half), places)

    def _ends_found(self, shift: LayerShift, places: FloatArray) -> LayerShift:
        """The heights between which points fit the moved design better than the design."""
        order = np.argsort(places[:, 2])
        z = places[order, 2]
        back = places[order] - np.array([*shift.shift_mm, 0.0])
        gain = _misfit(self.surface.query(back).distance) - _misfit(
            self.surface.query(places[order]).distance
        )
        upto = np.concatenate([[0.0], np.cumsum(gain)])
        # The band's loss is upto[last] - upto[first]; the best beginning of each end is kept.
        before = np.maximum.accumulate(upto)
        last = int(np.argmin(upto - before))
        first = int(np.argmax(upto[: last + 1]))
        edge = np.ptp(z) / SLABS * FEWEST_SLABS
        to = np.inf if z[last - 1] > z[-1] - edge else float(z[last - 1])
        return replace(shift, from_mm=float(z[first]), to_mm=to)


def _misfit(distance: NDArray[np.floating]) -> FloatArray:
    """Loss of Geman & McClure, 0 to 1; 1 where nothing is known."""
    square = np.asarray(distance, dtype=np.float64) ** 2
    return np.nan_to_num(square / (square + KERNEL_MM**2), nan=1.0)


class _Under(Protocol):
    def __call__(self, moved: FloatArray) -> FloatArray: ...


def _best_band(places: FloatArray, under: _Under) -> tuple[float, LayerShift]:
    """The least mean loss of a band that moves aside, and that band.

    Slabs of equal height are tried under every shift; a band is any run of slabs, and it and the
    rest each take the shift that suits them best.
    """
    z = places[:, 2]
    low, high = np.percentile(z, (0.5, 99.5))
    edges = np.linspace(low, high, SLABS + 1)
    slab = np.clip(np.searchsorted(edges, z, side="right") - 1, 0, SLABS - 1)
    shifts = np.array(list(_shifts()))
    table = np.array(
        [
            np.bincount(slab, under(places - np.array([*shift, 0.0])), minlength=SLABS)
            for shift in shifts
        ]
    )
    upto = np.hstack([np.zeros((len(shifts), 1)), np.cumsum(table, axis=1)])
    best = (np.inf, 0, 0, 0, 0)
    for first, last in _bands():
        band = upto[:, last] - upto[:, first]
        rest = upto[:, -1] - band
        b, r = int(np.argmin(band)), int(np.argmin(rest))
        best = min(best, (float(band[b] + rest[r]), first, last, b, r))
    loss, first, last, b, r = best
    moved = shifts[b] - shifts[r]
    to = np.inf if last == SLABS else float(edges[last])
    return loss / len(z), LayerShift(float(edges[first]), to, moved, np.zeros(2))


def _bands() -> Iterator[tuple[int, int]]:
    """Runs of slabs that leave others below them."""
    for first in range(FEWEST_SLABS, SLABS - FEWEST_SLABS + 1):
        for last in range(first + FEWEST_SLABS, SLABS + 1):
            if last == SLABS or last <= SLABS - FEWEST_SLABS:
                yield first, last


def _shifts() -> Iterator[Sequence[float]]:
    steps = np.arange(-SHIFT_RANGE_MM, SHIFT_RANGE_MM + SHIFT_STEP_MM / 2, SHIFT_STEP_MM)
    for x in steps:
        for y in steps:
            yield float(x), float(y)
