"""Draw candidate positions of new terminals by demand, or take those given by the user."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.errors import GrowthError, NoRoomError
from design.tissue import Tissue
from design.tissue.grid import GridArrays, read
from design.tissue.tissue import UniformDemand
from design.vasculature.growth.kernels.cost import Segments
from design.vasculature.growth.kernels.index import Clearances
from design.vasculature.options import GrowthOptions
from kernels import jit
from kernels.arrays import FloatArray

MIN_TERMINAL_FLOW = 0.05
"""Of a terminal, over the mean terminal's, where flows follow demand."""
MAX_NAMED_POINTS = 5
"""Points at most that a message names."""
_ONE_AT_A_TIME = Lock()
"""A demand may be read by a kernel of several threads, which can't be entered twice."""


class SamplingSettings(NamedTuple):
    """How many points are drawn at a time."""

    min_points: int = 4096
    per_terminal: float = 0.5
    """Points in the tissue over the terminals there are: few enough that a tree grown to them
    in order is like one grown in random order."""
    ordered_from: int = 10_000
    """Terminals from which points come in order; a smaller tree is in the cache in any case."""


SAMPLING = SamplingSettings()


@dataclass(frozen=True)
class Sampler:
    """Points in the tissue: uniform, or by the tissue's demand.

    Attributes
    ----------
    tissue : Tissue
    dense : bool
        Points are denser where the demand is higher, and let in as near to the tree as befits.
    flows : bool
        Points are uniform, and each terminal's flow follows the demand there.
    owns : function of (k, 3) float64 to (k,) bool, optional
        Which points lie in the tree's territory.
    corners : (m, 3) float64, mm, optional
        Lowest corners of the cells of a grid that points are drawn from, in place of the bounds.
    edge_mm : float
        Of a cell.
    """

    tissue: Tissue
    dense: bool
    flows: bool
    owns: Callable[[FloatArray], NDArray[np.bool_]] | None
    corners: FloatArray | None = None
    edge_mm: float = 0.0

    @classmethod
    def by(
        cls,
        tissue: Tissue,
        options: GrowthOptions,
        owns: Callable[[FloatArray], NDArray[np.bool_]] | None,
    ) -> Sampler:
        """As the options ask for."""
        flows = options.terminal_flow == "demand"
        uneven = not isinstance(tissue.demand, UniformDemand)
        return cls(tissue, uneven and options.follow_demand and not flows, flows, owns)

    @property
    def kept(self) -> float:
        """Part of the points inside that sampling by demand keeps."""
        return self.tissue.demand.mean_weight if self.dense else 1.0

    @property
    def volume_mm3(self) -> float:
        """Volume that points are drawn from."""
        if self.corners is not None:
            return len(self.corners) * self.edge_mm**3
        return float(np.prod(np.ptp(self.tissue.bounds, axis=0)))

    def none(self) -> Samples:
        """No points."""
        return plain_samples(np.empty((0, 3)))

    def draw(self, random: np.random.Generator, tries: int, in_order: bool) -> Samples:
        """Those of so many points that lie inside the tissue and are wanted."""
        if self.corners is None:
            low, high = self.tissue.bounds
            points = random.uniform(low, high, (tries, 3))
        else:
            low, high = self.corners.min(axis=0), self.corners.max(axis=0) + self.edge_mm
            cell = random.integers(len(self.corners), size=tries)
            points = self.corners[cell] + self.edge_mm * random.uniform(size=(tries, 3))
            in_order = True
        # Most points lie outside a thin tissue, and whose they are costs more to ask.
        points = inside(self.tissue.grid.arrays, points, low, high, in_order)
        if self.owns is not None:
            points = points[self.owns(points)]
        return self._weighed(random, points)

    def _weighed(self, random: np.random.Generator, points: FloatArray) -> Samples:
        """Those of some points inside the tissue that are wanted, with their flows."""
        if not (self.dense or self.flows):
            return plain_samples(points)
        with _ONE_AT_A_TIME:
            weight = self.tissue.demand.weight(points)
        mean = self.tissue.demand.mean_weight
        least = random.uniform(size=len(points)) if self.dense else np.zeros(len(points))
        wanted = weight > least
        points, share = points[wanted], weight[wanted] / mean
        ones = np.ones(len(points))
        if self.dense:
            return Samples(points, share ** (-1.0 / 3.0), ones)
        return Samples(points, ones, np.maximum(share, MIN_TERMINAL_FLOW))


