"""Compute how deep ink lies inside a vessel joint, where shaft contact is allowed (compiled).

A joint reaches J = sqrt(2) (R + r) + overlap from where the tip is, or from a place where two
vessels meet (`gcode.clearance.network`): R the bare tip's radius, r the larger filament's, or
the lumen's where a vessel is several filaments side by side.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from gcode.clearance.arrays import LEFT, Ink, Joints, Tips
from kernels import jit
from kernels.arrays import FloatArray


class JointTolerance(NamedTuple):
    """Tolerances of a joint."""

    widest_mm: float = 0.025  # Reach of a place where vessels meet, to either side.
    past_mm: float = 0.002  # Rounding of a place at a vessel's end.


JOINT: Final = JointTolerance()


@jit
def _reach(i: int, j: int, role: int, tips: Tips, ink: Ink, joints: Joints) -> float:
    """J, mm: how far a joint goes."""
    radius = max(ink.radius[j, 0], ink.radius[j, 1], tips.radius[i, role])
    for vessel in (ink.vessel[j], tips.vessel[i, role]):
        if vessel >= 0:
            radius = max(radius, joints.lumen_mm[vessel])
    return float(np.sqrt(2.0) * (joints.radius_mm + radius) + joints.overlap_radii * radius)


@jit
def _mixed(pair: FloatArray, share: float) -> float:
    """A value between a piece's ends; inf stays inf."""
    if pair[0] == np.inf:
        return np.inf
    return float(pair[0] + share * (pair[1] - pair[0]))


@jit
def _past_far_end(v: int, place: float, near: float, joints: Joints) -> float:
    """How far a place lies past the end that is opposite to ``near``, mm; below 0 it doesn't.

    What lies past a vessel's end lies where another one is: it belongs to the joint there, and not
    to that at its own other end, however short the vessel is. Asked of each place, not of a row:
    one line of G-code may write a vessel and what goes on past it.
    """
    if near == 0.0:
        return float(place - joints.length_mm[v])
    return float(-place)


@jit
def _between(v: int, w: int, joints: Joints) -> tuple[int, int]:
    """Where the meetings of two vessels stand."""
    begin, end = joints.begin[v], joints.begin[v + 1]
    low = begin + np.searchsorted(joints.other[begin:end], w)
    high = low + np.searchsorted(joints.other[low:end], w + 1)
    return low, high


@jit
def slack_of(i: int, j: int, s: float, t: float, tips: Tips, ink: Ink, joints: Joints) -> float:
    """How far inside a joint, or not yet written, the ink is, mm; below 0 it isn't."""
    best, w = -np.inf, ink.vessel[j]
    if tips.run[i] >= 0 and tips.run[i] == ink.run[j]:
        behind = _mixed(tips.arc[i], s) - _mixed(ink.arc[j], t)
        if ink.when[j] == tips.when[i]:  # what the tip hasn't come to yet isn't written
            best = -behind
        if w < 0:
            best = _reach(i, j, LEFT, tips, ink, joints) - behind
    if w < 0:
        return float(best)
    place = _mixed(ink.along[j], t)
    for role in range(2):
        v = tips.vessel[i, role]
        if v < 0:
            continue
        reach = _reach(i, j, role, tips, ink, joints)
        left = reach - _mixed(tips.since[i, role], s)
        if left + JOINT.widest_mm <= best:
            continue
        at = _mixed(tips.along[i, role], s)
        if v == w:
            best = max(best, left - abs(place - at))
        low, high = _between(v, w, joints)
        most = reach + JOINT.widest_mm
        for m in range(low + np.searchsorted(joints.own[low:high], at - most), high):
            if joints.own[m] > at + most:
                break
            tip = left - abs(joints.own[m] - at) - joints.gap[m]
            here = min(tip, reach - abs(joints.there[m] - place)) + joints.wide[m]
            if joints.wide[m] == 0.0:
                past = _past_far_end(v, at, joints.own[m], joints)
                past = max(past, _past_far_end(w, place, joints.there[m], joints))
                here = min(here, JOINT.past_mm - past)
            best = max(best, here)
    return float(best)


@jit
def are_related(i: int, j: int, tips: Tips, ink: Ink, joints: Joints) -> bool:
    """Whether any rule of joints may concern this motion and this ink."""
    w = ink.vessel[j]
    if ink.when[j] == tips.when[i]:
        return True
    for role in range(2):
        v, since = tips.vessel[i, role], min(tips.since[i, role, 0], tips.since[i, role, 1])
        if since > _reach(i, j, role, tips, ink, joints) + JOINT.widest_mm:
            continue
        if w < 0 and role == LEFT and tips.run[i] >= 0 and tips.run[i] == ink.run[j]:
            return True
        if v < 0 or w < 0:
            continue
        low, high = _between(v, w, joints)
        if v == w or low < high:
            return True
    return False


@jit
def _change(pair: FloatArray) -> float:
    """How much a value changes along a piece; 0 where it isn't known at all."""
    return float(abs(pair[1] - pair[0])) if np.isfinite(pair[0]) else 0.0


@jit
def tip_slope(i: int, tips: Tips) -> float:
    """Most that `slack_of` changes along a piece of motion, mm."""
    out = _change(tips.arc[i])
    for role in range(2):
        out = max(out, _change(tips.along[i, role]) + _change(tips.since[i, role]))
    return float(out)


@jit
def ink_slope(j: int, ink: Ink) -> float:
    """Most that `slack_of` changes along a piece of ink, mm."""
    return max(_change(ink.arc[j]), _change(ink.along[j]))
