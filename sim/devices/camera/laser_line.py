"""Simulate a laser line profiler over the dish: a height map of the ink that lies bare.

Modelled
--------
- A sheet of laser light straight down along x, swept along y, and a camera that looks at it from
  +y at an angle: what lies behind something taller isn't seen.
- Lines as wide as their dose makes them (`BeadSection`), with round shoulders, each at the height
  of its tip: a line over a gap doesn't sag.
- The line's own thickness (heights are means over it), speckle, lost points on steep flanks, on
  wet crests that mirror the laser into the camera, and here and there; a tilt that the frame
  doesn't know of.

Not modelled
------------
Light that goes through clear ink or is scattered in it (a spray or a dye helps a real one), second
reflections between lines, a bath: what it covers no laser line sees.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, ClassVar, Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from firmware_profiles.materials.bead import BeadSection
from gcode.deposit.lay import Laid
from gcode.errors import SimError
from kernels.arrays import BoolArray, FloatArray
from sim.devices.camera.paint import draw_lines
from sim.devices.recorded_ink import InkBox
from sim.errors import CameraError

SingleArray = NDArray[np.float32]
Region = tuple[FloatArray, FloatArray]


class LaserSurface(NamedTuple):
    """How the measured surface is drawn."""

    finer: int = 2  # Cells of the drawn surface in one of the profiler's, each way.
    max_cells: int = 60_000_000
    wet_mm: float = 0.15  # Size of the patches that mirror.
    spot_mm: float = 0.06


SURFACE: Final = LaserSurface()

_SHOULDER: Final = np.linspace(1, 0, 1025) ** 0.25
"""A line's height over that of its crest, evenly over the square of the share of its radius."""
_MIRRORED: Final = math.radians(3.0)
"""From the slope at which a crest throws the laser into the camera."""


class ProfilerField(InkBox):
    """Laser line profiler over a box of the printer's frame, and the ink's source.

    Attributes
    ----------
    low_mm, high_mm : (x, y, z), mm
        What it measures: below and above it nothing is measured. The plate lies at ``plate_z_mm``.
    angle_deg : float, degrees
        Between the laser's sheet and the camera's view.
    noise_um, spot_um : float, µm
        Standard deviation of speckle, and of the laser line's thickness.
    steepest_deg : float, degrees
        Steeper flanks send too little light back, four times in five.
    wet : float
        Share of the surface that mirrors.
    lost_per_mm2 : float, 1/mm²
        Spots that are lost anywhere.
    tilt : (x, y), mm per mm
        Of the profiler; its frame doesn't know of it.
    """

    called: ClassVar[str] = "profiler file"
    error: ClassVar[type[SimError]] = CameraError

    plate_z_mm: float
    pixel_um: tuple[Annotated[float, Field(ge=2, le=500)], Annotated[float, Field(ge=2, le=500)]]
    angle_deg: Annotated[float, Field(ge=10, le=60)] = 35.0
    noise_um: Annotated[float, Field(ge=0, le=1000)] = 3.0
    spot_um: Annotated[float, Field(ge=0, le=500)] = 12.0
    steepest_deg: Annotated[float, Field(ge=30, le=89)] = 70.0
    wet: Annotated[float, Field(ge=0, le=1)] = 0.1
    lost_per_mm2: Annotated[float, Field(ge=0, le=100)] = 0.3
    tilt: tuple[float, float] = (0.0005, -0.0003)


def measured_heights(
    ink: Laid, field: ProfilerField, seed: int, region: Region | None = None
) -> tuple[SingleArray, FloatArray]:
    """Measure what lies bare in the field.

    Parameters
    ----------
    seed : int
        Of all that changes from look to look.
    region : (low, high), each (3,), mm, optional
        Only what of the field lies in this box, along x and y, is measured.

    Returns
    -------
    heights : (rows, columns) float32, mm
        Over ``plate_z_mm``; NaN where lost.
    to_map : (4, 4) float64
        Takes the printer's places to the map's frame, mm, the tilt left out.

    Raises
    ------
    CameraError
        When the region lies outside the field, or has too many cells.
    """
    low, high = _measured_box(field, region)
    pitch = np.array(field.pixel_um) * 1e-3 / SURFACE.finer
    count = (
        np.maximum(np.ceil((high - low) / (SURFACE.finer * pitch)).astype(int), 1) * SURFACE.finer
    )
    if count.prod() > SURFACE.max_cells:
        raise CameraError(f"{count[0]} by {count[1]} cells are too many; raise pixel_um")
    truth = _surface(ink, field, low, pitch, (int(count[1]), int(count[0])))
    rng = np.random.default_rng((seed, 17))
    lost = _lost(truth, field, pitch, rng)
    heights = _seen(truth, lost, field, pitch)
    heights += rng.normal(0.0, 1e-3 * field.noise_um, heights.shape).astype(np.float32)
    first = low + SURFACE.finer / 2 * pitch
    x, y = (first[k] + SURFACE.finer * pitch[k] * np.arange(heights.shape[1 - k]) for k in range(2))
    tilted = field.tilt[0] * (x - x.mean()) + (field.tilt[1] * (y - y.mean()))[:, None]
    height = heights + tilted.astype(np.float32)
    z = height + field.plate_z_mm
    height[(z < field.low_mm[2]) | (z > field.high_mm[2])] = np.nan
    to_map = np.eye(4)
    to_map[:3, 3] = -first[0], -first[1], -field.plate_z_mm
    return height, to_map


