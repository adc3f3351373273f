"""Small random designs in blocks, and other designs that each may be mistaken for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import manifold3d
import numpy as np

from design.network import VesselKind, VesselNetwork
from design.solids import Solid
from kernels.arrays import FloatArray
from tests.design.networks import network
from tests.registration import parts

KINDS = ("tree", "channels", "loop")
WRONG = ("network", "seed", "mirror", "similar", "size")
"""Another network in the same block; the same kind of network drawn again; its mirror image; a
block of nearly the same size; one of another size."""
SIZE_MM = np.array([[4.6, 3.8, 2.2], [6.4, 5.2, 2.7]])
WALL_MM = 0.25


@dataclass(frozen=True)
class Design:
    """A block with straight vessels.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    size_mm : (3,) float64, mm
    places : (n, 3) float64, mm
        Nodes.
    ends : (m, 2) int
        Nodes of each vessel.
    radius : (m,) float64, mm
    """

    kind: str
    size_mm: FloatArray
    places: FloatArray
    ends: tuple[tuple[int, int], ...]
    radius: FloatArray

    @cached_property
    def network(self) -> VesselNetwork:
        """The vessels."""
        return network(
            self.places.tolist(), list(self.ends), self.radius.tolist(), VesselKind.CHANNEL
        )

    @cached_property
    def solid(self) -> Solid:
        """The gel."""
        block = manifold3d.Manifold.cube(self.size_mm.tolist())
        return parts.solid(block - parts.lumens(self.network))


def draw(rng: np.random.Generator, kind: str = "", size_mm: FloatArray | None = None) -> Design:
    """Draw a design; of a given kind, in a block of a given size."""
    kind = kind or str(rng.choice(KINDS))
    size = rng.uniform(*SIZE_MM) if size_mm is None else size_mm
    return {"tree": _tree, "channels": _channels, "loop": _loop}[kind](rng, size)


def wrong_for(design: Design, how: str, rng: np.random.Generator) -> Design:
    """Draw the design that a scan of `design` is held against by mistake; `how` as in `WRONG`."""
    if how == "network":
        other = [kind for kind in KINDS if kind != design.kind]
        return draw(rng, str(rng.choice(other)), design.size_mm)
    if how == "seed":
        return draw(rng, design.kind, design.size_mm)
    if how == "mirror":
        places = design.places.copy()
        places[:, 1] = design.size_mm[1] - places[:, 1]
        return Design(design.kind, design.size_mm, places, design.ends, design.radius)
    low, high = (0.93, 1.08) if how == "similar" else (0.6, 1.6)
    return draw(rng, size_mm=design.size_mm * rng.uniform(low, high, 3))


def _at(rng: np.random.Generator, x: float, size: FloatArray, radius: float) -> list[float]:
    """Draw a place in a section of the block, clear of its faces."""
    keep = radius + WALL_MM
    return [x, *(rng.uniform(keep, side - keep) for side in size[1:])]


def _tree(rng: np.random.Generator, size: FloatArray) -> Design:
    trunk = rng.uniform(0.32, 0.4)
    root, fork = _at(rng, 0.0, size, trunk), _at(rng, rng.uniform(0.2, 0.35) * size[0], size, trunk)
    places, ends, radius = [root, fork], [(0, 1)], [trunk]
    for side in range(2):
        arm = rng.uniform(0.26, 0.3)
        places.append(_at(rng, rng.uniform(0.5, 0.65) * size[0], size, arm))
        places[-1][1] = rng.uniform(0.5 * side, 0.5 + 0.5 * side) * (size[1] - 1.2) + 0.6
        ends.append((1, len(places) - 1))
        radius.append(arm)
        joint = len(places) - 1
        for _ in range(2):
            places.append(_at(rng, size[0], size, 0.25))
            ends.append((joint, len(places) - 1))
            radius.append(rng.uniform(0.22, 0.25))
    return Design("tree", size, np.array(places), tuple(ends), np.array(radius))


def _channels(rng: np.random.Generator, size: FloatArray) -> Design:
    places, ends, radius = [], [], []
    for k in range(int(rng.integers(2, 5))):
        wide = rng.uniform(0.22, 0.36)
        places += [_at(rng, 0.0, size, wide), _at(rng, size[0], size, wide)]
        ends.append((2 * k, 2 * k + 1))
        radius.append(wide)
    return Design("channels", size, np.array(places), tuple(ends), np.array(radius))


def _loop(rng: np.random.Generator, size: FloatArray) -> Design:
    wide = rng.uniform(0.24, 0.36, 2)
    places = [
        _at(rng, 0.0, size, 0.36),
        _at(rng, rng.uniform(0.2, 0.3) * size[0], size, 0.36),
        _at(rng, rng.uniform(0.7, 0.8) * size[0], size, 0.36),
        _at(rng, size[0], size, 0.36),
    ]
    ends, radius = [(0, 1), (2, 3)], [wide[0], wide[0]]
    for side in range(2):
        middle = _at(rng, rng.uniform(0.4, 0.6) * size[0], size, 0.3)
        middle[1] = rng.uniform(0.6, 0.4 * size[1]) + 0.5 * side * size[1]
        middle[1] = min(middle[1], size[1] - 0.6)
        places.append(middle)
        ends += [(1, len(places) - 1), (len(places) - 1, 2)]
        radius += [wide[1], wide[1]]
    return Design("loop", size, np.array(places), tuple(ends), np.array(radius))
