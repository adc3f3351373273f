"""Measure geometric characteristics (ISO 1101) of axes, mouths, walls and faces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import coo_matrix, csr_matrix
from scipy.spatial import cKDTree

from design.geometry.polyline import vectors_across
from kernels.arrays import FloatArray
from registration.alignment.distance import ModelSurface
from registration.alignment.uncertainty import BLUR_PART, ScanErrors
from registration.measuring.gauging.vessels import VesselGauge
from registration.measuring.geometry.datum_fit import Setting, light_shift, mouth
from registration.measuring.geometry.faces import Face
from registration.measuring.geometry.frame import COVERAGE, IN_PLANE, Frame, strains
from registration.measuring.geometry.lumen import ALPHA, DRAWS, Line, Lumen, cells, unit
from registration.measuring.geometry.scene import Cut, Scene

Name = Literal["axis", "port", "cylindricity", "lumen", "face"]
LEVEL = 97.5


@dataclass(frozen=True)
class Characteristic:
    """Width of the least zone that holds a feature, with its 95 % interval.

    Attributes
    ----------
    name : str
        ``axis``: position of a vessel's axis, of a curved one profile of a line: diameter of the
        zone about the designed axis; ``port``: position of a mouth, diameter; ``cylindricity``:
        radial width; ``lumen``, ``face``: profile of a surface, width of the zone about the
        designed surface.
    feature : str
        Like ``vessel 3``, ``outlet 3``, ``face +x``.
    words : str
        Of the characteristic, to be read.
    vessel : int or None
    zone_um : float, µm
        As measured: twice the largest distance from the design, or a difference of radii. Nothing
        is taken off for noise, which makes a largest value larger. NaN where there is none.
    low_um, high_um : float, µm
        95 % interval of the true value.
    seen : float
        Share of the feature that the value holds for.
    note : str
        Why there is no value.
    """

    name: Name
    feature: str
    words: str
    vessel: int | None = None
    zone_um: float = float("nan")
    low_um: float = float("nan")
    high_um: float = float("nan")
    seen: float = 0.0
    note: str = ""


@dataclass(frozen=True)
class Zone:
    """A measured zone and what makes it uncertain, mm.

    Attributes
    ----------
    width : float, mm
        As measured.
    of_noise : (d,) float64, mm
        Widths that noise alone would show.
    at_place : float, mm
        Half width of the 95 % interval by noise of the value at the worst place alone.
    shared : float, mm
        Half width by what errs together: frame, level of walls, scales.
    """

    width: float
    of_noise: FloatArray
    at_place: float
    shared: float

    def interval(self) -> tuple[float, float]:
        """95 % interval of the true width, mm.

        A zone's width is subadditive. Measured = true + noise therefore is at most true width plus
        that of noise alone: true >= measured - noise's. It is at least what is seen at the place
        of the true extreme: true <= measured + error at one place. The first takes the whole bias
        of a maximum over noisy places, as if the true form were flat.
        """
        usual = float(np.mean(self.of_noise))
        beyond = float(np.percentile(self.of_noise, LEVEL)) - usual
        low = self.width - usual - float(np.hypot(beyond, self.shared))
        return max(low, 0.0), self.width + float(np.hypot(self.at_place, self.shared))


_STEPS = 2
_FIRST = 50
"""Points farthest out and farthest in that the first programme holds."""


def minimum_zone(points: FloatArray, middle: FloatArray, direction: FloatArray) -> float:
    """Difference of the radii of two coaxial cylinders that hold points (n, 3) between them, mm.

    The least there is near the given axis (ISO 1101:2017, 17.6; minimum zone): radii linear in a
    small shift and tilt of the axis make it a linear programme, solved again about each answer.
    Points are added until none lies outside the zone.
    """
    centre, axis = np.array(middle, dtype=np.float64), unit(direction)
    for _ in range(_STEPS):
        side, other = vectors_across(axis)
        away = points - centre
        along, x, y = away @ axis, away @ side, away @ other
        step = _programme(along, x, y)
        centre = centre + step[0] * side + step[1] * other
        axis = unit(axis + step[2] * side + step[3] * other)
    away = points - centre
    radius = np.linalg.norm(away - (away @ axis)[:, None] * axis, axis=1)
    return float(np.ptp(radius))


def _programme(along: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
    """Shift (2) and tilt (2) of the axis that make the shell thinnest."""
    radius = np.maximum(np.hypot(x, y), 1e-9)
    reach = max(float(np.abs(along).max()), 1e-9)
    slope = -np.column_stack([x, y, x * along / reach, y * along / reach]) / radius[:, None]
    order = np.argsort(radius)
    used = np.zeros(len(radius), dtype=np.bool_)
    used[order[:_FIRST]] = used[order[-_FIRST:]] = True
    step = np.zeros(4)
    for _ in range(6):
        ones = np.ones(int(used.sum()))
        # Of step, outer and inner radius: r + slope step <= outer, >= inner.
        above = np.column_stack([slope[used], -ones, 0 * ones])
        below = np.column_stack([-slope[used], 0 * ones, ones])
        solution = linprog(
            [0, 0, 0, 0, 1, -1],
            np.vstack([above, below]),
            np.concatenate([-radius[used], radius[used]]),
            bounds=[(-0.1, 0.1)] * 4 + [(None, None)] * 2,
            method="highs-ds",
        )
        if solution.x is None:
            break
        step = solution.x[:4]
        moved = radius + slope @ step
        outside = (moved > solution.x[4] + 1e-9) | (moved < solution.x[5] - 1e-9)
        if not (outside & ~used).any():
            break
        used |= outside
    return np.concatenate([step[:2], step[2:] / reach])


POSITION = "position of the axis"
LINE_PROFILE = "profile of a line, axis"
PORT = "position of the mouth"
CYLINDRICITY = "cylindricity of the lumen"
SURFACE = "profile of a surface"


@dataclass(frozen=True)
class Case:
    """One vessel, its frame and sections.

    Attributes
    ----------
    vessel : int
    line : Line
    lumen : Lumen or None
        None where too few whole sections were measured.
    gauged : float
        Share of its length with a section.
    """

    vessel: int
    line: Line
    lumen: Lumen | None
    gauged: float


def row(case: Case, name: Name, words: str, zone: Zone) -> Characteristic:
    """Return the row of a measured zone."""
    low, high = zone.interval()
    return Characteristic(
        name, f"vessel {case.vessel}", words, case.vessel, 1e3 * zone.width, 1e3 * low, 1e3 * high,
        case.gauged,
    )  # fmt: skip


def unmeasured_row(case: Case, name: Name, words: str, note: str) -> Characteristic:
    """Return the row of what wasn't measured, and why."""
    return Characteristic(name, f"vessel {case.vessel}", words, case.vessel, note=note)


