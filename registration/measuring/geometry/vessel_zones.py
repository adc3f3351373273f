"""Measure the zone widths (ISO 1101) of a vessel's axis, mouths and wall, with intervals."""

from __future__ import annotations

import numpy as np

from kernels.arrays import FloatArray
from registration.alignment.uncertainty import BLUR_PART, ScanErrors
from registration.measuring.geometry.characteristic import Characteristic, Zone
from registration.measuring.geometry.cylinder import minimum_zone
from registration.measuring.geometry.fit_state import Setting, light_shift
from registration.measuring.geometry.frame import COVERAGE, IN_PLANE, Frame, strains
from registration.measuring.geometry.lumen import Lumen
from registration.measuring.geometry.mouth import mouth
from registration.measuring.geometry.vessel_rows import (
    CYLINDRICITY,
    LINE_PROFILE,
    PORT,
    POSITION,
    SURFACE,
    Case,
    mouth_name,
    no_cylinder,
    row,
    unmeasured_row,
    without_mouth,
)


def vessel_zones(
    case: Case, ends: list[bool], frame: Frame, errors: ScanErrors
) -> list[Characteristic]:
    """Return all characteristics of one vessel; `ends`: its mouths, whether at the last node."""
    rng = np.random.default_rng(case.vessel)
    axis = POSITION if case.line.straight else LINE_PROFILE
    unknown = "too few whole sections were measured"
    lumen = case.lumen
    if lumen is None:
        rows = [unmeasured_row(case, "axis", axis, unknown)]
        rows += [without_mouth(case, last, unknown) for last in ends]
        rows += [no_cylinder(case) or unmeasured_row(case, "cylindricity", CYLINDRICITY, unknown)]
        return [*rows, unmeasured_row(case, "lumen", SURFACE, unknown)]
    rows = [row(case, "axis", axis, _axis(lumen, frame, errors, rng))]
    rows += [_port(case, lumen, last, frame, errors) for last in ends]
    wall = lumen.drawn_walls(rng)
    rows.append(
        no_cylinder(case)
        or row(case, "cylindricity", CYLINDRICITY, _cylinder(lumen, wall, frame, errors))
    )
    return [*rows, row(case, "lumen", SURFACE, _surface(lumen, wall, frame, errors))]


def _axis(lumen: Lumen, frame: Frame, errors: ScanErrors, rng: np.random.Generator) -> Zone:
    """Twice the largest distance of the filtered axis from the designed one."""
    off = np.linalg.norm(lumen.middle - lumen.line.nearest(lumen.middle)[0], axis=1)
    noise = 2 * np.linalg.norm(lumen.drawn_middles(rng), axis=-1).max(axis=1)
    worst = int(off.argmax())
    return Zone(
        2 * float(off[worst]),
        noise,
        2 * IN_PLANE * lumen.shared(lumen.filter[worst]),
        2 * _placed(lumen, frame, errors),
    )


def _placed(lumen: Lumen, frame: Frame, errors: ScanErrors) -> float:
    """Radius within which the frame and the light leave the axis, worst place, 95 %, mm."""
    ways = np.gradient(lumen.middle, axis=0)
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    worst = max(
        frame.across_mm(lumen.middle[k], ways[k]) for k in (0, len(ways) // 2, len(ways) - 1)
    )
    return float(np.hypot(worst, COVERAGE * _light(frame, errors)))


def _light(frame: Frame, errors: ScanErrors) -> float:
    return light_shift(Setting(frame.fit, errors, strains(frame.fit, errors)))


def _port(case: Case, lumen: Lumen, last: bool, frame: Frame, errors: ScanErrors) -> Characteristic:
    """Twice the distance of the axis, carried on to the mouth, from the designed one."""
    there = mouth(lumen, last)
    if there is None:
        return without_mouth(case, last, "no section was measured within a diameter of it")
    off = float(np.linalg.norm(there.off))
    placed = np.hypot(frame.across_mm(there.node, there.way), COVERAGE * _light(frame, errors))
    noise = np.hypot(IN_PLANE * there.noise_mm, placed)
    low, high = max(off - noise, 0.0), off + noise
    return Characteristic(
        "port", mouth_name(case, last), PORT, case.vessel, 2e3 * off, 2e3 * float(low),
        2e3 * float(high), 1.0,
    )  # fmt: skip


def _cylinder(lumen: Lumen, drawn: FloatArray, frame: Frame, errors: ScanErrors) -> Zone:
    """Difference of the radii of two coaxial cylinders that hold the filtered wall."""
    points = lumen.wall.reshape(-1, 3)
    width = minimum_zone(points, lumen.middle.mean(axis=0), _way(lumen))
    flat = drawn.reshape(len(drawn), -1)
    in_depth, radius = _in_depth(lumen, frame, errors), float(lumen.line.radius.max())
    # Walls that face the light move by themselves, and depth is stretched against width.
    shared = np.hypot(errors.facing_mm, radius * np.hypot(errors.depth, errors.lateral)) * in_depth
    return Zone(
        width,
        np.ptp(flat, axis=1),
        COVERAGE * np.sqrt(2) * float(flat.std()),
        COVERAGE * float(shared),
    )


def _surface(lumen: Lumen, drawn: FloatArray, frame: Frame, errors: ScanErrors) -> Zone:
    """Twice the largest distance of the filtered wall from the designed one."""
    points = lumen.wall.reshape(-1, 3)
    foot, radius = lumen.line.nearest(points)
    out = points - foot
    away = np.linalg.norm(out, axis=1)
    off = np.abs(away - radius)
    worst = int(off.argmax())
    way = out[worst] / max(away[worst], 1e-12)
    flat = drawn.reshape(len(drawn), -1)
    level = np.sqrt(
        errors.level_mm**2
        + errors.faint_mm**2
        + (_in_depth(lumen, frame, errors) * errors.facing_mm) ** 2
        + (BLUR_PART * errors.blur_mm**2 / radius[worst]) ** 2
    )
    placed = max(frame.along_mm(points[worst], way), _placed(lumen, frame, errors))
    return Zone(
        2 * float(off[worst]),
        2 * np.abs(flat).max(axis=1),
        2 * COVERAGE * float(flat.std()),
        2 * float(np.hypot(placed, COVERAGE * level)),
    )


def _way(lumen: Lumen) -> FloatArray:
    return np.asarray(lumen.line.points[-1] - lumen.line.points[0])


def _in_depth(lumen: Lumen, frame: Frame, errors: ScanErrors) -> float:
    """Square of the beam's part across the vessel."""
    way = _way(lumen) / np.linalg.norm(_way(lumen))
    return 1.0 - float((frame.fit.rotation @ errors.beam) @ way) ** 2
