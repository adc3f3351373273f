"""Slow oracles for growth kernels."""

import heapq

import numpy as np

from tests.design.geometry.oracles import segment_segment


def reduced_resistance(tree, i, k):
    """R* and the ratios below segment i by Karch's recursion, straight from physics.md."""
    length = np.linalg.norm(tree.distal[i] - tree.proximal[i])
    a, b = tree.children[i]
    length *= tree.relative_viscosity[i]
    if a < 0:
        return k * length, {i: tree.relative_flow[i]}, {}
    ra, na, ratios_a = reduced_resistance(tree, a, k)
    rb, nb, ratios_b = reduced_resistance(tree, b, k)
    gamma = tree.murray_exponent
    x = (na[a] * ra / (nb[b] * rb)) ** 0.25
    beta_a = (1 + x**-gamma) ** (-1 / gamma)
    beta_b = (1 + x**gamma) ** (-1 / gamma)
    own = k * length + 1 / (beta_a**4 / ra + beta_b**4 / rb)
    return own, {**na, **nb, i: na[a] + nb[b]}, {**ratios_a, **ratios_b, a: beta_a, b: beta_b}


def terminal_flows(tree, radius, thick=None):
    """Flow of each terminal by series and parallel resistances of Poiseuille tubes, µL/s.

    ``thick`` is each tube's viscosity over the tree's, 1 by default.
    """
    length = np.linalg.norm(tree.distal - tree.proximal, axis=1)
    if thick is None:
        thick = np.ones(len(length))
    tube = 8 * tree.viscosity_pa_s * thick * length / (np.pi * radius**4)
    resistance = {}

    def below(i):
        if i not in resistance:
            conductance = sum(1 / below(c) for c in tree.children[i] if c >= 0)
            resistance[i] = tube[i] + (1 / conductance if conductance else 0)
        return resistance[i]

    flows = {}

    def descend(i, pressure):
        flow = pressure / below(i)
        a, b = tree.children[i]
        if a < 0:
            flows[i] = flow
        for c in (a, b):
            if c >= 0:
                descend(c, pressure - flow * tube[i])

    descend(0, tree.pressure_drop_pa)
    return np.array([flows[i] for i in sorted(flows)])


def colliding_pairs(network, clearance_mm=0.0, clearance_ratio=0.0):
    """All pairs of pieces, each by its own distance and its own shortest way."""
    start, end, r0, r1, _ = network.pieces()
    radius = np.maximum(r0, r1)
    keys = [(tuple(a), tuple(b)) for a, b in zip(start.tolist(), end.tolist(), strict=True)]
    colliding, joints = set(), set()
    # Pieces whose balls about them are farther apart are so themselves.
    middle, reach = (start + end) / 2, np.linalg.norm(end - start, axis=1) / 2 + radius
    apart = np.linalg.norm(middle[:, None] - middle, axis=2) - reach[:, None] - reach
    near = apart < max(clearance_mm, clearance_ratio * radius.max())
    for i in range(len(start)):
        for j in (i + 1 + np.flatnonzero(near[i, i + 1 :])).tolist():
            if set(keys[i]) & set(keys[j]):
                continue
            gap = segment_segment(start[i], end[i], start[j], end[j]) - radius[i] - radius[j]
            kept = max(clearance_mm, clearance_ratio * min(radius[i], radius[j]))
            if gap >= kept:
                continue
            limit = 2 * (radius[i] + radius[j]) + kept
            (colliding if _way(keys, i, j) > limit else joints).add((i, j))
    return colliding, joints


def _way(keys, i, j):
    best = dict.fromkeys(keys[i], 0.0)
    heap = [(0.0, node) for node in keys[i]]
    while heap:
        way, node = heapq.heappop(heap)
        if node in keys[j]:
            return way
        for a, b in keys:
            if node in (a, b):
                other = b if node == a else a
                further = way + np.linalg.norm(np.subtract(a, b))
                if further < best.get(other, np.inf):
                    best[other] = further
                    heapq.heappush(heap, (further, other))
    return np.inf


def parting(tree, radius, clearance_mm=0.0, ratio=0.0):
    """Least room, mm, between a vessel's far end and a vessel it shares its near node with."""
    least = np.inf
    for i, pair in enumerate(tree.children):
        if pair[0] < 0:
            continue
        one, two = pair
        for tip, other in ((one, two), (two, one), (one, i), (two, i)):
            begin, way = tree.proximal[other], tree.distal[other] - tree.proximal[other]
            along = np.clip((tree.distal[tip] - begin) @ way / (way @ way), 0, 1)
            away = np.linalg.norm(tree.distal[tip] - begin - along * way)
            kept = max(clearance_mm, ratio * min(radius[tip], radius[other]))
            least = min(least, away - radius[tip] - radius[other] - kept)
    return least


def joints(tree):
    """Of each joint of two: the angle between them, their turns (degrees), and their flows' ratio.

    Flows are counted from the terminals, one by one.
    """
    tips = np.flatnonzero(tree.children[:, 0] < 0)
    flow = np.zeros(len(tree.parent))
    for tip in tips:
        i = tip
        while i >= 0:
            flow[i] += tree.relative_flow[tip]
            i = tree.parent[i]
    between, turns, ratio = [], [], []
    for i, (one, two) in enumerate(tree.children):
        if two < 0:
            continue
        way, a, b = (tree.distal[k] - tree.proximal[k] for k in (i, one, two))
        between.append(_angle(a, b))
        turns += [_angle(way, a), _angle(way, b)]
        ratio.append(min(flow[one], flow[two]) / max(flow[one], flow[two]))
    return np.array(between), np.array(turns), np.array(ratio)


def _angle(a, b):
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def volume(tree):
    """Sum of π r² ℓ, each radius by the ratios on the walk from its segment up to the root."""
    length = np.linalg.norm(tree.distal - tree.proximal, axis=1)
    total = tree.terminal_flow_ul_s * len(np.flatnonzero(tree.children[:, 0] < 0))
    root = (total * tree.reduced_resistance[0] / tree.pressure_drop_pa) ** 0.25
    found = 0.0
    for i in range(len(length)):
        radius, k = root, i
        while tree.parent[k] >= 0:
            radius *= tree.ratio[k]
            k = tree.parent[k]
        found += np.pi * radius**2 * length[i]
    return found
