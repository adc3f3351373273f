"""Paint what spoils pictures of layers: soft shadow bars, ink whose density adds, dark crumbs.

Each works on the plane that `layer_painter.paint` paints (its ``overlay``), before the camera.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from benchmarks.checkers.layer_painter import Look, Plan, thickness


@dataclass(frozen=True)
class Bar:
    """A shadow with parallel edges: a camera's arm, a syringe.

    Its edges rise as a cosine over ``soft_mm``, beyond ``half_mm`` to either side of the middle.
    """

    at_mm: tuple[float, float]
    angle: float
    half_mm: float
    soft_mm: float
    depth: float

    def light(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Factor of the light, 1 beside the bar."""
        across = (x - self.at_mm[0]) * np.cos(self.angle) + (y - self.at_mm[1]) * np.sin(self.angle)
        out = np.clip((np.abs(across) - self.half_mm) / self.soft_mm, 0.0, 1.0)
        return 1 - self.depth * 0.5 * (1 + np.cos(np.pi * out))


@dataclass(frozen=True)
class Crumb:
    """A dark convex crumb: corners (k, 2) mm; its brightness over the bath's, per channel."""

    corners_mm: np.ndarray
    tint: np.ndarray


@dataclass
class Troubles:
    """All of them; call it with a plane (h, w, 3) and places (h, w) in mm."""

    bars: list[Bar] = field(default_factory=list)
    crumbs: list[Crumb] = field(default_factory=list)
    extra: np.ndarray | None = None
    """Factor by which ink of further lines darkens or lightens each cell, (h, w, 3)."""

    def __call__(self, plane: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Paint them over it."""
        out = plane if self.extra is None else plane * self.extra
        cell = float(x[0, 1] - x[0, 0])
        for crumb in self.crumbs:
            place = (crumb.corners_mm - (x[0, 0], y[0, 0])) / cell
            cover = np.zeros(x.shape, np.float32)
            cv2.fillPoly(cover, [np.rint(place * 16).astype(np.int32)], 1.0, cv2.LINE_AA, 4)
            cover = cv2.GaussianBlur(cover, (0, 0), 0.7)[..., None]
            out = out * (1 - cover) + crumb.tint * np.median(plane, axis=(0, 1)) * cover
        for bar in self.bars:
            out = out * bar.light(x, y)[..., None]
        return out


def grid(size: float, width: float, rng: np.random.Generator) -> Plan:
    """Lines both ways over the square of ``size`` mm at (10, 20), and a frame around them."""
    half, turn = 0.33 * size, rng.uniform(0, np.pi)
    pitch = width * rng.uniform(2.5, 5.0)
    rows = np.arange(-half + 0.5 * pitch, half, pitch)
    turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    corners = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
    paths = [corners] if rng.random() < 0.5 else []
    paths += [np.array([[-half, y], [half, y]]) for y in rows]
    paths += [np.array([[x, -half], [x, half]]) for x in rows]
    placed = [path @ turned.T + size / 2 + (10, 20) for path in paths]
    start, end = (np.concatenate([p[part] for p in placed]) for part in (np.s_[:-1], np.s_[1:]))
    stroke = np.concatenate([np.full(len(p) - 1, k) for k, p in enumerate(placed)])
    return Plan(start, end, np.full(len(start), width), stroke)


def bare(plan: Plan, gaps: list[tuple[int, float, float]]) -> list[tuple[int, float, float]]:
    """Those of the gaps that no other line covers in part (each stroke of `grid` is straight)."""
    kept = []
    for stroke, begin, end in gaps:
        own = np.flatnonzero(plan.stroke == stroke)
        if len(own) > 1:
            continue
        way = plan.end[own[0]] - plan.start[own[0]]
        way = way / np.hypot(*way)
        points = plan.start[own[0]] + np.linspace(begin, end, 20)[:, None] * way
        other = plan.stroke != stroke
        a, d = plan.start[other][:, None], (plan.end - plan.start)[other][:, None]
        t = np.clip(((points - a) * d).sum(axis=2) / (d**2).sum(axis=2), 0, 1)
        far = np.linalg.norm(points - a - t[..., None] * d, axis=2)
        if far.min() > float(plan.width.max()):
            kept.append((stroke, begin, end))
    return kept


def piled(
    ink: tuple[np.ndarray, ...],
    gaps: list[tuple[int, float, float]],
    shift: tuple[float, float],
    size: float,
    cell: float,
    look: Look,
) -> np.ndarray:
    """What all strokes but the thickest absorb at each cell of `layer_painter.paint`'s plane."""
    at, stroke, along, width = ink
    count = round((size + 4.0) / cell)
    origin = np.array([8.0, 18.0])
    total, most = np.zeros((count, count), np.float32), np.zeros((count, count), np.float32)
    for s in np.unique(stroke):
        own = stroke == s
        rel, _ = thickness(
            at[own] + np.array(shift), stroke[own], along[own], width[own], gaps, origin, cell,
            (count, count),
        )  # fmt: skip
        chord = np.sqrt(np.clip(1 - rel**2, 0, 1))
        total, most = total + chord, np.maximum(most, chord)
    step = np.log(np.array(look.ink) / np.array(look.bath)) * 1.3
    return np.exp(step * (total - most)[..., None])
