"""Prints of designs with what may be wrong with a right part: shrunk, clogged, leaking, in part."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.identity.designs import Design
from kernels.arrays import FloatArray
from tests.registration import parts

DAMAGE = ("sound", "shrunk", "clogged", "half", "noisy", "leaking", "narrow", "dim", "sound")
PLUG_MM = 0.6


@dataclass(frozen=True)
class Print:
    """A design as printed and scanned.

    Attributes
    ----------
    design : Design
    damage : str
        One of `DAMAGE`.
    scale : (3,) float64
        Size over the design's.
    plugged : tuple of int
        Vessels that are closed all along.
    leaks : (n, 2, 3) float64, mm
        Ends of straight ways through the gel.
    leak_mm : float, mm
        Their radius.
    narrower_mm : float, mm
        By which all lumens' radii are smaller.
    """

    design: Design
    damage: str
    scale: FloatArray
    plugged: tuple[int, ...]
    leaks: FloatArray
    leak_mm: float
    narrower_mm: float

    def distance(self, points: FloatArray) -> FloatArray:
        """Signed distance to the gel's surface (…,), negative inside, unscaled part frame."""
        design = self.design
        box = (np.abs(points - design.size_mm / 2) - design.size_mm / 2).max(axis=-1)
        return np.asarray(np.maximum(box, -self.lumen(points)))

    def lumen(self, points: FloatArray) -> FloatArray:
        """Signed distance to what is hollow, negative inside."""
        net = self.design.network
        whole = parts.lumen_distance(net, points) + self.narrower_mm
        start, end, radius, _, vessel = net.pieces()
        for a, b, r, number in zip(start, end, radius, vessel, strict=True):
            if int(number) in self.plugged:
                whole = np.maximum(whole, -(_capsule(points, a, b) - r - 0.02))
        for a, b in self.leaks:
            whole = np.minimum(whole, _capsule(points, a, b) - self.leak_mm)
        return whole


def _capsule(points: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Distance to a straight line from a to b."""
    way = b - a
    t = np.clip((points - a) @ way / (way @ way), 0, 1)
    return np.asarray(np.linalg.norm(points - a - t[..., None] * way, axis=-1))


def draw_print(design: Design, damage: str, rng: np.random.Generator) -> Print:
    """Print a design with some damage."""
    usual = rng.uniform(0.975, 1.005, 3)
    printed = Print(design, damage, usual, (), np.zeros((0, 2, 3)), 0.0, 0.0)
    count = len(design.ends)
    if damage == "shrunk":
        return replace(printed, scale=rng.uniform(0.95, 0.965, 3))
    if damage == "clogged":
        many = max(1, round(count * rng.uniform(0.35, 0.55)))
        return replace(printed, plugged=tuple(rng.choice(count, many, replace=False).tolist()))
    if damage == "narrow":
        return replace(printed, narrower_mm=float(rng.uniform(0.03, 0.08)))
    if damage != "leaking":
        return printed
    ways = []
    for vessel in rng.choice(count, min(count, int(rng.integers(1, 4))), replace=False):
        a, b = design.places[list(design.ends[vessel])]
        start = a + rng.uniform(0.3, 0.7) * (b - a)
        out = start.copy()
        out[1 + int(rng.integers(2))] = -0.2
        ways.append([start, out])
    return replace(printed, leaks=np.array(ways), leak_mm=float(rng.uniform(0.08, 0.2)))
