"""Compare the predicted ink diameter along each vessel with its designed diameter."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.network import VesselNetwork
from gcode.bead.predict import Bead
from kernels.arrays import FloatArray, IntArray


def merge_bundles(diameters: VesselDiameters, owner: IntArray) -> VesselDiameters:
    """Strands as the vessels that they make up: areas add, the worst strand speaks for all.

    Parameters
    ----------
    diameters : VesselDiameters
        Of strands.
    owner : (s,) int64
        The vessel of each strand.
    """
    vessels, group = np.unique(owner[diameters.vessel], return_inverse=True)
    of = [np.flatnonzero(group == k) for k in range(len(vessels))]
    worst = np.array([rows[np.abs(diameters.worst[rows]).argmax()] for rows in of], dtype=np.int64)

    def equal(diameter: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.sqrt(np.bincount(group, diameter**2, len(vessels)))

    written = np.asarray(np.bincount(group, diameters.written_mm, len(vessels)), dtype=np.float64)

    def mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
        weighted = np.bincount(group, values * diameters.written_mm, len(vessels))
        return np.asarray(weighted / written)

    return VesselDiameters(
        vessel=vessels,
        written_mm=written,
        designed_mm=equal(diameters.designed_mm),
        predicted_mm=equal(diameters.predicted_mm),
        median=mean(diameters.median),
        worst=diameters.worst[worst],
        worst_at_mm=diameters.worst_at_mm[worst],
        worst_line=diameters.worst_line[worst],
        within=mean(diameters.within),
        piece_mm=diameters.piece_mm,
    )


WITHIN: Final = 0.05
"""Of the design: what the written diameter should keep along a tapered vessel."""
END_MM: Final = 1e-3
"""Nearer to a vessel's end is at it; overlaps lie beyond."""


@dataclass(frozen=True)
class VesselDiameters:
    """Deviation of the predicted diameter from the design, vessel by vessel.

    Attributes
    ----------
    vessel : (v,) int64
        Vessels that are written, ascending.
    written_mm : (v,) float64, mm
        Length found.
    designed_mm, predicted_mm : (v,) float64, mm
        Medians along it, weighted by length.
    median, worst : (v,) float64
        Deviation over the design, the worst with its sign.
    worst_at_mm : (v,) float64, mm
        Where that is, from the vessel's first node.
    worst_line : (v,) int64
    within : (v,) float64
        Share of the length within `WITHIN`.
    piece_mm : (n,) float64, mm
        Designed diameter beside each of the bead's pieces; NaN where it isn't held against one.
    """

    vessel: IntArray
    written_mm: FloatArray
    designed_mm: FloatArray
    predicted_mm: FloatArray
    median: FloatArray
    worst: FloatArray
    worst_at_mm: FloatArray
    worst_line: IntArray
    within: FloatArray
    piece_mm: FloatArray

    def facts(self) -> dict[str, Any]:
        """The whole in a few numbers: JSON-ready."""
        if not len(self.vessel):
            return {"vessels": 0}
        bad = int(np.abs(self.worst).argmax())
        total = float(self.written_mm.sum())
        return {
            "vessels": len(self.vessel),
            "median_percent": _percent(_weighted_median(self.median, self.written_mm)),
            "worst_percent": _percent(self.worst[bad]),
            "worst_vessel": int(self.vessel[bad]),
            "worst_at_mm": round(float(self.worst_at_mm[bad]), 3),
            "worst_line": int(self.worst_line[bad]),
            "length_within_5_percent": round(
                float((self.within * self.written_mm).sum()) / total, 4
            ),
        }


