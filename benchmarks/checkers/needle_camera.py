"""Pictures of a needle in front of any ground; shares no code with the product.

Each fine pixel's ray is intersected with a cylinder that a plane cuts off (flat, or aslant for a
worn tip); its light is a round steel rod's: diffuse from one side, a bright thread, dark rims.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from benchmarks.checkers.dish_camera import Optics

FINE = 3


@dataclass
class Needle:
    """A needle: tip, outer diameter and length, mm; unit axis upwards; its end's slope along x."""

    tip: np.ndarray
    outer: float
    axis: np.ndarray
    slope: float = 0.0
    length: float = 12.7
    bright: float = 150.0
    dark: float = 40.0
    thread: float = 0.8
    light: float = 0.7


def with_needle(optics: Optics, ground: np.ndarray, needle: Needle) -> np.ndarray:
    """Ground (h, w) in brightness 0 to 255, needle and hub before it; no blur, no noise."""
    out = _with_rod(optics, ground, needle)
    foot = needle.tip + needle.length * needle.axis
    side = np.cross(needle.axis, optics.centre - needle.tip)
    side *= 2.0 / np.linalg.norm(side)
    ends = np.stack([foot - side, foot + side, foot + side + 12 * needle.axis,
                     foot - side + 12 * needle.axis])  # fmt: skip
    cv2.fillConvexPoly(out, np.round(optics.pixels(ends)).astype(np.int32), 170.0)
    return out


def _with_rod(optics: Optics, ground: np.ndarray, needle: Needle) -> np.ndarray:
    ends = optics.pixels(np.stack([needle.tip, needle.tip + needle.length * needle.axis]))
    room = 3 * needle.outer * optics.focal / np.linalg.norm(optics.centre - needle.tip)
    low = np.maximum(np.floor(ends.min(axis=0) - room), 0).astype(int)
    high = np.minimum(np.ceil(ends.max(axis=0) + room), np.array(optics.size)).astype(int)
    out = ground.astype(np.float32).copy()
    for top in range(low[1], high[1], 64):
        bottom = min(top + 64, high[1])
        u = low[0] + (np.arange((high[0] - low[0]) * FINE) + 0.5) / FINE - 0.5
        v = top + (np.arange((bottom - top) * FINE) + 0.5) / FINE - 0.5
        uu, vv = np.meshgrid(u, v)
        flat = np.column_stack([uu.ravel(), vv.ravel()])
        along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        near = np.abs((flat - ends[0]) @ np.array([-along[1], along[0]])) < room / 3 + 4
        hit, light = np.zeros(len(flat), np.float32), np.zeros(len(flat), np.float32)
        if near.any():
            hit[near], light[near] = _cast(optics, needle, flat[near])
        shape = (bottom - top, FINE, high[0] - low[0], FINE)
        share = hit.reshape(shape).mean(axis=(1, 3))
        value = (hit * light).reshape(shape).mean(axis=(1, 3))
        part = out[top:bottom, low[0] : high[0]]
        part *= 1 - share
        part += value
    return out


def _cast(optics: Optics, needle: Needle, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    way = optics.directions(pixels)
    way /= np.linalg.norm(way, axis=1)[:, None]
    start = optics.centre - needle.tip
    axis = needle.axis
    w = way - (way @ axis)[:, None] * axis
    s = start - (start @ axis) * axis
    a, b, c = (w**2).sum(axis=1), w @ s, s @ s - (needle.outer / 2) ** 2
    inside = b**2 - a * c
    reach = (-b - np.sqrt(np.maximum(inside, 0))) / a
    point = start + reach[:, None] * way
    height = point @ axis
    side = np.cross(axis, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    hit = (inside > 0) & (height > needle.slope * (point @ side)) & (height < needle.length)
    normal = (point - height[:, None] * axis) / (needle.outer / 2)
    facing = -(normal * way).sum(axis=1)
    across = normal @ np.cross(axis, -start / np.linalg.norm(start))
    lit = needle.dark + (needle.bright - needle.dark) * np.clip(facing, 0, 1) * (
        1 + needle.light * across
    ) / (1 + abs(needle.light))
    lit += needle.thread * 255 * np.exp(-(((across - 0.25) / 0.08) ** 2))
    if start @ axis < 0:  # seen from below: the end's face
        reach = -(start @ axis) / (way @ axis)
        face = np.linalg.norm(start + reach[:, None] * way, axis=1) < needle.outer / 2
        lit = np.where(face & ~hit, needle.dark, lit)
        hit |= face
    return hit.astype(np.float32), np.clip(lit, 0, 255).astype(np.float32)


def rough_ground(
    size: tuple[int, int], rng: np.random.Generator, level: float, deep: float
) -> np.ndarray:
    """Ground of blotches at several scales, (h, w)."""
    wide, high = size
    out = np.full((high, wide), level, np.float32)
    for scale in (4, 12, 40, 160):
        small = rng.normal(size=(high // scale + 2, wide // scale + 2)).astype(np.float32)
        out += deep / 2 * cv2.resize(small, size, interpolation=cv2.INTER_CUBIC)
    return np.clip(out, 5, 250)