def without_mouth(case: Case, last: bool, note: str) -> Characteristic:
    """Return the row of a mouth that wasn't measured, and why."""
    return Characteristic("port", mouth_name(case, last), PORT, case.vessel, note=note)


def no_cylinder(case: Case) -> Characteristic | None:
    """Say where a design is no cylinder; None where it is one."""
    if case.line.straight and case.line.even:
        return None
    shape = "tapered" if case.line.straight else "curved"
    return unmeasured_row(case, "cylindricity", CYLINDRICITY, f"not defined: the design is {shape}")


def mouth_name(case: Case, last: bool) -> str:
    """Return the name of a mouth as datums have it."""
    return f"{'outlet' if last else 'inlet'} {case.vessel}"


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


CUT_OFF_MM = 0.8
"""Of the Gaussian over a face (ISO 4288's and ISO 25178-3's usual nesting index)."""
CELL_MM = 0.2
APART_MM = 0.6
"""Between places whose noise is compared."""
NORMAL_QUARTILE = 0.6745
_LEAST_CELLS = 30


def face_zone(
    face: Face, surface: ModelSurface, frame: Frame, errors: ScanErrors
) -> Characteristic:
    """Twice the largest filtered distance of one outer face from the design.

    Places are averaged in cells of 0.2 mm and filtered by a Gaussian over distance (areal, after
    ISO 16610-61), cells weighed by their places.
    """
    characteristic = Characteristic("face", face.name, SURFACE, seen=face.seen, note="not seen")
    places = frame.fit.apply(face.scanned)
    if len(places) == 0:
        return characteristic
    height = _height(face, surface, places)
    cell = cells(places, CELL_MM)
    count = np.bincount(cell).astype(np.float64)
    if len(count) < _LEAST_CELLS:
        return characteristic
    middle = np.column_stack([np.bincount(cell, column) / count for column in places.T])
    mean = np.bincount(cell, height) / count
    smooth = _gaussian(middle, count)
    off = smooth @ mean
    drawn = smooth @ np.random.default_rng(0).standard_normal((len(count), DRAWS))
    noise = _noise(middle, off[:, None])
    if not np.isfinite(noise):
        return characteristic
    drawn *= noise / max(_noise(middle, drawn), 1e-12)
    worst = int(np.abs(off).argmax())
    normal = face.normal if face.normal is not None else frame.fit.rotation @ errors.beam
    zone = Zone(
        2 * float(np.abs(off[worst])),
        2 * np.abs(drawn).max(axis=0),
        2 * COVERAGE * float(drawn.std()),
        2 * _shared(middle[worst], normal, frame, errors),
    )
    low, high = zone.interval()
    return Characteristic(
        "face", face.name, SURFACE, None, 1e3 * zone.width, 1e3 * low, 1e3 * high, face.seen
    )


