"""Draw laid ink as maps of visible thickness and crest height over the camera's drawing plane."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_profiles.bead import BeadSection
from kernels import jit
from kernels.arrays import FloatArray, IntArray
from sim.devices.camera.optics import Plan
from sim.devices.camera.scene import Bath, InkLook
from sim.gcode.deposit.lay import Laid
from sim.gcode.deposit.written import Strands

SingleArray = NDArray[np.float32]


class InkDrawing(NamedTuple):
    """How ink is drawn."""

    faint: float = 0.02  # Share of its light by which a deep layer isn't drawn any more.
    rim: float = 0.15  # A line isn't thinner at its rim, where it is seen on edge.
    opaque: float = 6.0  # Optical thickness of ink below which nothing shows.


DRAWING: Final = InkDrawing()


_FLAT: Final = {"layered": 0.25, "embedded": 0.5}
"""Power of 1 - q² at the share q of the radius: 1/2 is an ellipse, less is flatter."""


@dataclass(frozen=True)
class InkMap:
    """Ink over a plan.

    Attributes
    ----------
    thick_mm : (rows, columns) float32
        Of all ink along the line of sight, deeper one fading with the bath's turbidity.
    crest_mm : (rows, columns) float32
        Top of the ink, printer's z; NaN where there is none.
    """

    thick_mm: SingleArray
    crest_mm: SingleArray


def ink_map(ink: Laid, plan: Plan, look: InkLook, bath: Bath) -> InkMap:
    """Draw laid ink.

    Layers add up, lines within one don't (they are united); of filaments in a bath the one that
    shows most counts.
    """
    thick = np.zeros(plan.shape, np.float32)
    crest = np.full(plan.shape, -np.inf, np.float32)
    lines = ink.strands
    if not len(lines):
        return InkMap(thick, np.full(plan.shape, np.nan, np.float32))
    top, radius = _tops(ink), _radii(ink, look)
    surface = top.max() if bath.surface_z_mm is None else max(bath.surface_z_mm, top.max())
    weight = np.exp(-2 * bath.turbidity_per_mm * (surface - top.mean(axis=1)))
    shown = weight > DRAWING.faint * weight.max()
    number = np.zeros(len(lines), np.int64)
    if ink.layering is not None:
        number = ink.layering.number(lines.end[:, 2])
    profile = np.maximum(np.linspace(1, 0, 1025) ** _FLAT[ink.style], DRAWING.rim)
    pens = _Pens(radius, top, ink.height_mm, weight, profile, DRAWING.opaque / look.density_per_mm)
    for layer in np.unique(number[shown])[::-1]:
        _draw(lines, np.flatnonzero(shown & (number == layer)), pens, plan, thick, crest)
    return InkMap(thick, np.where(np.isfinite(crest), crest, np.float32(np.nan)))


def _tops(ink: Laid) -> FloatArray:
    """Height of the crest at each line's ends, (n, 2), mm."""
    tip = np.column_stack([ink.strands.start[:, 2], ink.strands.end[:, 2]])
    return tip if ink.layering is not None else tip + ink.strands.radius[:, None]


def _radii(ink: Laid, look: InkLook) -> FloatArray:
    """Half of what is seen of each line from above, mm."""
    if ink.layering is None:
        return ink.strands.radius
    width = BeadSection(look.bead).width(ink.strands.area_mm2, ink.height_mm)
    return np.asarray(width / 2)


@dataclass(frozen=True)
class _Pens:
    """How each line is drawn; names as of `draw_lines`, radius in mm."""

    radius: FloatArray
    crest: FloatArray
    height: FloatArray
    weight: FloatArray
    profile: FloatArray
    enough: float


