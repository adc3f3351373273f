"""Measure Murray's law, angles and asymmetry at bifurcations, and the spread of terminal flows."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np

from design.errors import NetworkError
from design.measures.morphometry import Forest
from design.network import VesselKind, VesselNetwork
from kernels.arrays import FloatArray


@dataclass(frozen=True)
class MurrayResiduals:
    """Σ r_child^γ / r_parent^γ - 1 at forks, with the radii at the node.

    A fork is a node that one vessel enters and several leave, or the other way round.

    Attributes
    ----------
    exponent : float
        γ.
    forks : int
    mean, least, greatest : float
    p95 : float
        Of the absolute values.
    """

    exponent: float
    forks: int
    mean: float
    p95: float
    least: float
    greatest: float


@dataclass(frozen=True)
class TerminalFlow:
    """Flow of the terminals: outlets; with a single outlet connections, or else inlets.

    Attributes
    ----------
    terminals : int
    mean_ul_s : float, µL/s
    spread : float
        (greatest - least) / mean.
    cv : float
        Standard deviation over mean.
    """

    terminals: int
    mean_ul_s: float
    spread: float
    cv: float


def measure_murray(network: VesselNetwork, exponent: float) -> MurrayResiduals | None:
    """Residuals of Murray's law with ``exponent``; None without forks."""
    nodes = len(network.nodes)
    first, last = network.vessel_nodes.T
    leaving = network.radius[network.offset[:-1]] ** exponent
    entering = network.radius[network.offset[1:] - 1] ** exponent
    out, into = np.bincount(first, minlength=nodes), np.bincount(last, minlength=nodes)
    sum_out = np.bincount(first, leaving, minlength=nodes)
    sum_into = np.bincount(last, entering, minlength=nodes)
    apart, together = (into == 1) & (out > 1), (into > 1) & (out == 1)
    residual = np.concatenate(
        [sum_out[apart] / sum_into[apart], sum_into[together] / sum_out[together]]
    )
    if len(residual) == 0:
        return None
    residual -= 1.0
    return MurrayResiduals(
        exponent=exponent,
        forks=len(residual),
        mean=float(residual.mean()),
        p95=float(np.percentile(np.abs(residual), 95.0)),
        least=float(residual.min()),
        greatest=float(residual.max()),
    )


def measure_terminal_flow(network: VesselNetwork, flow: FloatArray) -> TerminalFlow | None:
    """How evenly terminals are fed; None with fewer than two of them, or without flow.

    Parameters
    ----------
    network : VesselNetwork
    flow : (v,) float64, µL/s
        In each vessel, as a flow solution gives it.

    Raises
    ------
    NetworkError
        When there isn't one value a vessel.
    """
    if np.shape(flow) != (network.vessel_count,):
        raise NetworkError(
            f"flow has shape {np.shape(flow)} for {network.vessel_count} vessels; give one each"
        )
    out = np.bincount(network.vessel_nodes[:, 1], flow, minlength=len(network.nodes))
    served = out[network.outlets()]
    if len(served) < 2:
        served = np.abs(flow[network.kind == VesselKind.CONNECTION])
    if len(served) < 2:
        into = np.bincount(network.vessel_nodes[:, 0], flow, minlength=len(network.nodes))
        served = into[network.inlets()]
    mean = float(served.mean()) if len(served) else 0.0
    if len(served) < 2 or mean <= 0.0:
        return None
    return TerminalFlow(
        terminals=len(served),
        mean_ul_s=mean,
        spread=float(np.ptp(served)) / mean,
        cv=float(served.std()) / mean,
    )


DIRECTION_RADII = 2.0
"""Way along a branch, over the parent's radius, to where its direction is taken: curves begin
along the parent."""
MEASURES: Final = ("between_deg", "wider_deg", "narrower_deg", "diameter_ratio", "area_ratio")


@dataclass(frozen=True)
class Forks:
    """Joints of one parent and two children.

    Attributes
    ----------
    first : (f,) bool
        Whether the parent is a root.
    between_deg : (f,) float64
        Angle between the two children.
    wider_deg, narrower_deg : (f,) float64
        Angle of each child against its parent's way on.
    diameter_ratio : (f,) float64
        Diameter of the narrower child over the wider one's.
    area_ratio : (f,) float64
        Cross-sections of both children over their parent's (Kaimovitz et al. 2008's area
        expansion ratio).
    """

    first: np.ndarray[tuple[int], np.dtype[np.bool_]]
    between_deg: FloatArray
    wider_deg: FloatArray
    narrower_deg: FloatArray
    diameter_ratio: FloatArray
    area_ratio: FloatArray