@dataclass(frozen=True)
class GivenPoints:
    """Points that must all be reached.

    Attributes
    ----------
    at : (n, 3) float64, mm
    flow : (n,) float64
        Over the mean.
    stuck : (n,) int64
        In how many passes each couldn't be reached where none could.
    """

    at: FloatArray
    flow: FloatArray
    stuck: NDArray[np.int64]

    @classmethod
    def of(cls, tissue: Tissue, options: GrowthOptions) -> GivenPoints | None:
        """The options' points, or None.

        Raises
        ------
        GrowthError
            When some lie outside the tissue.
        """
        if options.terminal_points_mm is None:
            return None
        at = np.array(options.terminal_points_mm, dtype=np.float64)
        flow = np.ones(len(at))
        if options.terminal_flows is not None:
            flow = np.array(options.terminal_flows, dtype=np.float64)
        away = tissue.grid.distance(at)
        if (away >= 0.0).any():
            out = np.flatnonzero(away >= 0.0)
            raise GrowthError(
                f"{len(out)} of {len(at)} given terminals lie outside the tissue: "
                f"{named_points(at, out, away)} from it; move them inside, or check the file's unit"
            )
        return cls(at, flow / flow.mean(), np.zeros(len(at), dtype=np.int64))

    def missing(self, tips: FloatArray) -> NDArray[np.int64]:
        """Which points no tip (k, 3) has reached."""
        reached = {tip.tobytes() for tip in np.ascontiguousarray(tips)}
        return np.array(
            [n for n, point in enumerate(self.at) if point.tobytes() not in reached], dtype=np.int64
        )

    def samples(self, which: NDArray[np.int64]) -> Samples:
        """Some of the points as samples that must be reached."""
        return Samples(self.at[which], np.zeros(len(which)), self.flow[which])

    def stuck_on(self, which: NDArray[np.int64]) -> int:
        """Count a pass that reached none of ``which``; the most that any point has failed."""
        self.stuck[which] += 1
        return int(self.stuck.max())

    def unreached(self, which: NDArray[np.int64], tissue: Tissue) -> GrowthError:
        """The error that names the points of ``which`` that failed most, and how deep they lie."""
        which = which[2 * self.stuck[which] > self.stuck[which].max()]
        depth = -tissue.grid.distance(self.at)
        return GrowthError(
            f"{len(which)} of {len(self.at)} given terminals can't be joined: "
            f"{named_points(self.at, which, depth)} below the surface; move them apart or deeper, "
            "or ask for thinner vessels or less clearance"
        )


def named_points(at: FloatArray, which: NDArray[np.int64], away: FloatArray) -> str:
    """Number, place and distance (n,), mm, of the first few of ``which`` points (n, 3)."""
    parts = [
        f"number {n} at ({at[n, 0]:.4g}, {at[n, 1]:.4g}, {at[n, 2]:.4g}) mm, {away[n]:.3g} mm"
        for n in which[:MAX_NAMED_POINTS]
    ]
    more = len(which) - MAX_NAMED_POINTS
    return "; ".join(parts) + (f" (and {more} more)" if more > 0 else "")


def obstructing_segments(segments: Segments, points: FloatArray, most: int) -> NDArray[np.int64]:
    """Segments nearest to any of the points, ``most`` for each; of those that may go."""
    free = np.flatnonzero((segments["given"] == 0) & (segments["parent"] >= 0))
    begin, end = (
        np.column_stack([segments[f"{side}{axis}"] for axis in "xyz"])[free] for side in "pd"
    )
    way = end - begin
    size = np.maximum((way * way).sum(axis=1), 1e-300)
    near = []
    for point in points:
        along = np.clip(((point - begin) * way).sum(axis=1) / size, 0.0, 1.0)
        away = np.linalg.norm(point - begin - along[:, None] * way, axis=1)
        near.append(free[np.argsort(away, kind="stable")[:most]])
    return np.unique(np.concatenate(near))


