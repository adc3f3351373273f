"""Check embedded G-code: each vessel continuous, as wide as designed, separate."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.network import VesselNetwork
from gcode.deposit.written import Strands
from kernels.arrays import FloatArray, IntArray, split_rows
from printctl.checks.lumens.lines import in_short_pieces
from printctl.checks.lumens.report import LumenReport, list_names, report_dict, report_lumens
from printctl.checks.lumens.stations import Openings, SectionStations, network_lumens

# A filament is taken to be sacrificial: the space that it fills is the lumen once it is washed out.
# A section across the vessel cuts each filament near it in a disc; the widest circle is the widest
# disc whose middle lies on the vessel, or wider where several overlap.
RAYS: Final = 32
STATIONS_AT_ONCE: Final = 20_000
PASSES: Final = 6
"""Discs that a ray may go through one after another."""
TOUCH_MM: Final = 1e-6


def measure_filaments(strands: Strands, stations: SectionStations) -> Openings:
    """Widest circle and written area of each station's section; 0 where nothing is written.

    Parameters
    ----------
    strands : Strands
    stations : SectionStations
        Of the designed vessels, in the printer's frame.
    """
    pieces = in_short_pieces(strands)
    middle = (pieces.start + pieces.end) / 2
    half = np.linalg.norm(pieces.end - pieces.start, axis=1) / 2
    reach = float((half + pieces.radius).max()) if len(pieces) else 0.0
    tree = cKDTree(middle) if len(pieces) else None
    diameter, area = np.zeros(len(stations)), np.zeros(len(stations))
    centre = stations.axis.copy()
    for rows in _chunks(len(stations)):
        if tree is None:
            break
        near = tree.query_ball_point(stations.axis[rows], reach + stations.limit[rows])
        count = np.array([len(some) for some in near])
        piece = np.concatenate([np.asarray(some, np.int64) for some in near])
        of = np.repeat(np.arange(len(rows)), count)
        discs = _discs(pieces, piece, stations, rows[of])
        diameter[rows], area[rows], centre[rows] = _widest(*discs, of, stations, rows)
    return Openings(diameter, centre, area)


def _chunks(count: int) -> Iterator[IntArray]:
    for first in range(0, count, STATIONS_AT_ONCE):
        yield np.arange(first, min(first + STATIONS_AT_ONCE, count))


def _discs(
    pieces: Strands, piece: IntArray, stations: SectionStations, row: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Disc in which each piece cuts its station's plane: middle (m, 3) from the axis, radius.

    Of the balls that make up the piece, the one where it passes the plane, or comes nearest to it.
    A piece along the plane is cut where it is nearest to the axis.
    """
    along = stations.along[row]
    begin = pieces.start[piece] - stations.axis[row]
    way = pieces.end[piece] - pieces.start[piece]
    off, rise = (begin * along).sum(axis=1), (way * along).sum(axis=1)
    flat = np.abs(rise) < TOUCH_MM
    square = np.maximum((way * way).sum(axis=1), TOUCH_MM**2)
    share = np.where(flat, -(begin * way).sum(axis=1) / square, -off / np.where(flat, 1.0, rise))
    share = np.clip(share, 0.0, 1.0)
    away = off + share * rise
    middle = begin + share[:, None] * way - away[:, None] * along
    return middle, np.sqrt(np.maximum(pieces.radius[piece] ** 2 - away**2, 0.0))