def measure_forks(network: VesselNetwork, forest: Forest) -> Forks:
    """Angles and ratios at all forks of a forest; directions are taken `DIRECTION_RADII` away."""
    wide = 2.0 * network.mean_radius()[forest.vessels]
    below = np.flatnonzero(forest.parent >= 0)
    count = np.bincount(forest.parent[below], minlength=len(forest.parent))
    # The wider of two children comes first.
    order = below[np.lexsort((-wide[below], forest.parent[below]))]
    pair = order[count[forest.parent[order]] == 2].reshape(-1, 2)
    parent = forest.parent[pair[:, 0]]
    reach = DIRECTION_RADII * 0.5 * wide[parent]
    on = _ways(network, forest, parent, reach, towards_fork=True)
    one = _ways(network, forest, pair[:, 0], reach, towards_fork=False)
    two = _ways(network, forest, pair[:, 1], reach, towards_fork=False)
    return Forks(
        forest.parent[parent] < 0,
        _degrees(one, two),
        _degrees(on, one),
        _degrees(on, two),
        wide[pair[:, 1]] / wide[pair[:, 0]],
        (wide[pair[:, 0]] ** 2 + wide[pair[:, 1]] ** 2) / wide[parent] ** 2,
    )


def compare_forks(forks: Forks, published: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """Mean and standard deviation of each measure, beside published ones, as plain numbers.

    Each measure has a row for all forks; where figures of the first forks alone are published,
    rows of these follow. ``inside`` is whether our mean is within one published standard
    deviation; None where nothing is published, or its definition isn't known to be ours.
    """
    rows = []
    for name in MEASURES:
        known = [one for one in published if one["measure"] == name]
        plain = {"at": "all", "mean": None, "sd": None, "source": None, "note": None}
        rows += [
            _fork_row(forks, name, one)
            for one in (*([] if any(k["at"] == "all" for k in known) else [plain]), *known)
        ]
    return rows


def _fork_row(forks: Forks, name: str, published: dict[str, Any]) -> dict[str, Any]:
    values: FloatArray = getattr(forks, name)
    values = values[forks.first] if published["at"] == "first" else values
    mean = float(values.mean()) if len(values) else None
    known = mean is not None and published["sd"] is not None and published["note"] is None
    return {
        "measure": name,
        "at": published["at"],
        "forks": len(values),
        "ours": mean,
        "ours_sd": float(values.std()) if len(values) else None,
        **{key: published[key] for key in ("mean", "sd", "source", "note")},
        "inside": abs(mean - published["mean"]) <= published["sd"]
        if known and mean is not None
        else None,
    }


def _ways(
    network: VesselNetwork,
    forest: Forest,
    places: np.ndarray[tuple[int], np.dtype[np.int64]],
    reach: FloatArray,
    *,
    towards_fork: bool,
) -> FloatArray:
    """Unit vectors (n, 3) from root to terminals at one end of vessels, over ``reach`` (n,) mm."""
    turned = _runs_to_root(network, forest)
    lines = [line for line, _ in network.polylines()]
    ways = np.empty((len(places), 3))
    for n, (place, far) in enumerate(zip(places.tolist(), reach.tolist(), strict=True)):
        line = lines[int(forest.vessels[place])]
        line = line[::-1] if turned != towards_fork else line
        # From the fork along the vessel; a parent's line was turned to run away from it.
        way = _along(line, far) - line[0]
        ways[n] = -way if towards_fork else way
    return ways / np.maximum(np.linalg.norm(ways, axis=1), 1e-300)[:, None]


def _runs_to_root(network: VesselNetwork, forest: Forest) -> bool:
    """Whether vessels are stored from terminals to root (veins)."""
    child = np.flatnonzero(forest.parent >= 0)
    if not len(child):
        return False
    ends = network.vessel_nodes[forest.vessels]
    return bool(ends[child[0], 0] != ends[forest.parent[child[0]], 1])


def _along(line: FloatArray, far: float) -> FloatArray:
    """The point of a polyline (k, 3) ``far`` mm from its begin, or its end."""
    for a, b in pairwise(line):
        length = float(np.linalg.norm(b - a))
        if far <= length:
            point: FloatArray = a + far / length * (b - a)
            return point
        far -= length
    return line[-1]


def _degrees(one: FloatArray, two: FloatArray) -> FloatArray:
    across = np.linalg.norm(np.cross(one, two), axis=1)
    degrees: FloatArray = np.degrees(np.arctan2(across, np.einsum("ij,ij->i", one, two)))
    return degrees