def out_of_room(
    options: GrowthOptions,
    clearances: Clearances,
    reached: tuple[int, int],
    goal: int,
    root_radius: float,
    failed: int,
) -> NoRoomError:
    """Return the error that says how many terminals fit, and what might help.

    Parameters
    ----------
    reached : (int, int)
        Terminals grown, and those of them that are a given trunk's.
    goal : int
    root_radius : float, mm
        Fixed radius of the root, or 0.
    failed : int
        Points in a row that found no place.
    """
    terminals, of_trunk = reached
    smallest = options.smallest_radius_mm
    wide = f" of radius {smallest:g} mm or more" if smallest else ""
    reserved = (
        f" beside a trunk from {root_radius:.3g} mm radius, reserved because {goal} terminals "
        "need it"
    )
    limits = ", milder limits on angles or flows" if clearances.limits.on else ""
    hint = " (their thinner trunk leaves more room: more than here may then fit)"
    # Without a smallest radius all radii follow from the drop, and fewer terminals have as wide a
    # trunk.
    narrower = "a smaller smallest_diameter_mm" if smallest else "a higher pressure drop"
    return NoRoomError(
        f"only {terminals} of {goal} terminals{wide} fit with clearance "
        f"{clearances.clearance:g} mm{reserved if root_radius else ''}: "
        f"{failed} points in a row found no place",
        f"ask for {narrower} (narrower vessels), fewer "
        f"terminals{hint if root_radius else ''} or a smaller clearance{limits}",
        placed=terminals - of_trunk,
    )


class Samples(NamedTuple):
    """Points to grow to, as kernels take them.

    Attributes
    ----------
    at : (n, 3) float64, mm
    near : (n,) float64
        Least distance from the tree there over that for the mean demand; 0 for a point that must
        be reached.
    flow : (n,) float64
        Of a terminal there, over the mean terminal's.
    """

    at: NDArray[np.float64]
    near: NDArray[np.float64]
    flow: NDArray[np.float64]


def plain_samples(points: NDArray[np.float64]) -> Samples:
    """Points of equal demand and flow."""
    ones = np.ones(len(points))
    return Samples(points, ones, ones)


@jit
def inside(grid: GridArrays, points: Any, low: Any, high: Any, in_order: bool) -> Any:
    """Those of ``points`` (n, 3) inside the tissue.

    With ``in_order`` along a Z-order curve of 1024 cells a side, else in the order given.

    Sorted points visit the same part of the tree one after another: beyond some 100,000
    segments, growth in random order waits for memory most of the time.
    """
    kept = np.empty(len(points), np.int64)
    code = np.empty(len(points), np.int64)
    size = 0
    scale = 1024.0 / (high - low)
    for n in range(len(points)):
        p = points[n]
        if read(grid, p[0], p[1], p[2]) < 0.0:
            kept[size] = n
            value = 0
            for axis in range(3):
                value |= _spread_bits(int((p[axis] - low[axis]) * scale[axis])) << axis
            code[size] = value
            size += 1
    # Codes of points in the same cell differ in their last digits: the order has no ties.
    order = np.arange(size)
    if in_order:
        order = np.argsort(code[:size] * len(points) + kept[:size])
    result = np.empty((size, 3))
    for n in range(size):
        result[n] = points[kept[order[n]]]
    return result


@jit
def _spread_bits(value: int) -> int:
    """Bits of a number below 1024, two zeros between each."""
    value = min(max(value, 0), 1023)
    value = (value | (value << 16)) & 0x030000FF
    value = (value | (value << 8)) & 0x0300F00F
    value = (value | (value << 4)) & 0x030C30C3
    return (value | (value << 2)) & 0x09249249


def share_terminals(
    demand: FloatArray, least: NDArray[np.int64], terminals: int
) -> NDArray[np.int64]:
    """Share terminals by demand (largest remainders), each part at least its ``least``.

    Raises
    ------
    GrowthError
        When there are fewer than all the least together.
    """
    if terminals < least.sum():
        raise GrowthError(
            f"{terminals} terminals are fewer than the {int(least.sum())} inlets of the tissue's "
            f"parts; ask for {int(least.sum())} or more"
        )
    exact = demand * terminals
    count = np.maximum(np.floor(exact).astype(np.int64), least)
    while count.sum() < terminals:
        count[np.argmax(np.where(demand > 0, exact - count, -np.inf))] += 1
    while count.sum() > terminals:
        count[np.argmin(np.where(count > least, exact - count, np.inf))] -= 1
    return count
