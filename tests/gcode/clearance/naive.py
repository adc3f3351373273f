"""Slow oracle of the shaft checker: samples all tip places against all ink."""

from itertools import pairwise

import numpy as np

from gcode.clearance.kernels import NeedleBody

STEP = 0.03


def signed(rho: np.ndarray, z: np.ndarray, needle: NeedleBody) -> np.ndarray:
    """Signed distance to the shaft by its outline, in the half plane of radius and height."""
    tip = needle.radius_mm if needle.tip_radius_mm is None else needle.tip_radius_mm
    corners = np.array(
        [(0.0, 0.0), (tip, 0.0), (needle.radius_mm, needle.cone_mm), (needle.radius_mm, 99.0)]
    )
    place, gap = np.stack([rho, z], axis=-1), np.full(rho.shape, np.inf)
    for a, b in pairwise(corners):
        if (a == b).all():
            continue
        share = np.clip(((place - a) @ (b - a)) / ((b - a) @ (b - a)), 0, 1)
        gap = np.minimum(gap, np.linalg.norm(place - a - share[..., None] * (b - a), axis=-1))
    wide = np.interp(z, corners[1:, 1], corners[1:, 0])
    return np.where((z >= 0) & (rho <= wide), -gap, gap)


def samples(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    count = max(2, int(np.ceil(np.linalg.norm(b - a) / STEP)) + 1)
    return np.linspace(a, b, count)


def overlapping(one: dict, other: dict, needle: NeedleBody, overlap: float, radius: float):
    """Arcs along two straight vessels, and which pairs of places are one body in the design."""
    if one["vessel"] == other["vessel"]:
        return None
    (a, p), (b, q) = (
        (places, np.linalg.norm(places - places[0], axis=1))
        for places in (samples(*one["axis"]), samples(*other["axis"]))
    )
    gap = np.linalg.norm(a[:, None] - b[None], axis=2)
    reach = np.sqrt(2) * (needle.tip_mm + radius) + overlap * radius
    found = gap <= 2 * radius - radius / 4
    for node in one["nodes"] & other["nodes"]:
        ways = [np.linalg.norm(places - node, axis=1) for places in (a, b)]
        found &= np.maximum(ways[0][:, None], ways[1][None]) > reach
        found &= gap < 0.7 * (ways[0][:, None] + ways[1][None])
    return p, q, found, gap


def spared_by(move: dict, one: dict, tips: np.ndarray, reach: float, overlaps) -> np.ndarray:
    """Which ink of a straight vessel (columns) belongs to the joint of which tip (rows)."""
    arc = np.linalg.norm(tips - move["axis"][0], axis=1) if move["radius"] else np.zeros(len(tips))
    spared = np.zeros((len(tips), len(one["at"])), bool)
    if one["vessel"] == move["vessel"]:
        behind = arc[:, None] - one["arc"][None]
        spared |= behind <= reach  # what lies ahead isn't there yet
    for node in move["nodes"] & one["nodes"]:
        own = np.abs(arc - np.linalg.norm(move["axis"][0] - node)) <= reach
        spared |= own[:, None] & (np.linalg.norm(one["at"] - node, axis=1)[None] <= reach)
    if overlaps is not None:
        p, q, found, gap = overlaps
        far = reach + 0.025  # the place reaches as far to either side
        for row, column in np.argwhere(found):  # the tip is near both axes' places
            near = np.abs(arc - p[row]) + gap[row, column] <= far
            spared |= near[:, None] & (np.abs(one["arc"] - q[column]) <= far)[None]
    return spared


def nearest(moves: list[dict], needle: NeedleBody, overlap: float, design: float) -> list[float]:
    """Nearest approach of each move.

    Dicts of start, end, radius (0: a travel), beside (radius that is gone to), vessel, its axis and
    its nodes (none for a travel that goes to no vessel).
    """
    ink: list[dict] = []
    found = []
    for move in moves:
        tips, best = samples(move["start"], move["end"]), np.inf
        if move["radius"]:
            arc = np.linalg.norm(tips - move["start"], axis=1)
            ink.append({**move, "at": tips, "arc": arc})
        for one in ink:
            radius = max(one["radius"], move["radius"], move["beside"])
            reach = np.sqrt(2) * (needle.tip_mm + radius) + overlap * radius
            flat = tips[:, None, :] - one["at"][None]
            rho, z = np.hypot(flat[..., 0], flat[..., 1]), -flat[..., 2]
            near = (rho < needle.radius_mm + radius + 1.2) & (z > -1.5)
            if near.any() and move["nodes"]:
                overlaps = overlapping(move, one, needle, overlap, design)
                near &= ~spared_by(move, one, tips, reach, overlaps)
            if near.any():
                best = min(best, (signed(rho[near], z[near], needle) - one["radius"]).min())
        found.append(float(best))
    return found
