"""A slow checker of the needle's shaft that knows moves and nodes, not the planner."""

from __future__ import annotations

import numpy as np

from design.network import VesselNetwork
from design.toolpath import MoveKind, Toolpath


def crossings(
    toolpath: Toolpath, network: VesselNetwork, shaft_mm: float, spacing_mm: float = 0.04
) -> set[tuple[int, int]]:
    """Pairs (vessel being written or left, vessel written before) that the shaft crosses.

    Near a node of both vessels, and just behind the tip along a path, touching is meant.
    """
    written: list[tuple[np.ndarray, float, int, float]] = []
    found: set[tuple[int, int]] = set()
    path, vessel = 0.0, int(toolpath.source[0])
    for move in range(len(toolpath)):
        kind = toolpath.kind[move]
        start, end = toolpath.start[move], toolpath.end[move]
        length = float(np.linalg.norm(end - start))
        if length == 0:
            continue
        rising = kind == MoveKind.TRAVEL and end[2] > start[2]
        vessel = vessel if rising else int(toolpath.source[move])
        tips = np.linspace(start, end, int(np.ceil(length / spacing_mm)) + 1)
        if kind == MoveKind.TRAVEL:
            path += 1e6  # nothing before a travel is fresh
        radius = float(np.sqrt(toolpath.volume_ul[move] / length / np.pi))
        if written:
            found |= _hits(tips, vessel, path, length, written, network, shaft_mm, radius, rising)
        if kind == MoveKind.WRITE:
            step = length / (len(tips) - 1)
            written += [(tip, radius, vessel, path + k * step) for k, tip in enumerate(tips)]
            path += length
    return found


def _hits(tips, vessel, path, length, written, network, shaft_mm, radius, rising):
    place = np.array([point for point, _, _, _ in written])
    thick = np.array([r for _, r, _, _ in written])
    owner = np.array([v for _, _, v, _ in written])
    when = np.array([arc for _, _, _, arc in written])
    # A travel has no radius of its own; the joint it leaves or enters is the vessel's.
    radius = radius or float(network.polyline(vessel)[1].max())
    found = set()
    for k, tip in enumerate(tips):
        across = np.hypot(*(place[:, :2] - tip[:2]).T)
        hit = (across < shaft_mm + thick) & (place[:, 2] + thick > tip[2])
        reach = (
            np.sqrt(2) * (shaft_mm + np.maximum(thick, radius)) + np.maximum(thick, radius) + 0.1
        )
        now = path - 1e6 if rising else path + length * k / (len(tips) - 1)
        fresh = (owner == vessel) & (now - when < reach)
        for t in np.flatnonzero(hit & ~fresh):
            if not _in_joint(place[t], tip, int(owner[t]), vessel, reach[t], network):
                found.add((vessel, int(owner[t])))
    return found


def _in_joint(a, tip, owner, vessel, reach, network):
    shared = set(network.vessel_nodes[owner]) & set(network.vessel_nodes[vessel])
    for node in network.nodes[list(shared)]:
        gap = tip - node
        gap[2] = min(gap[2], 0.0)  # a lift from the joint stays in the joint's column
        if max(np.linalg.norm(a - node), np.linalg.norm(gap)) < reach:
            return True
    return False
