"""Measure residuals of Murray's law at bifurcations, and the spread of terminal flows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.errors import NetworkError
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