def _measured_box(field: ProfilerField, region: Region | None) -> Region:
    """Lowest and highest x, y of what is measured, (2,) each, mm."""
    low, high = np.array(field.low_mm)[:2], np.array(field.high_mm)[:2]
    if region is not None:
        low, high = np.maximum(low, region[0][:2]), np.minimum(high, region[1][:2])
    if not (high - low > 16e-3 * np.array(field.pixel_um)).all():
        raise CameraError(
            "the region that is looked at lies outside the profiler's field, "
            f"{field.low_mm} to {field.high_mm} mm"
        )
    return low, high


def _surface(
    ink: Laid, field: ProfilerField, low: FloatArray, pitch: FloatArray, shape: tuple[int, int]
) -> SingleArray:
    """Height of plate and ink over the plate, (rows, columns), mm."""
    out = np.zeros(shape, dtype=np.float32)
    lines = ink.strands
    if not len(lines):
        return out
    width = BeadSection("rounded").width(lines.area_mm2, ink.height_mm)
    # Lines are drawn on square cells; where a profiler's aren't, on ones as fine as the finer.
    fine = float(pitch.min())
    square = (math.ceil(shape[0] * pitch[1] / fine), math.ceil(shape[1] * pitch[0] / fine))
    ends = [(one[:, :2] - low) / fine - 0.5 for one in (lines.start, lines.end)]
    tip = np.column_stack([lines.start[:, 2], lines.end[:, 2]]) - field.plate_z_mm
    crest = np.zeros(square, np.float32)
    nothing = np.zeros(square, np.float32)
    draw_lines(
        np.column_stack(ends), width / 2 / fine, tip, ink.height_mm, np.ones(len(lines)), _SHOULDER,
        nothing, math.inf, np.zeros(square, np.float32), crest,
    )  # fmt: skip
    if square != shape:
        crest = np.asarray(cv2.resize(crest, shape[::-1], interpolation=cv2.INTER_AREA))
    return crest


def _lost(
    truth: SingleArray, field: ProfilerField, pitch: FloatArray, rng: np.random.Generator
) -> BoolArray:
    """Where the camera doesn't see the laser's line, (rows, columns)."""
    down = np.gradient(truth, pitch[1], axis=0)
    across = np.gradient(truth, pitch[0], axis=1)
    steep = np.hypot(down, across) > math.tan(math.radians(field.steepest_deg))
    lost = steep & (rng.random(truth.shape) < 0.8)
    # A ray to the camera rises by `rise` for each mm along y.
    rise = 1.0 / math.tan(math.radians(field.angle_deg))
    sight = truth - (rise * pitch[1] * np.arange(len(truth)))[:, None]
    above = np.maximum.accumulate(sight[::-1], axis=0)[::-1]
    lost |= above > sight + 1e-6
    mirrors = np.abs(np.arctan(-down) - math.radians(field.angle_deg) / 2) < _MIRRORED
    lost |= mirrors & _patches(truth.shape, field.wet, SURFACE.wet_mm / pitch, rng)
    spots = field.lost_per_mm2 * SURFACE.spot_mm**2
    return np.asarray(lost | _patches(truth.shape, spots, SURFACE.spot_mm / pitch, rng))


def _patches(
    shape: tuple[int, ...], share: float, size_px: FloatArray, rng: np.random.Generator
) -> BoolArray:
    """Round patches of a size that cover a share of all, (rows, columns)."""
    if share <= 0:
        return np.zeros(shape, dtype=np.bool_)
    noise = cv2.GaussianBlur(
        rng.normal(size=shape).astype(np.float32), (0, 0), float(size_px[0]) / 2,
        sigmaY=float(size_px[1]) / 2,
    )  # fmt: skip
    return np.asarray(noise >= np.quantile(noise, 1.0 - min(share, 1.0)))


def _seen(
    truth: SingleArray, lost: BoolArray, field: ProfilerField, pitch: FloatArray
) -> SingleArray:
    """Mean of what is seen of the line's thickness, per cell of the profiler; NaN where most isn't.

    A line that is half hidden is measured by its other half: the middle of the light that is seen.
    """
    weight = (~lost).astype(np.float32)
    thick = max(1e-3 * field.spot_um / float(pitch[1]), 0.01)
    kernel = (0, 0)
    parts = [cv2.GaussianBlur(one, kernel, 0.5, sigmaY=thick) for one in (weight * truth, weight)]
    size = (truth.shape[1] // SURFACE.finer, truth.shape[0] // SURFACE.finer)
    total, share = (cv2.resize(one, size, interpolation=cv2.INTER_AREA) for one in parts)
    own = cv2.resize(weight, size, interpolation=cv2.INTER_AREA)
    return np.where(own >= 0.5, total / np.maximum(share, 1e-6), np.nan).astype(np.float32)


def write_heights(
    path: Path, heights: SingleArray, to_map: FloatArray, pixel_um: tuple[float, float]
) -> None:
    """Write a height map as .npz: ``height_mm``, ``pixel_mm`` and ``printer_to_scan`` (4, 4)."""
    np.savez(path, height_mm=heights, pixel_mm=1e-3 * np.array(pixel_um), printer_to_scan=to_map)