def _draw(
    lines: Strands,
    rows: IntArray,
    pens: _Pens,
    plan: Plan,
    thick: SingleArray,
    crest: SingleArray,
) -> None:
    """Add some of the lines to the maps."""
    start, end = plan.seen_at(lines.start[rows]), plan.seen_at(lines.end[rows])
    wide = pens.radius[rows] * plan.scale((lines.start[rows, 2] + lines.end[rows, 2]) / 2)
    limit = np.array(plan.shape[::-1]) - 1.0
    low = np.minimum(start, end).min(axis=0) - wide.max() - 2
    high = np.maximum(start, end).max(axis=0) + wide.max() + 2
    if (high < 0).any() or (low > limit).any():
        return
    first = np.clip(np.floor(low), 0, limit).astype(int)
    last = np.clip(np.ceil(high), 0, limit).astype(int) + 1
    box = (slice(first[1], last[1]), slice(first[0], last[0]))
    above, own_crest = np.ascontiguousarray(thick[box]), np.ascontiguousarray(crest[box])
    own = np.zeros_like(above)
    draw_lines(
        np.column_stack([start - first, end - first]),
        wide,
        pens.crest[rows],
        pens.height[rows],
        pens.weight[rows],
        pens.profile,
        above,
        pens.enough,
        own,
        own_crest,
    )
    thick[box] += own
    crest[box] = own_crest


# Kernel of the simulated camera: draw lines of ink into maps of thickness and of their crest.


@jit
def draw_lines(
    segments: FloatArray,
    radius: FloatArray,
    crest: FloatArray,
    height: FloatArray,
    weight: FloatArray,
    profile: FloatArray,
    above_map: SingleArray,
    enough: float,
    thick_map: SingleArray,
    crest_map: SingleArray,
) -> None:
    """Draw capsules, each thickest in its middle; where they overlap the thickest counts.

    ``segments`` (n, 4) are x0, y0, x1, y1 and ``radius`` (n,) in pixels of the maps; ``crest``
    (n, 2) and ``height`` (n,) are mm: where a line's top is at its ends, and how thick it is.
    ``weight`` fades what lies deep. ``profile`` (m,) is a line's thickness over that in its middle,
    evenly over the square of the share of the radius. The outermost pixel counts by the share that
    is covered. Nothing is drawn where more than ``enough`` ink lies in ``above_map`` already.
    """
    ny, nx = thick_map.shape
    for s in range(len(radius)):
        x0, y0, x1, y1 = segments[s]
        r = radius[s]
        reach = r + 1.0
        dx, dy = x1 - x0, y1 - y0
        squared = dx * dx + dy * dy
        per_squared = 1.0 / squared if squared > 0.0 else 0.0
        per_radius = (len(profile) - 1) / (r * r)
        thickest = weight[s] * height[s]
        outer, inner = (r + 0.5) ** 2, max(r - 0.5, 0.0) ** 2
        first = max(0, math.ceil(min(y0, y1) - reach))
        last = min(ny - 1, math.floor(max(y0, y1) + reach))
        for row in range(first, last + 1):
            t0, t1 = 0.0, 1.0
            if abs(dy) > 1e-9:
                ta, tb = (row - reach - y0) / dy, (row + reach - y0) / dy
                t0, t1 = max(0.0, min(ta, tb)), min(1.0, max(ta, tb))
            xa, xb = x0 + t0 * dx, x0 + t1 * dx
            left = max(0, math.ceil(min(xa, xb) - reach))
            right = min(nx - 1, math.floor(max(xa, xb) + reach))
            py = row - y0
            for col in range(left, right + 1):
                if above_map[row, col] > enough:
                    continue
                px = col - x0
                t = min(1.0, max(0.0, (px * dx + py * dy) * per_squared))
                ox, oy = px - t * dx, py - t * dy
                square = ox * ox + oy * oy
                if square >= outer:
                    continue
                cover = 1.0
                if square > inner:
                    cover = r - math.sqrt(square) + 0.5
                share = profile[min(int(square * per_radius), len(profile) - 1)] * cover
                thick = np.float32(thickest * share)
                if thick > thick_map[row, col]:
                    thick_map[row, col] = thick
                upper = crest[s, 0] + t * (crest[s, 1] - crest[s, 0])
                top = np.float32(upper - height[s] * (1.0 - share))
                if top > crest_map[row, col]:
                    crest_map[row, col] = top
