"""Paint pictures of layers with known ink, by code that shares nothing with the product.

Four kinds of ink (opaque, absorbing, clear with bright rims, clear ridges in slanting light) on a
textured bath in uneven light, through a tilted pinhole camera with blur, noise and 8 bits; layouts
of rings, meanders, filled areas and waves. Missing stretches, thin ones, blobs, bubbles and glare
are planted where asked.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field

import cv2
import numpy as np

KINDS = ("opaque", "absorbing", "rims", "relief")
LAYOUTS = ("rings", "meander", "filled", "waves")


@dataclass
class Plan:
    """Lines that should be there: pieces in the order of writing, mm."""

    start: np.ndarray
    end: np.ndarray
    width: np.ndarray
    stroke: np.ndarray


@dataclass
class Pinhole:
    """Camera over the plane: (x, y, z) mm to px, by its own matrix."""

    matrix: np.ndarray
    off_mm: np.ndarray = field(default_factory=lambda: np.zeros(2))

    def to_pixels(self, points: np.ndarray) -> np.ndarray:
        """Project."""
        p = np.asarray(points, float)
        plane = np.column_stack([p[:, :2] + self.off_mm, np.ones(len(p))])
        seen = plane @ self.matrix.T
        return seen[:, :2] / seen[:, 2:]


@dataclass
class Painted:
    """A picture, and the truth."""

    picture: np.ndarray
    frame: Pinhole
    plan: Plan
    laid: np.ndarray  # true width of each small piece of ink
    at: np.ndarray  # (k, 2) mm
    stroke: np.ndarray
    along: np.ndarray
    gaps: list[tuple[int, float, float]]
    mm_per_px: float
    plane: np.ndarray  # thickness on the fine raster, for looking at


def plan_layer(layout: str, size: float, width: float, rng: np.random.Generator) -> Plan:
    """Lines of a layout in a square of ``size`` mm at (10, 20)."""
    paths: list[np.ndarray] = []
    c = size / 2
    if layout == "rings":
        pitch = width * rng.uniform(1.9, 3.5)
        sides = int(rng.integers(4, 9))
        turn = rng.uniform(0, np.pi)
        r = pitch
        while r < c * 0.95:
            n = sides if sides < 7 else 48
            a = np.linspace(0, 2 * np.pi, n + 1) + turn
            paths.append(np.column_stack([c + r * np.cos(a), c + r * np.sin(a)]))
            r += pitch
    elif layout in ("meander", "filled"):
        pitch = width * (rng.uniform(1.7, 3.0) if layout == "meander" else rng.uniform(0.97, 1.0))
        turn = rng.uniform(0, np.pi)
        way, aside = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
        half, n = 0.33 * size, int(0.66 * size / pitch)
        pts = []
        for k in range(n):
            y = -half + k * pitch
            ends = [-half, half] if k % 2 == 0 else [half, -half]
            pts += [c + ends[0] * way + y * aside, c + ends[1] * way + y * aside]
        if layout == "meander" and rng.random() < 0.5:
            paths = [np.array(pts[2 * k : 2 * k + 2]) for k in range(n)]
        else:
            paths = [np.array(pts)]
    else:
        for k in range(max(1, int(size / (width * 3.5)) - 1)):
            x = np.linspace(0.06, 0.94, 60) * size
            wave = np.sin(x * rng.uniform(1, 3) + rng.uniform(0, 6))
            paths.append(np.column_stack([x, (3.5 * (k + 1) + 0.6 * wave) * width]))
    if not paths:  # too small for the layout
        paths = [np.array([[0.1 * size, c], [0.9 * size, c]])]
    start = np.concatenate([p[:-1] for p in paths]) + (10, 20)
    end = np.concatenate([p[1:] for p in paths]) + (10, 20)
    stroke = np.concatenate([np.full(len(p) - 1, k) for k, p in enumerate(paths)])
    return Plan(start, end, np.full(len(start), width), stroke)


def _dense(plan: Plan, step: float) -> tuple[np.ndarray, ...]:
    """Points along all strokes: at, stroke, along, width."""
    at, stroke, along, width = [], [], [], []
    for s in np.unique(plan.stroke):
        rows = np.flatnonzero(plan.stroke == s)
        begun = 0.0
        for r in rows:
            length = float(np.hypot(*(plan.end[r] - plan.start[r])))
            n = max(1, math.ceil(length / step))
            t = np.arange(n) / n
            at.append(plan.start[r] + t[:, None] * (plan.end[r] - plan.start[r]))
            along.append(begun + t * length)
            stroke.append(np.full(n, s))
            width.append(np.full(n, plan.width[r]))
            begun += length
        at.append(plan.end[rows[-1]][None])
        along.append(np.array([begun]))
        stroke.append(np.array([s]))
        width.append(np.array([plan.width[rows[-1]]]))
    return tuple(np.concatenate(v) for v in (at, stroke, along, width))


def lay(
    plan: Plan,
    rng: np.random.Generator,
    *,
    ratio: float = 1.0,
    wobble: float = 0.03,
    gaps: list[tuple[int, float, float]] | None = None,
) -> tuple[np.ndarray, ...]:
    """True ink: points, stroke, along, widths (0 where missing)."""
    at, stroke, along, width = _dense(plan, 0.25 * float(plan.width.min()))
    width = width * ratio
    for s in np.unique(stroke):
        own = stroke == s
        n = int(own.sum())
        wave = cv2.GaussianBlur(rng.normal(0, 1, (n, 1)), (0, 0), 6.0)[:, 0]
        wave -= wave.mean()
        width[own] *= 1 + wobble * wave / max(float(wave.std()), 1e-9)
    for s, begin, end in gaps or []:
        width[(stroke == s) & (along > begin) & (along < end)] = 0.0
    return at, stroke, along, width


def thickness(
    at: np.ndarray,
    stroke: np.ndarray,
    along: np.ndarray,
    width: np.ndarray,
    gaps: list[tuple[int, float, float]],
    origin: np.ndarray,
    cell: float,
    shape: tuple[int, int],
    round_ends: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Relative place across (0 middle, 1 edge; > 1 outside) and local radius on a raster.

    Missing stretches are cut square to the line, or end in half balls that reach to their ends.
    """
    rel = np.full(shape, 9.0, np.float32)
    radius = np.zeros(shape, np.float32)
    for s in np.unique(stroke):
        rows = np.flatnonzero(stroke == s)
        for a, b in itertools.pairwise(rows):
            if width[a] <= 0 and width[b] <= 0:
                continue
            wide = max(width[a], width[b])
            p, q = (at[a] - origin) / cell, (at[b] - origin) / cell
            r = 1.4 * wide / 2 / cell + 1
            x0, x1 = int(max(0, min(p[0], q[0]) - r)), int(min(shape[1], max(p[0], q[0]) + r + 2))
            y0, y1 = int(max(0, min(p[1], q[1]) - r)), int(min(shape[0], max(p[1], q[1]) + r + 2))
            if x0 >= x1 or y0 >= y1:
                continue
            x, y = np.meshgrid(np.arange(x0, x1), np.arange(y0, y1))
            d = q - p
            length = float(d @ d)
            raw = ((x - p[0]) * d[0] + (y - p[1]) * d[1]) / max(length, 1e-12)
            t = np.clip(raw, 0, 1)
            dist = np.hypot(x - p[0] - t * d[0], y - p[1] - t * d[1]) * cell
            wa, wb = (w if w > 0 else wide for w in (width[a], width[b]))
            own = (wa + t * (wb - wa)) / 2
            part = dist / own
            here = along[a] + raw * (along[b] - along[a])
            for gs, g0, g1 in gaps:
                if gs == s and round_ends:
                    beyond = np.minimum(here - (g0 - own), (g1 + own) - here) / own
                    part = np.where(beyond > 0, np.hypot(part, np.maximum(beyond, 0.0)), part)
                elif gs == s:
                    part = np.where((here > g0) & (here < g1), 9.0, part)
            part = part.astype(np.float32)
            box = np.s_[y0:y1, x0:x1]
            better = part < rel[box]
            rel[box] = np.where(better, part, rel[box])
            radius[box] = np.where(better, own, radius[box])
    return rel, radius