def vessel_diameters(
    bead: Bead, source: IntArray, network: VesselNetwork, place_mm: FloatArray, swell: float = 1.0
) -> VesselDiameters:
    """Hold a predicted bead against its vessels.

    Each written piece counts where its middle stands square to its own vessel's axis. Overlaps
    beyond a vessel's ends don't, nor does what lies within a joint: nearer to a node where vessels
    meet than the widest of them is thick there.

    Parameters
    ----------
    bead : Bead
        Embedded.
    source : (n,) int64
        Vessel of each piece.
    network : VesselNetwork
        As it is to be written, in the part's frame.
    place_mm : (3,) array, mm
        The part's origin in the printer's frame.
    swell : float
        Of diameters in the bath.
    """
    rows = np.flatnonzero(bead.writes & (source >= 0) & (source < network.vessel_count))
    rows = rows[np.argsort(source[rows], kind="stable")]
    middle = (bead.pieces.start[rows] + bead.pieces.end[rows]) / 2 - place_mm
    length = bead.pieces.length[rows]
    vessels, first = np.unique(source[rows], return_index=True)
    diameters, reach = [], _joint_radius(network)
    beside = np.full(len(bead), np.nan)
    for vessel, own in zip(
        vessels.tolist(), np.split(np.arange(len(rows)), first[1:]), strict=True
    ):
        along, designed = _on_axis(middle[own], *network.polyline(vessel), *reach[vessel])
        inside = np.isfinite(along)
        if not inside.any():
            continue
        beside[rows[own]] = designed
        kept = own[inside]
        wide = bead.width_mm[rows[kept]] * swell
        diameters.append(
            (
                vessel,
                *_held(wide, designed[inside], along[inside], length[kept], bead.line[rows[kept]]),
            )
        )
    table = np.array(diameters, dtype=np.float64).reshape(-1, 9).T
    columns = {name: table[k] for k, name in enumerate(_COLUMNS)}
    whole = {name: columns.pop(name).astype(np.int64) for name in ("vessel", "worst_line")}
    return VesselDiameters(**whole, **columns, piece_mm=beside)


_COLUMNS: Final = tuple(one.name for one in fields(VesselDiameters) if one.name != "piece_mm")


def _on_axis(
    middle: FloatArray, points: FloatArray, radius: FloatArray, begins: float, ends: float
) -> tuple[FloatArray, FloatArray]:
    """Way along the polyline to the nearest place, and the diameter there; NaN in joints."""
    step = np.diff(points, axis=0)
    size = np.maximum(np.linalg.norm(step, axis=1), 1e-12)
    before = np.concatenate([[0.0], np.cumsum(size)])
    along, designed = np.full(len(middle), np.nan), np.full(len(middle), np.nan)
    for k, one in enumerate(middle):
        share = np.clip(((one - points[:-1]) * step).sum(axis=1) / size**2, 0.0, 1.0)
        away = np.linalg.norm(points[:-1] + share[:, None] * step - one, axis=1)
        near = int(away.argmin())
        at = float(before[near] + share[near] * size[near])
        inside = END_MM < at < before[-1] - END_MM or away[near] < END_MM
        if inside and begins <= at <= before[-1] - ends:
            along[k] = at
            designed[k] = 2 * float(np.interp(at, before, radius))
    return along, designed


def _joint_radius(network: VesselNetwork) -> FloatArray:
    """Widest radius at each vessel's first and last node, (v, 2), mm; 0 where it ends alone."""
    ends = np.column_stack(
        [network.radius[network.offset[:-1]], network.radius[network.offset[1:] - 1]]
    )
    widest = np.zeros(len(network.nodes))
    np.maximum.at(widest, network.vessel_nodes, ends)
    met = np.bincount(network.vessel_nodes.ravel(), minlength=len(network.nodes)) > 1
    joint_radius: FloatArray = np.where(met, widest, 0.0)[network.vessel_nodes]
    return joint_radius


def _held(
    wide: FloatArray, designed: FloatArray, along: FloatArray, length: FloatArray, line: IntArray
) -> tuple[float, ...]:
    off = wide / designed - 1.0
    worst = int(np.abs(off).argmax())
    return (
        float(length.sum()),
        _weighted_median(designed, length),
        _weighted_median(wide, length),
        _weighted_median(off, length),
        float(off[worst]),
        float(along[worst]),
        float(line[worst]),
        float(length[np.abs(off) <= WITHIN].sum() / length.sum()),
    )


def _weighted_median(values: FloatArray, weight: FloatArray) -> float:
    order = np.argsort(values)
    total = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(total, total[-1] / 2)])


def _percent(share: float) -> float:
    return round(float(share) * 100, 2)
