"""Choose the vessels to adjust, and compute their next radii from target flows by 0D."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import least_squares

from design.errors import FlowError
from design.hemodynamics.conditions import FlowConditions
from design.hemodynamics.three_d.effective import Effective, inflow_of
from design.hemodynamics.three_d.match.options import MatchOptions
from design.hemodynamics.three_d.match.target import Target
from design.hemodynamics.zero_d.sensitivity import flow_and_sensitivity
from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray

_KEPT: Final = 1e-3
"""Weight of a radius' change beside that of flows, so that no radius changes without need."""

_INSIDE: Final = 1e-9
"""By which the search begins inside its bounds."""


@dataclass(frozen=True)
class FreeVessels:
    """Vessels whose radii change, and least and greatest logarithm of their scales."""

    vessel: IntArray
    low: FloatArray
    high: FloatArray


def _varied(network: VesselNetwork, how: MatchOptions) -> IntArray:
    if how.vary is not None:
        chosen = np.unique(np.array(how.vary, dtype=np.int64))
        strange = chosen[(chosen < 0) | (chosen >= network.vessel_count)]
        if len(strange) or not len(chosen):
            raise FlowError(
                f"vessels to vary: {list(how.vary)}; give some of 0 to {network.vessel_count - 1}"
            )
        return chosen
    outlets = network.outlets()
    tree = network.vessel_count == len(network.nodes) - 1 and len(network.inlets()) == 1
    if tree and len(outlets) > 1:
        return np.flatnonzero(np.isin(network.vessel_nodes[:, 1], outlets))
    return np.arange(network.vessel_count)


def free_radii(network: VesselNetwork, how: MatchOptions) -> FreeVessels:
    """Vessels that may change, and by how much.

    Raises
    ------
    FlowError
        Vessels that the network doesn't have, a radius below the least to begin with.
    """
    vary = _varied(network, how)
    thinnest = np.minimum.reduceat(network.radius, network.offset[:-1])[vary]
    below = thinnest < how.least_radius_mm * (1.0 - 1e-9)
    if below.any():
        vessel = int(vary[below][0])
        raise FlowError(
            f"vessel {vessel} has radius {thinnest[below][0]:g} mm, below the least that is to be "
            f"printed, {how.least_radius_mm:g} mm, before any change; widen it, or lower that"
        )
    most = np.log(how.most_change)
    with np.errstate(divide="ignore"):
        low = np.maximum(np.log(how.least_radius_mm / thinnest), -most)
    return FreeVessels(vary, np.minimum(low, 0.0), np.full(len(vary), most))


def next_scales(
    network: VesselNetwork,
    conditions: FlowConditions,
    target: Target,
    effective: Effective,
    free: FreeVessels,
    scale: FloatArray,
) -> FloatArray:
    """Scales at which the reduced model, resisting as 3D does now, has the wanted flows."""
    vary, low, inflow = free.vessel, free.low, inflow_of(network, effective.flow)
    log_now = np.log(scale)

    def model(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        logs = log_now.copy()
        logs[vary] = x
        resistance = effective.resistance * np.exp(-4.0 * (logs - log_now))
        flow, slope = flow_and_sensitivity(network, conditions, vary, resistance)
        return flow[target.vessel], slope[target.vessel]

    def residual(x: FloatArray) -> FloatArray:
        return np.concatenate([(model(x)[0] - target.flow) / inflow, _KEPT * x])

    def slope(x: FloatArray) -> FloatArray:
        return np.concatenate([model(x)[1] / inflow, _KEPT * np.eye(len(x))])

    start = np.clip(log_now[vary], low + _INSIDE, free.high - _INSIDE)
    done = least_squares(residual, start, slope, bounds=(low, free.high), xtol=1e-12, ftol=1e-14)
    after = scale.copy()
    after[vary] = np.exp(np.clip(done.x, low, free.high))
    return after