def camera(
    size: float, um_per_px: float, tilt: float, rng: np.random.Generator
) -> tuple[Pinhole, tuple[int, int]]:
    """Tilted pinhole over the square at (10, 20) with a margin, and the picture's (h, w)."""
    px = 1e3 / um_per_px
    wide = round((size + 3.0) * px)
    high = round((size + 3.0) * px)
    far = 60.0  # mm
    f = far * px
    a, b, spin = np.deg2rad(
        [rng.uniform(-tilt, tilt), rng.uniform(-tilt, tilt), rng.uniform(-20, 20)]
    )
    rx = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    ry = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    rz = np.array([[np.cos(spin), -np.sin(spin), 0], [np.sin(spin), np.cos(spin), 0], [0, 0, 1]])
    turn = rz @ rx @ ry
    inner = np.array([[f, 0, (wide - 1) / 2], [0, f, (high - 1) / 2], [0, 0, 1]])
    place = np.column_stack([turn[:, 0], turn[:, 1], np.array([0, 0, far])])
    middle = np.array([[1, 0, -(10 + size / 2)], [0, 1, -(20 + size / 2)], [0, 0, 1]])
    return Pinhole(inner @ place @ middle), (high, wide)


def _texture(
    shape: tuple[int, int], rng: np.random.Generator, scales: tuple[float, ...]
) -> np.ndarray:
    """Noise of several scales (px), standard deviation 1."""
    out = np.zeros(shape, np.float32)
    for scale in scales:
        n = max(1, int(scale / 3))
        small = rng.normal(0, 1, (shape[0] // n + 2, shape[1] // n + 2)).astype(np.float32)
        small = cv2.GaussianBlur(small, (0, 0), max(scale / n, 0.3))
        big = cv2.resize(small, (shape[1], shape[0]), interpolation=cv2.INTER_LINEAR)
        out += big / max(float(big.std()), 1e-9) / math.sqrt(len(scales))
    return out


@dataclass
class Look:
    """How a scene is lit and seen."""

    kind: str = "opaque"
    colour: bool = True
    bath: tuple[float, float, float] = (120, 120, 120)
    ink: tuple[float, float, float] = (190, 150, 80)
    texture: float = 0.03
    grain_mm: float = 0.1
    light: float = 0.3
    blur_px: float = 0.8
    noise: float = 2.0


def random_look(kind: str, rng: np.random.Generator, contrast: float = 0.3) -> Look:
    """Bath and ink of moderate contrast, lighter or darker, grey or coloured."""
    bath = rng.uniform(60, 150) * rng.uniform(0.9, 1.1, 3)
    way = rng.choice([-1.0, 1.0]) * rng.uniform(0.6, 1.4, 3)
    ink = bath * np.exp(way / np.abs(way).mean() * contrast * rng.uniform(1.0, 1.6))
    return Look(
        kind,
        bool(rng.random() < 0.6),
        tuple(bath),
        tuple(ink),
        rng.uniform(0.01, 0.04),
        rng.uniform(0.04, 0.2),
        rng.uniform(0.0, 0.35),
        rng.uniform(0.5, 1.2),
        rng.uniform(1.0, 3.0),
    )


def paint(
    plan: Plan,
    ink: tuple[np.ndarray, ...],
    gaps: list[tuple[int, float, float]],
    size: float,
    um_per_px: float,
    look: Look,
    rng: np.random.Generator,
    *,
    tilt: float = 12.0,
    shift: tuple[float, float] = (0.0, 0.0),
    blobs: list[tuple[float, float, float]] | None = None,
    bubbles: list[tuple[float, float, float]] | None = None,
    glare: list[tuple[float, float, float]] | None = None,
    needle: bool = False,
    fine: float = 1.6,
    overlay: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray] | None = None,
    round_ends: bool = False,
) -> Painted:
    """Paint it; blobs, bubbles and glare as (x, y, radius) in mm of the printer.

    ``overlay`` (`layer_troubles`) changes the plane, given the places x and y of its cells.
    """
    frame, (high, wide) = camera(size, um_per_px, tilt, rng)
    cell = um_per_px * 1e-3 / fine
    origin = np.array([10.0, 20.0]) - 2.0
    count = round((size + 4.0) / cell)
    at, stroke, along, width = ink
    rel, radius = thickness(
        at + np.array(shift), stroke, along, width, gaps, origin, cell, (count, count), round_ends
    )
    x, y = np.meshgrid(np.arange(count) * cell + origin[0], np.arange(count) * cell + origin[1])
    for bx, by, br in blobs or []:
        part = (np.hypot(x - bx, y - by) / br).astype(np.float32)
        better = part < rel
        rel, radius = np.where(better, part, rel), np.where(better, br, radius)
    plane = _shade(rel, radius, cell, look, rng)
    plane = overlay(plane, x, y) if overlay else plane
    for bx, by, br in bubbles or []:
        d = np.hypot(x - bx, y - by) / br
        ring = np.exp(-(((d - 0.93) / 0.06) ** 2))
        spot = np.exp(-((np.hypot(x - bx + 0.35 * br, y - by + 0.35 * br) / (0.18 * br)) ** 2))
        inside = d < 0.9
        soft = cv2.GaussianBlur(plane, (0, 0), 0.4 * br / cell)
        plane = np.where(inside[..., None], soft, plane)
        plane = plane * (1 - 0.65 * ring[..., None]) + 400 * spot[..., None]
    light = _light(x, y, size, look.light, rng)
    plane = plane * light[..., None]
    for gx, gy, gr in glare or []:
        plane = plane + 600 * np.exp(-((np.hypot(x - gx, y - gy) / gr) ** 4))[..., None]
    if needle:
        a = rng.uniform(0, 2 * np.pi)
        way = np.array([np.cos(a), np.sin(a)])
        tip = np.array([10 + size / 2, 20 + size / 2]) + rng.uniform(-0.25, 0.25, 2) * size
        along_n = (x - tip[0]) * way[0] + (y - tip[1]) * way[1]
        aside = np.abs(-(x - tip[0]) * way[1] + (y - tip[1]) * way[0])
        steel = (along_n > 0) & (aside < 0.4 + 0.05 * along_n)
        plane = np.where(steel[..., None], (25 + 150 * (aside < 0.08))[..., None], plane)
    to_cell = np.linalg.inv(
        np.array([[cell, 0, origin[0]], [0, cell, origin[1]], [0, 0, 1]])
    ) @ np.linalg.inv(frame.matrix)
    u, v = np.meshgrid(np.arange(wide), np.arange(high))
    den = to_cell[2, 0] * u + to_cell[2, 1] * v + to_cell[2, 2]
    px = ((to_cell[0, 0] * u + to_cell[0, 1] * v + to_cell[0, 2]) / den).astype(np.float32)
    py = ((to_cell[1, 0] * u + to_cell[1, 1] * v + to_cell[1, 2]) / den).astype(np.float32)
    soft = cv2.GaussianBlur(plane.astype(np.float32), (0, 0), 0.5)
    seen = cv2.remap(soft, px, py, cv2.INTER_LINEAR, None, cv2.BORDER_REFLECT_101)
    seen = cv2.GaussianBlur(seen, (0, 0), look.blur_px)
    seen = seen + rng.normal(0, 1, seen.shape) * np.sqrt(look.noise**2 + 0.02 * np.maximum(seen, 0))
    picture = np.clip(np.rint(seen), 0, 255).astype(np.uint8)
    if not look.colour:
        picture = picture[..., 1]
    return Painted(
        picture, frame, plan, width, at, stroke, along, list(gaps), um_per_px * 1e-3, plane
    )


def _light(
    x: np.ndarray, y: np.ndarray, size: float, most: float, rng: np.random.Generator
) -> np.ndarray:
    u, v = (x - 10 - size / 2) / size * 2, (y - 20 - size / 2) / size * 2
    a = rng.uniform(0, 2 * np.pi)
    slope = most * 0.5 * (u * np.cos(a) + v * np.sin(a))
    return np.clip(1 + slope - 0.25 * most * (u**2 + v**2), 0.15, 2)


def _shade(
    rel: np.ndarray, radius: np.ndarray, cell: float, look: Look, rng: np.random.Generator
) -> np.ndarray:
    bath, ink = np.array(look.bath), np.array(look.ink)
    grain = look.grain_mm / cell
    rough = _texture(rel.shape, rng, (0.4 * grain, grain, 3 * grain))
    ground = bath * (1 + look.texture * rough[..., None])
    # Share of each cell in ink, edges a cell wide.
    edge = np.where(rel < 3, (rel - 1) * radius / cell, 1.0)
    cover = np.clip(0.5 - edge, 0, 1)[..., None]
    chord = np.sqrt(np.clip(1 - rel**2, 0, 1))[..., None]
    if look.kind == "opaque":
        own = ink * (
            1 + 0.4 * look.texture * _texture(rel.shape, rng, (grain, 4 * grain))[..., None]
        )
        return ground * (1 - cover) + own * cover
    if look.kind == "absorbing":
        return ground * np.exp(np.log(ink / bath) * 1.3 * chord)
    if look.kind == "rims":
        rim = np.exp(-(((rel - 0.9) / 0.12) ** 2))[..., None] * (rel < 1.3)[..., None]
        return ground * (1 + 0.04 * cover) + 0.55 * np.abs(ink - bath).mean() * rim * 1.6
    height = radius[..., None] * chord
    gy, gx = np.gradient(height[..., 0], cell)
    slope = np.clip(gx * 0.8 + gy * 0.5, -1.2, 1.2)
    return ground * (1 + 0.3 * slope[..., None]) * (1 - 0.06 * chord)


def plant_gaps(
    plan: Plan, lengths: tuple[float, ...], rng: np.random.Generator
) -> list[tuple[int, float, float]]:
    """Places (stroke, from, to) for gaps, away from ends and from each other."""
    found: list[tuple[int, float, float]] = []
    way = np.hypot(*(plan.end - plan.start).T)
    total = {int(s): float(way[plan.stroke == s].sum()) for s in np.unique(plan.stroke)}
    for length in lengths:
        s = int(rng.choice(list(total)))
        free = float(plan.width.max()) + 0.05
        if total[s] < length + 2 * free + 0.2:
            continue
        begin = float(rng.uniform(free, total[s] - length - free))
        if all(o[0] != s or begin > o[2] + 0.5 or begin + length < o[1] - 0.5 for o in found):
            found.append((s, begin, begin + length))
    return found
