"""The checker's oracle: every place of the tip against every place of ink, sampled."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from sim.clearance import NeedleBody

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


def nearest(moves: list[dict], needle: NeedleBody, overlap: float) -> list[float]:
    """Nearest approach of each move: dicts of start, end, radius (0: a travel), vessel, nodes."""
    ink: list[dict] = []
    found = []
    for k, move in enumerate(moves):
        tips = samples(move["start"], move["end"])
        best = np.inf
        pending = []
        if move["radius"]:
            arc = np.linalg.norm(tips - move["start"], axis=1)
            pending = [{**move, "at": tips, "arc": arc, "pass": k}]
        for one in ink + pending:
            spots, radius = one["at"], max(one["radius"], move["radius"], move["beside"])
            reach = np.sqrt(2) * (needle.room_mm + radius) + overlap * radius
            flat = tips[:, None, :] - spots[None]
            rho, z = np.hypot(flat[..., 0], flat[..., 1]), -flat[..., 2]
            spared = np.zeros(rho.shape, bool)
            if move["radius"] and one["pass"] == k:
                spared |= pending[0]["arc"][:, None] - one["arc"][None] <= reach
            for node in move["nodes"] & one["nodes"]:
                down = tips - node
                down[:, 2] = np.minimum(down[:, 2], 0)
                close = np.linalg.norm(down, axis=1)[:, None] <= reach
                spared |= close & (np.linalg.norm(spots - node, axis=1)[None] <= reach)
            near = (rho < needle.radius_mm + radius + 1.2) & (z > -1.5) & ~spared
            if near.any():
                best = min(best, (signed(rho[near], z[near], needle) - one["radius"]).min())
        ink += pending
        found.append(float(best))
    return found