def _height(face: Face, surface: ModelSurface, places: FloatArray) -> FloatArray:
    if face.normal is None:
        return surface.query(places).distance
    return np.asarray((places - face.point) @ face.normal)


def _gaussian(middle: FloatArray, count: FloatArray) -> csr_matrix:
    """Rows of weights that sum to 1."""
    reach = ALPHA * CUT_OFF_MM
    pairs = cKDTree(middle).query_pairs(reach, output_type="ndarray")
    a = np.concatenate([pairs[:, 0], pairs[:, 1], np.arange(len(count))])
    b = np.concatenate([pairs[:, 1], pairs[:, 0], np.arange(len(count))])
    away = ((middle[a] - middle[b]) ** 2).sum(axis=1)
    weight = coo_matrix((count[b] * np.exp(-np.pi * away / reach**2), (a, b))).tocsr()
    whole = np.asarray(weight.sum(axis=1)).reshape(-1)
    return csr_matrix(weight.multiply(1.0 / whole[:, None]))


def _noise(middle: FloatArray, off: FloatArray) -> float:
    """Standard deviation of filtered heights (n, k), by second differences along the axes.

    Robust. Places stand so far apart that they share no noise through the filter; a slope has none.
    NaN where no three of them lie so in a row.
    """
    tree = cKDTree(middle)
    noises = []
    for way in APART_MM * np.eye(3):
        (ahead_mm, ahead), (back_mm, back) = tree.query(middle + way), tree.query(middle - way)
        both = np.maximum(ahead_mm, back_mm) < 0.75 * CELL_MM
        noises.append((off[ahead] - 2 * off + off[back])[both] / np.sqrt(6))
    every = np.concatenate(noises)
    return float(np.median(np.abs(every)) / NORMAL_QUARTILE) if len(every) else float("nan")


def _shared(place: FloatArray, normal: FloatArray, frame: Frame, errors: ScanErrors) -> float:
    """Half width by frame and level, mm."""
    light = float((frame.fit.rotation @ errors.beam) @ normal) ** 2
    level = np.sqrt(errors.outer_mm**2 + errors.faint_mm**2 + (light * errors.facing_mm) ** 2)
    return float(np.hypot(frame.along_mm(place, normal), COVERAGE * level))


def cuts_of(vessels: tuple[VesselGauge, ...]) -> tuple[Cut, ...]:
    """Return the measured sections of gauged vessels."""
    return tuple(Cut(v.along_mm, v.outlines, 1e-3 * v.noise_um) for v in vessels)


def characteristics(
    scene: Scene, gauged: tuple[float, ...], surface: ModelSurface, frame: Frame
) -> tuple[Characteristic, ...]:
    """Return the zones of every vessel, mouth and outer face.

    Parameters
    ----------
    scene : Scene
    gauged : tuple of float
        Share of each vessel's length with a measured section.
    surface : ModelSurface
    frame : Frame
    """
    ends: dict[int, list[bool]] = {}
    for vessel, last in scene.mouths():
        ends.setdefault(vessel, []).append(last)
    rows: list[Characteristic] = []
    for vessel, share in enumerate(gauged):
        line = Line.of(scene.network, vessel)
        case = Case(vessel, line, scene.lumen(vessel, frame.fit), share)
        rows += vessel_zones(case, ends.get(vessel, []), frame, scene.errors)
    return (*rows, *(face_zone(face, surface, frame, scene.errors) for face in scene.faces))