def _widest(
    middle: FloatArray,
    radius: FloatArray,
    of: IntArray,
    stations: SectionStations,
    rows: IntArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Diameter, area and centre of each station's open space."""
    offset = np.linalg.norm(middle, axis=1)
    on_axis = (radius > 0) & (offset <= stations.window[rows[of]])
    size = np.where(on_axis, radius, 0.0)
    best = np.lexsort((-offset, size, of))
    last = np.searchsorted(of[best], np.arange(len(rows)), side="right") - 1
    chosen = best[np.maximum(last, 0)] if len(best) else np.zeros(len(rows), np.int64)
    there = np.zeros(len(rows), bool)
    if len(best):
        there = (last >= 0) & (of[chosen] == np.arange(len(rows))) & on_axis[chosen]
    if not there.any():
        return np.zeros(len(rows)), np.zeros(len(rows)), stations.axis[rows]
    core = np.where(there[:, None], middle[chosen], 0.0)
    first = np.where(there, radius[chosen], 0.0)
    reach = _reaches(middle, radius, of, core, first, stations, rows)
    wide = np.where(there, 2 * np.maximum(first, reach.min(axis=1)), 0.0)
    area = np.where(there, np.pi * (reach**2).mean(axis=1), 0.0)
    return wide, area, stations.axis[rows] + core


def _reaches(
    middle: FloatArray,
    radius: FloatArray,
    of: IntArray,
    core: FloatArray,
    first: FloatArray,
    stations: SectionStations,
    rows: IntArray,
) -> FloatArray:
    """How far each ray from the core goes through overlapping discs, (k, RAYS), mm."""
    reach = np.repeat(first[:, None], RAYS, axis=1)
    others = np.flatnonzero((radius > 0) & ((middle != core[of]).any(axis=1)))
    if not len(others):
        return reach
    across, up = _axes(stations.along[rows])
    angle = 2 * np.pi * np.arange(RAYS) / RAYS
    who = of[others]
    gap = middle[others] - core[who]
    x, y = (gap * across[who]).sum(axis=1), (gap * up[who]).sum(axis=1)
    ahead = np.outer(x, np.cos(angle)) + np.outer(y, np.sin(angle))
    half = radius[others, None] ** 2 - (x**2 + y**2)[:, None] + ahead**2
    chord = np.sqrt(np.maximum(half, 0.0))
    enters, leaves = np.where(half > 0, ahead - chord, np.inf), ahead + chord
    most = stations.limit[rows]
    for _ in range(PASSES):
        before = reach.copy()
        goes_on = (enters <= reach[who] + TOUCH_MM) & (leaves > reach[who])
        np.maximum.at(reach, who, np.where(goes_on, leaves, 0.0))
        if np.array_equal(reach, before):
            break
    # An open neighbour's length isn't this vessel's width.
    capped: FloatArray = np.minimum(reach, np.maximum(most, first)[:, None])
    return capped


def _axes(along: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors across each way (k, 3)."""
    helper: NDArray[np.float64] = np.where(np.abs(along[:, 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0, 0])
    across = np.cross(along, helper)
    across /= np.linalg.norm(across, axis=1)[:, None]
    return across, np.cross(along, across)


APART_MM: Final = 0.02
"""Designed walls thinner than that are taken as meeting."""
STRAY_RADII: Final = 1.5
"""Farther from every designed axis, in designed radii, a filament is of no vessel."""
SAMPLE_MM: Final = 0.2


@dataclass(frozen=True)
class Merge:
    """Two vessels whose filaments merge.

    Attributes
    ----------
    vessels, trees : (int, int)
    at_mm : (3,) float64, mm
        In the filaments' frame.
    neck_mm : float, mm
        Width of the widest opening between them.
    """

    vessels: tuple[int, int]
    trees: tuple[int, int]
    at_mm: FloatArray
    neck_mm: float

    @property
    def across_trees(self) -> bool:
        """Whether blood would change from one tree to another."""
        return self.trees[0] != self.trees[1]

    def as_dict(self, place_mm: FloatArray) -> dict[str, Any]:
        """For JSON, in the part's frame."""
        return {
            "vessels": list(self.vessels),
            "trees": list(self.trees),
            "at_mm": (self.at_mm - place_mm).tolist(),
            "neck_mm": self.neck_mm,
        }


def find_merges(
    strands: Strands, network: VesselNetwork, place_mm: FloatArray, width_mm: float
) -> tuple[Merge, ...]:
    """Pairs of vessels whose filaments overlap by at least ``width_mm`` where the design doesn't.

    Of each pair the widest neck: the circle in which the two balls meet, or the thinner filament
    where one lies in the other.

    Parameters
    ----------
    strands : Strands
    network : VesselNetwork
        In the part's frame.
    place_mm : (3,) float64, mm
        The part's origin in the filaments' frame.
    width_mm : float, mm
    """
    pieces = in_short_pieces(strands)
    start, end, r0, r1, vessel = network.pieces()
    start, end, radius = start + place_mm, end + place_mm, np.maximum(r0, r1)
    owner = owners(pieces, start, end, radius)
    kept = np.flatnonzero(owner >= 0)
    one, other = _near(pieces, kept)
    apart = vessel[owner[one]] != vessel[owner[other]]
    one, other = one[apart], other[apart]
    away, at = segment_distances(
        pieces.start[one], pieces.end[one], pieces.start[other], pieces.end[other]
    )
    neck = necks(away, pieces.radius[one], pieces.radius[other])
    mine, its = owner[one], owner[other]
    designed, _ = segment_distances(start[mine], end[mine], start[its], end[its])
    new = (neck >= width_mm) & (designed - radius[mine] - radius[its] > APART_MM)
    worst: dict[tuple[int, int], int] = {}
    for k in np.flatnonzero(new)[np.argsort(neck[new], kind="stable")]:
        pair = sorted((int(vessel[mine[k]]), int(vessel[its[k]])))
        worst[(pair[0], pair[1])] = int(k)
    trees = network.tree
    return tuple(
        Merge(pair, (int(trees[pair[0]]), int(trees[pair[1]])), at[k], float(neck[k]))
        for pair, k in sorted(worst.items())
    )


def owners(pieces: Strands, start: FloatArray, end: FloatArray, radius: FloatArray) -> IntArray:
    """Piece of the design along which each filament's piece lies, (n,); -1 for none.

    The nearest axis, sampled every `SAMPLE_MM`; none where it is farther than `STRAY_RADII`.
    """
    length = np.linalg.norm(end - start, axis=1)
    count = np.maximum(np.ceil(length / SAMPLE_MM), 1).astype(np.int64)
    of, within = split_rows(count)
    samples = start[of] + ((within + 0.5) / count[of])[:, None] * (end - start)[of]
    away, nearest = cKDTree(samples).query((pieces.start + pieces.end) / 2)
    owner = of[nearest]
    far = away > STRAY_RADII * radius[owner] + SAMPLE_MM / 2
    return np.where(far, -1, owner).astype(np.int64)


def _near(pieces: Strands, kept: IntArray) -> tuple[IntArray, IntArray]:
    """Pairs of pieces that may touch."""
    nothing = np.zeros(0, np.int64)
    if len(kept) < 2:
        return nothing, nothing
    middle = (pieces.start + pieces.end)[kept] / 2
    half = np.linalg.norm((pieces.end - pieces.start)[kept], axis=1) / 2
    reach = half + pieces.radius[kept]
    pairs = cKDTree(middle).query_pairs(2 * float(reach.max()), output_type="ndarray")
    gap = np.linalg.norm(middle[pairs[:, 0]] - middle[pairs[:, 1]], axis=1)
    pairs = pairs[gap <= reach[pairs].sum(axis=1)]
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    return kept[pairs[:, 0]], kept[pairs[:, 1]]


def necks(away: FloatArray, one: FloatArray, other: FloatArray) -> FloatArray:
    """Width (n,) of the opening between two balls with middles ``away`` from each other, mm."""
    thin = np.minimum(one, other)
    inside = away <= np.abs(one - other)
    safe = np.where(inside, 1.0, away)
    plane = (safe**2 + one**2 - other**2) / (2 * safe)
    lens = np.sqrt(np.maximum(one**2 - plane**2, 0.0))
    return np.where(away >= one + other, 0.0, 2 * np.where(inside, thin, np.minimum(lens, thin)))


def segment_distances(
    a0: FloatArray, a1: FloatArray, b0: FloatArray, b1: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Least distance between straight pieces (n, 3), and the place midway, mm.

    Nearest points of the two lines, cut to the one piece, then to the other, and back (Ericson,
    Real-Time Collision Detection, 2005, section 5.1.9).
    """
    d, e, gap = a1 - a0, b1 - b0, a0 - b0
    dd, ee, de = (d * d).sum(axis=1), (e * e).sum(axis=1), (d * e).sum(axis=1)
    dg, eg = (d * gap).sum(axis=1), (e * gap).sum(axis=1)
    tiny = 1e-18
    spread = dd * ee - de**2
    s = np.where(spread > tiny, (de * eg - dg * ee) / np.where(spread > tiny, spread, 1.0), 0.0)
    s = np.clip(s, 0.0, 1.0)
    t = np.clip((de * s + eg) / np.maximum(ee, tiny), 0.0, 1.0)
    s = np.clip((de * t - dg) / np.maximum(dd, tiny), 0.0, 1.0)
    one, other = a0 + s[:, None] * d, b0 + t[:, None] * e
    return np.linalg.norm(one - other, axis=1), (one + other) / 2


MEANING: Final = (
    "written filaments are taken as sacrificial: the space that they fill is open once they are "
    "washed out"
)
NO_LIMIT_MM: Final = 1e9
JOINT_RADII: Final = 3.0
"""So far about a joint, in radii of its widest vessel, its vessels count as its own."""


@dataclass(frozen=True)
class FilamentCheck:
    """What was found; see `printctl.checks.lumens.check.LumenCheck` for layers.

    Attributes
    ----------
    ideal, stepped : LumenReport
        As written, and as the dry run's motors do it.
    merges : tuple of Merge
    joints : (j,) float64
        Opening of each joint's narrowest vessel over its design, after motor steps; 0 where a
        filament doesn't reach the other.
    filament_mm : float, mm
        Median diameter.
    passes : int
    place_mm : (3,) float64, mm
    left_out : frozenset of int
        Vessels that the plan says aren't written (``toolpath.leave_out``).
    """

    ideal: LumenReport
    stepped: LumenReport
    merges: tuple[Merge, ...]
    joints: FloatArray
    filament_mm: float
    passes: int
    place_mm: FloatArray
    left_out: frozenset[int] = frozenset()

    @property
    def refusal(self) -> str | None:
        """Why this mustn't be printed; None where all is well."""
        broken = np.flatnonzero(self.ideal.closed | self.stepped.closed)
        names = [self.ideal.names[k] for k in broken if k not in self.left_out]
        parts = []
        if names:
            parts.append(
                f"not written through: vessel {list_names(names)} ({len(names)} of "
                f"{len(self.ideal.names)})"
            )
        across = [merge for merge in self.merges if merge.across_trees]
        if across:
            pairs = [f"vessel {m.vessels[0]} with {m.vessels[1]}" for m in across]
            parts.append(f"filaments of two trees merge: {list_names(pairs)}")
        if not parts:
            return None
        return (
            f"{'; '.join(parts)}; plan it again with more overlap at the joints, a finer needle or "
            "more clearance"
        )

    @property
    def notes(self) -> list[str]:
        """What a person should look at."""
        notes = []
        within = [f"{m.vessels[0]} with {m.vessels[1]}" for m in self.merges if not m.across_trees]
        if within:
            notes.append(f"filaments of one tree merge beside their joints: {list_names(within)}")
        if 2 * int(self.ideal.closed.sum()) > len(self.ideal.names):
            notes.append(
                "most vessels aren't written: does the part stand where --place says, and is this "
                "its G-code?"
            )
        return notes

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        report = report_dict(self.ideal, self.stepped, ())
        across = sum(merge.across_trees for merge in self.merges)
        report["summary"] |= {
            "merges": len(self.merges),
            "merges_across_trees": across,
            "joints": len(self.joints),
            "joints_broken": int((self.joints <= 0).sum()),
            "joint_least": float(self.joints.min()) if len(self.joints) else None,
        }
        return {
            "passed": self.refusal is None,
            "method": "filaments",
            "meaning": MEANING,
            "filament_um": 1e3 * self.filament_mm,
            "passes": self.passes,
            **report,
            "merges": [merge.as_dict(self.place_mm) for merge in self.merges],
            "notes": self.notes,
        }


def check_filaments(
    ideal: Strands,
    stepped: Strands,
    network: VesselNetwork,
    place_mm: FloatArray,
    leak_mm: float,
    left_out: frozenset[int] = frozenset(),
) -> FilamentCheck:
    """Hold an embedded print's G-code against the network that it should write.

    Parameters
    ----------
    ideal, stepped : Strands
        As the file says, and as the dry run's motors do it.
    network : VesselNetwork
        In the part's frame.
    place_mm : (3,) float64, mm
        The part's origin in the printer's frame.
    leak_mm : float, mm
        Narrower openings between filaments are none.
    left_out : frozenset of int
        Vessels that aren't to be written: the plan left them out.
    """
    width = 2 * float(np.median(ideal.radius))
    stations = network_lumens(network, place_mm, NO_LIMIT_MM, NO_LIMIT_MM)
    after = measure_filaments(stepped, stations)
    return FilamentCheck(
        report_lumens(stations, measure_filaments(ideal, stations), None, place_mm),
        report_lumens(stations, after, None, place_mm),
        find_merges(ideal, network, place_mm, leak_mm),
        _joints(network, stations, after, place_mm),
        width,
        ideal.passes,
        place_mm,
        left_out,
    )


def _joints(
    network: VesselNetwork, stations: SectionStations, openings: Openings, place_mm: FloatArray
) -> FloatArray:
    """Opening over design at the narrowest of each joint's vessels, near the joint."""
    degree, ends = network.degree(), network.vessel_nodes[stations.lumen]
    least, widest = np.full(len(network.nodes), np.inf), np.zeros(len(network.nodes))
    share = np.minimum(openings.diameter / stations.designed_mm, 1.0)
    for side in (0, 1):
        np.maximum.at(widest, ends[:, side], stations.radius)
    for side in (0, 1):
        node = ends[:, side]
        away = np.linalg.norm(stations.axis - place_mm - network.nodes[node], axis=1)
        near = away <= JOINT_RADII * widest[node]
        np.minimum.at(least, node[near], share[near])
    chosen: FloatArray = least[(degree > 1) & np.isfinite(least)]
    return chosen
