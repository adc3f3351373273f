"""Simulated dye video: dye driven through a transparent print, filmed from one side.

Lumens with occlusions, the flow in each, laminar transport of dye, and the picture: Beer-Lambert
absorption in three colours, a tilted camera and its perspective, uneven light, grain, blur, drift,
shake, shot and read noise. Not modelled: refraction at the lumens, bubbles, dye that stains the
gel, rolling shutter.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array, csr_array
from scipy.sparse.linalg import spsolve

from kernels.arrays import FloatArray, IntArray
from printctl.analysis.film import write_frames

_STAGNANT = 1e-9


class DyeVessels(Protocol):
    """Vessels as polylines with a radius at each point, mm; see `design.network`."""

    @property
    def nodes(self) -> FloatArray:
        """Where vessels meet or end, (m, 3), mm."""

    @property
    def vessel_nodes(self) -> IntArray:
        """First and last node of each vessel, (v, 2)."""

    @property
    def offset(self) -> IntArray:
        """Points of vessel i are ``offset[i]:offset[i + 1]``."""

    @property
    def points(self) -> FloatArray:
        """Polylines, (p, 3), mm."""

    @property
    def radius(self) -> FloatArray:
        """Lumen radius at each point, (p,), mm."""


@dataclass(frozen=True)
class Occlusion:
    """Closed vessel of a simulated dye video.

    Attributes
    ----------
    vessel : int
    at : float
        Where, as a share of its length from its first node.
    seep_ul_s : float, µL/s
        What leaks into the gel at the closure; 0 leaves the liquid before it at rest.
    """

    vessel: int
    at: float = 0.5
    seep_ul_s: float = 0.0


@dataclass(frozen=True)
class Stretch:
    """A vessel, or what an occlusion leaves of one.

    Attributes
    ----------
    points : (k, 3) float64, mm
    radius : (k,) float64, mm
    first, last : int
        Nodes.
    """

    points: FloatArray
    radius: FloatArray
    first: int
    last: int

    def along(self) -> FloatArray:
        """Length from the first point to each, (k,), mm."""
        steps = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    def volumes(self) -> FloatArray:
        """Volume from the first point to each, (k,), µL; every piece a frustum."""
        a, b = self.radius[:-1], self.radius[1:]
        parts = np.pi / 3.0 * np.diff(self.along()) * (a * a + a * b + b * b)
        return np.concatenate([[0.0], np.cumsum(parts)])

    def resistance(self) -> float:
        """Poiseuille's at unit viscosity, (8/π) Σ ℓ (a² + ab + b²)/(3 a³ b³), mm⁻³."""
        a, b = self.radius[:-1], self.radius[1:]
        shape = (a * a + a * b + b * b) / (3.0 * (a * b) ** 3)
        return float(8.0 / np.pi * (np.diff(self.along()) * shape).sum())


def stretches(
    lumens: DyeVessels, occlusions: Sequence[Occlusion]
) -> tuple[list[Stretch], dict[int, float]]:
    """All that liquid can stand in, and µL/s that leave at the closed nodes of occlusions.

    What lies behind an occlusion hangs on its last node as a dead end.
    """
    made: list[Stretch] = []
    sinks: dict[int, float] = {}
    closed, fresh = {o.vessel: o for o in occlusions}, len(lumens.nodes)
    for vessel, (first, last) in enumerate(lumens.vessel_nodes.tolist()):
        part = slice(int(lumens.offset[vessel]), int(lumens.offset[vessel + 1]))
        whole = Stretch(lumens.points[part], lumens.radius[part], first, last)
        if vessel not in closed:
            made.append(whole)
            continue
        made += _cut(whole, closed[vessel].at, fresh)
        sinks[fresh] = closed[vessel].seep_ul_s
        fresh += 2
    return made, sinks


def _cut(whole: Stretch, share: float, fresh: int) -> list[Stretch]:
    along = whole.along()
    at = float(np.clip(share, 0.02, 0.98)) * along[-1]
    point = np.array([np.interp(at, along, column) for column in whole.points.T])[None]
    radius = np.interp([at], along, whole.radius)
    before, after = along < at, along > at
    return [
        Stretch(np.vstack([whole.points[before], point]),
                np.append(whole.radius[before], radius), whole.first, fresh),
        Stretch(np.vstack([point, whole.points[after]]),
                np.append(radius, whole.radius[after]), fresh + 1, whole.last),
    ]  # fmt: skip


def stretch_flow(
    parts: Sequence[Stretch],
    inlets: Sequence[int],
    outlets: Sequence[int],
    inflow_ul_s: float,
    sinks: Mapping[int, float],
) -> FloatArray:
    """Flow in each stretch from its first node to its last, (n,), µL/s.

    Kirchhoff's equations, inlets at one pressure, outlets at zero; the inlets' pressure follows
    from the inflow. Shares no code with `design.hemodynamics`.
    """
    ends = np.array([(p.first, p.last) for p in parts])
    used, slot = np.unique(ends, return_inverse=True)
    slot = slot.reshape(ends.shape)
    conductance = 1.0 / np.array([part.resistance() for part in parts])
    held = np.isin(used, [*inlets, *outlets])
    driving = np.isin(used, list(inlets)).astype(np.float64)
    lost = np.array([sinks.get(int(node), 0.0) for node in used])
    pulled = _pressure(slot, conductance, held, driving, np.zeros(len(used)))
    seeping = _pressure(slot, conductance, held, np.zeros(len(used)), lost)
    q = [conductance * (p[slot[:, 0]] - p[slot[:, 1]]) for p in (pulled, seeping)]
    enters = [_leaving(slot, flow, len(used))[driving > 0].sum() for flow in q]
    flow: FloatArray = q[1] + (inflow_ul_s - enters[1]) / enters[0] * q[0]
    flow[np.abs(flow) < _STAGNANT * inflow_ul_s] = 0.0
    return flow


def _leaving(slot: IntArray, flow: FloatArray, count: int) -> FloatArray:
    first, last = (np.bincount(end, weights=flow, minlength=count) for end in slot.T)
    return np.asarray(first - last)


def _pressure(
    slot: IntArray,
    conductance: FloatArray,
    held: NDArray[np.bool_],
    given: FloatArray,
    lost: FloatArray,
) -> FloatArray:
    first, last = slot.T
    rows = np.concatenate([first, last, first, last])
    columns = np.concatenate([first, last, last, first])
    values: Any = np.concatenate([conductance] * 2 + [-conductance] * 2)
    size = len(held)
    matrix = coo_array((values, (rows, columns)), shape=(size, size)).tocsr()
    free = np.flatnonzero(~held)
    pressure = np.where(held, given, 0.0)
    # A stagnant dead end still has a pressure: it hangs on one conductance.
    joined = matrix + coo_array((np.full(size, 1e-15), (np.arange(size),) * 2)).tocsr()
    right = (-lost - matrix @ pressure)[free]
    if len(free):
        pressure[free] = spsolve(joined[free][:, free].tocsc(), right)
    return pressure


# Laminar transport of dye along the lumens, for simulated dye videos.
#
# Modelled: in each vessel Poiseuille's profile, cut into annuli of equal area, each carried at its
# own speed by a second-order finite-volume scheme (upwind with minmod slopes); at a node flows mix
# wholly, or keep their annulus (`mixing` between 1 and 0 blends the two); occlusions; a feed tube
# of some volume. Not modelled: diffusion (Péclet numbers are 10⁴ and more), entrance lengths,
# secondary flow in bends, the way streamlines really divide at a bifurcation, pulsation, stretching
# walls.

ANNULI = 16
_MOST_CELLS, _COURANT, _MOST_STEPS, _FINEST = 160, 0.9, 24, 40.0


@dataclass(frozen=True)
class DyeFlow:
    """A flow that dye can be let into.

    Attributes
    ----------
    parts : sequence of Stretch
        Turned so that flow runs from first to last.
    flow_ul_s : (n,) float64
        Of each, not negative.
    inlets : tuple of int
    feed_s : float, s
        Mean transit of a feed tube before the inlets, entered by the dye at time zero.
    mixing : float
        1: flows mix wholly at nodes; 0: dye stays in its annulus.
    """

    parts: Sequence[Stretch]
    flow_ul_s: FloatArray
    inlets: tuple[int, ...]
    feed_s: float = 0.0
    mixing: float = 1.0

    def entering(self, time_s: float) -> float:
        """Concentration at the inlets; a laminar tube's response to a step, 1 - (T/2t)²."""
        if time_s < self.feed_s / 2.0 or time_s < 0.0:
            return 0.0
        return 1.0 - (self.feed_s / (2.0 * time_s)) ** 2 if self.feed_s > 0.0 else 1.0


def dye_flow(
    lumens: DyeVessels,
    inflow_ul_s: float,
    occlusions: Sequence[Occlusion] = (),
    feed_ul: float = 0.0,
    mixing: float = 1.0,
) -> DyeFlow:
    """Solve the flow of what the occlusions leave.

    Raises
    ------
    ValueError
        When the lumens have no inlet or no outlet.
    """
    first, last = (set(column.tolist()) for column in lumens.vessel_nodes.T)
    inlets, outlets = sorted(first - last), sorted(last - first)
    if not inlets or not outlets:
        raise ValueError("lumens without an inlet or outlet: no node that vessels only leave")
    parts, sinks = stretches(lumens, occlusions)
    flow = stretch_flow(parts, inlets, outlets, inflow_ul_s, sinks)
    turned = [
        part if q >= 0.0 else Stretch(part.points[::-1], part.radius[::-1], part.last, part.first)
        for part, q in zip(parts, flow, strict=True)
    ]
    return DyeFlow(turned, np.abs(flow), tuple(inlets), feed_ul / inflow_ul_s, mixing)


class Transport:
    """Concentrations in cells of equal volume along each stretch, annulus by annulus.

    Attributes
    ----------
    first : (n + 1,) int64
        Cells of stretch ``i`` are ``first[i]:first[i + 1]``.
    dye : (cells, ANNULI) float64
        Concentration, 1 in the feed; the innermost annulus first.
    """

    def __init__(self, flow: DyeFlow, frame_s: float):
        self._flow = flow
        volume = np.array([part.volumes()[-1] for part in flow.parts])
        with np.errstate(divide="ignore"):
            transit = np.where(flow.flow_ul_s > 0.0, volume / flow.flow_ul_s, np.inf)
        quick = float(transit.min()) / _FINEST
        self.steps = int(np.clip(np.ceil(frame_s / (_COURANT * quick)), 1, _MOST_STEPS))
        self._dt = frame_s / self.steps
        with np.errstate(invalid="ignore"):
            count = np.clip(_COURANT * transit / (2.0 * self._dt), 1, _MOST_CELLS).astype(np.int64)
        self.first: IntArray = np.concatenate([[0], np.cumsum(count)])
        share = (np.arange(ANNULI) + 0.5) / ANNULI
        self._profile = 2.0 * (1.0 - share)
        of_cell = np.repeat(np.arange(len(count)), count)
        turnover = (flow.flow_ul_s * self._dt / (volume / count))[of_cell]
        self._courant = np.minimum(turnover[:, None] * self._profile, 1.0)
        self.dye: FloatArray = np.zeros((len(of_cell), ANNULI))
        self._ends = np.array([(p.first, p.last) for p in flow.parts])
        self._time = 0.0

    def frames(self, times_s: FloatArray, start_s: float) -> Iterator[FloatArray]:
        """The concentrations at each of evenly spaced times; dye enters the feed at ``start_s``."""
        self._time = float(times_s[0]) - start_s
        yield self.dye
        for _ in times_s[1:]:
            for _ in range(self.steps):
                self._step()
            yield self.dye

    def _step(self) -> None:
        heads, tails = self.first[:-1], self.first[1:] - 1
        before = np.empty_like(self.dye)
        before[1:] = self.dye[:-1]
        before[heads] = self._at_nodes()[self._ends[:, 0]]
        after = np.empty_like(self.dye)
        after[:-1] = self.dye[1:]
        after[tails] = self.dye[tails]
        low, high = self.dye - before, after - self.dye
        slope = np.where(low * high > 0.0, np.sign(low) * np.minimum(abs(low), abs(high)), 0.0)
        leaving = self._courant * (self.dye + 0.5 * (1.0 - self._courant) * slope)
        entering = np.empty_like(leaving)
        entering[1:] = leaving[:-1]
        entering[heads] = self._courant[heads] * before[heads]
        self.dye = self.dye + entering - leaving
        self._time += self._dt

    def _at_nodes(self) -> FloatArray:
        """Concentration that enters each annulus of what leaves a node, (m, ANNULI)."""
        count = int(self._ends.max()) + 1
        arriving = self.dye[self.first[1:] - 1]
        flow, node = self._flow.flow_ul_s, self._ends[:, 1]
        into = np.bincount(node, weights=flow, minlength=count)
        kept = np.zeros((count, ANNULI))
        np.add.at(kept, node, flow[:, None] * arriving)
        kept /= np.maximum(into, 1e-300)[:, None]
        mixed = kept @ (self._profile / ANNULI)
        made: FloatArray = self._flow.mixing * mixed[:, None] + (1.0 - self._flow.mixing) * kept
        made[list(self._flow.inlets)] = self._flow.entering(self._time)
        return made


@dataclass(frozen=True)
class Dye:
    """Dye and its optical properties.

    Attributes
    ----------
    absorbance_per_mm : (float, float, float)
        Naperian, of blue, green and red light. The default is a blue food dye.
    fluorescence_per_mm : float
        Grey levels per mm of dye, on a dark background; 0 for a dye that absorbs.
    """

    absorbance_per_mm: tuple[float, float, float] = (0.15, 0.5, 1.2)
    fluorescence_per_mm: float = 0.0


@dataclass(frozen=True)
class Disturbance:
    """Disturbances of a dye video.

    Attributes
    ----------
    noise : float
        Read noise, grey levels; shot noise comes on top.
    blur_px : float
        Standard deviation of the point spread.
    drift : float
        Relative change of the light over the film, a slow wave on it, and a third as much
        of a slope across the picture.
    shake_px : float
        Standard deviation of the picture's wandering.
    texture : float
        Relative grain of the background.
    """

    noise: float = 1.5
    blur_px: float = 1.0
    drift: float = 0.0
    shake_px: float = 0.0
    texture: float = 0.03


@dataclass(frozen=True)
class DyeCamera:
    """A camera: distant, or a pinhole at some distance, straight above or tilted.

    Attributes
    ----------
    width, height : int
        Pixels.
    px_per_mm : float
    centre_mm : (float, float, float)
        Part's point in the middle of the picture.
    turn_deg : float
        Clockwise turn of the picture.
    side : str
        The camera's side of the part: z, -z, x, -x, y or -y.
    mirrored : bool
        Filmed by way of a mirror.
    tilt_deg : float
        Of the line of sight from straight above: what is lower in the picture (before it is
        turned) comes nearer.
    distance_mm : float
        Pinhole to ``centre_mm``; without end by default, so that no perspective is seen.
    """

    width: int = 640
    height: int = 360
    px_per_mm: float = 36.0
    centre_mm: tuple[float, float, float] = (8.0, 4.0, 1.5)
    turn_deg: float = 0.0
    side: Literal["z", "-z", "x", "-x", "y", "-y"] = "z"
    mirrored: bool = False
    tilt_deg: float = 0.0
    distance_mm: float = np.inf

    def pixels(self, points: FloatArray) -> FloatArray:
        """Where points (n, 3), mm, are seen, (n, 2); (0, 0) is the first pixel's middle."""
        right, down, _ = self._axes()
        seen = points - np.array(self.centre_mm)
        flat = np.stack([seen @ right, seen @ down], axis=1) * self.scales(points)[:, None]
        angle = np.radians(self.turn_deg)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        flat = flat @ turn.T
        if self.mirrored:
            flat[:, 0] *= -1.0
        placed: FloatArray = flat + [(self.width - 1) / 2.0, (self.height - 1) / 2.0]
        return placed

    def scales(self, points: FloatArray) -> FloatArray:
        """Size of things at points (n, 3), not foreshortened, (n,), px/mm."""
        farther = (points - np.array(self.centre_mm)) @ self._axes()[2]
        return np.asarray(self.px_per_mm / (1.0 + farther / self.distance_mm))

    def _axes(self) -> FloatArray:
        """Right, down and away from the camera, (3, 3)."""
        right, down = (np.array(axis) for axis in _AXES[self.side])
        away, tilt = np.cross(right, down), np.radians(self.tilt_deg)
        lower = np.cos(tilt) * down + np.sin(tilt) * away
        return np.array([right, lower, np.cross(right, lower)])


@dataclass(frozen=True)
class DyeFilm:
    """Settings of a simulated dye video.

    Attributes
    ----------
    fps : float, 1/s
    seconds : float, s
    start_s : float, s
        When dye enters the feed.
    """

    fps: float = 15.0
    seconds: float = 30.0
    start_s: float = 1.5
    camera: DyeCamera = field(default_factory=DyeCamera)
    dye: Dye = field(default_factory=Dye)
    spoilt: Disturbance = field(default_factory=Disturbance)

    def times(self) -> FloatArray:
        """Of the frames, (n,), s."""
        return np.arange(round(self.seconds * self.fps)) / self.fps


def film_frames(
    flow: DyeFlow, film: DyeFilm, generator: np.random.Generator
) -> Iterator[NDArray[np.uint8]]:
    """The film's frames, (height, width, 3), blue, green, red."""
    transport, times = Transport(flow, 1.0 / film.fps), film.times()
    paths = light_paths(film.camera, flow, transport)
    shape = (film.camera.height, film.camera.width)
    table = _light_table(film, generator)
    light, wander = _drift(film, times, generator), _shake(film, times, generator)
    for index, dye in enumerate(transport.frames(times, film.start_s)):
        depth = np.reshape(paths @ dye.ravel(), shape).astype(np.float32)
        clean = _lit(film, table, depth) * light[index][:, :, None]
        yield _taken(film, clean, wander[index], generator)


def _lit(film: DyeFilm, table: FloatArray, depth: NDArray[np.float32]) -> FloatArray:
    if film.dye.fluorescence_per_mm > 0.0:
        glow = (
            film.dye.fluorescence_per_mm
            * depth[:, :, None]
            * np.array([0.2, 1.0, 0.3], dtype=np.float32)
        )
        return np.asarray(0.06 * table + glow)
    absorbed = depth[:, :, None] * np.array(film.dye.absorbance_per_mm, dtype=np.float32)
    return np.asarray(table * np.exp(-absorbed))


def _light_table(film: DyeFilm, generator: np.random.Generator) -> FloatArray:
    """Background: brighter in the middle, grained, a few scratches; (height, width, 3)."""
    height, width = film.camera.height, film.camera.width
    v, u = np.meshgrid(np.linspace(-1, 1, height), np.linspace(-1, 1, width), indexing="ij")
    fine = ndimage.gaussian_filter(generator.standard_normal((height, width)), 1.5)
    coarse = ndimage.gaussian_filter(generator.standard_normal((height, width)), 8.0)
    grain = fine / fine.std() + coarse / coarse.std()
    level = 190.0 * (1.0 - 0.15 * (u**2 + v**2)) * (1.0 + film.spoilt.texture * grain)
    return np.asarray(level[:, :, None] * np.array([0.95, 1.0, 0.98]), dtype=np.float32)


def _drift(film: DyeFilm, times: FloatArray, generator: np.random.Generator) -> list[FloatArray]:
    phase, part = generator.uniform(0, 2 * np.pi), times / max(times[-1], 1e-9)
    wave = film.spoilt.drift * (part + 0.3 * np.sin(2 * np.pi * 2.5 * part + phase))
    across = np.linspace(-1.0, 1.0, film.camera.width)[None, :]
    return [(1.0 + w * (1.0 + across / 3.0)).astype(np.float32) for w in wave]


def _shake(film: DyeFilm, times: FloatArray, generator: np.random.Generator) -> FloatArray:
    if film.spoilt.shake_px == 0.0:
        return np.zeros((len(times), 2))
    raw = ndimage.gaussian_filter1d(generator.standard_normal((len(times), 2)), 2.0, axis=0)
    # The first frame stands where the camera says.
    return np.asarray(film.spoilt.shake_px * (raw - raw[0]) / raw.std())


def _taken(
    film: DyeFilm, clean: FloatArray, moved: FloatArray, generator: np.random.Generator
) -> NDArray[np.uint8]:
    blur = film.spoilt.blur_px
    if blur > 0.0:
        clean = ndimage.gaussian_filter(clean, (blur, blur, 0.0))
    if np.any(moved):
        clean = _moved(clean, moved)
    # A full well of some 10,000 electrons at 255.
    noise = np.sqrt(film.spoilt.noise**2 + np.maximum(clean, 0.0) / 40.0)
    noisy = clean + noise * generator.standard_normal(clean.shape, dtype=np.float32)
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8)


def _moved(picture: FloatArray, by: FloatArray) -> FloatArray:
    """The picture moved right and down, its rim repeated."""
    matrix = np.array([[1.0, 0.0, by[0]], [0.0, 1.0, by[1]]])
    size = picture.shape[1::-1]
    return np.asarray(cv2.warpAffine(picture, matrix, size, borderMode=cv2.BORDER_REPLICATE))


def write_film(path: Path, flow: DyeFlow, film: DyeFilm, generator: np.random.Generator) -> None:
    """Write the film as .mp4, .mov or .avi.

    Raises
    ------
    SimError
        When the suffix isn't known, or the file can't be written.
    """
    size = (film.camera.width, film.camera.height)
    write_frames(path, film_frames(flow, film, generator), size, film.fps)


# Simulated camera of a dye video: light paths from lumen cells to pixels.

_AXES: Final = {
    # To the right and downwards in the picture, seen from that side.
    "z": ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0)),
    "-z": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    "y": ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    "-y": ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0)),
    "x": ((0.0, 1.0, 0.0), (0.0, 0.0, -1.0)),
    "-x": ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
}
_STEEPEST = 0.25


def light_paths(camera: DyeCamera, flow: DyeFlow, transport: Transport) -> csr_array:
    """Length of each pixel's ray within each cell's annuli, (pixels, cells · ANNULI), mm.

    A piece is a straight tube; its ends are cut off square, so that joints are neither rounded nor
    counted twice.
    """
    rows, columns, values = [], [], []
    for index, part in enumerate(flow.parts):
        cells = (int(transport.first[index]), int(transport.first[index + 1]))
        for pixel, cell, chords in _pieces(camera, part, cells):
            rows.append(np.repeat(pixel, ANNULI))
            columns.append((cell[:, None] * ANNULI + np.arange(ANNULI)).ravel())
            values.append(chords.ravel())
    shape = (camera.width * camera.height, len(transport.dye) * ANNULI)
    if not rows:
        return csr_array(shape)
    joined = (np.concatenate(rows), np.concatenate(columns))
    return coo_array((np.concatenate(values), joined), shape=shape).tocsr()


def _pieces(
    camera: DyeCamera, part: Stretch, cells: tuple[int, int]
) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
    seen, volumes, along = camera.pixels(part.points), part.volumes(), part.along()
    scales = camera.scales(part.points)
    for k in range(len(seen) - 1):
        start, way = seen[k], seen[k + 1] - seen[k]
        length = float(np.hypot(*way))
        real = float(along[k + 1] - along[k]) * float(scales[k : k + 2].mean())
        if length < 1e-6 or real < 1e-9:
            continue
        reach = float((part.radius * scales)[k : k + 2].max())
        pixel, points = _near(camera, start, start + way, reach)
        share = (points - start) @ way / length**2
        # Half way in space isn't half way in the picture: what is far is seen small.
        share = share * scales[k + 1] / (scales[k] + share * (scales[k + 1] - scales[k]))
        scale = 1.0 / ((1.0 - share) / scales[k] + share / scales[k + 1])
        aside = np.abs((points - start) @ np.array([-way[1], way[0]])) / length / scale
        radius = part.radius[k] + share * (part.radius[k + 1] - part.radius[k])
        hit = (share >= 0.0) & (share < 1.0) & (aside < radius)
        volume = volumes[k] + share[hit] * (volumes[k + 1] - volumes[k])
        cell = cells[0] + (volume / volumes[-1] * (cells[1] - cells[0])).astype(np.int64)
        chords = _chords(aside[hit], radius[hit]) / max(length / real, _STEEPEST)
        yield pixel[hit], np.minimum(cell, cells[1] - 1), chords


def _near(
    camera: DyeCamera, start: FloatArray, end: FloatArray, reach_px: float
) -> tuple[FloatArray, FloatArray]:
    """Pixels about a piece: their numbers and places."""
    size = np.array([camera.width, camera.height])
    margin = reach_px + 1.0
    low = np.clip(np.floor(np.minimum(start, end) - margin), 0, size).astype(int)
    high = np.clip(np.ceil(np.maximum(start, end) + margin) + 1, 0, size).astype(int)
    u, v = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
    points = np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float64)
    return (v * camera.width + u).ravel(), points


def _chords(aside: FloatArray, radius: FloatArray) -> FloatArray:
    """Length of a ray at a distance from the axis within each annulus, (n, ANNULI), mm."""
    edge = radius[:, None] * np.sqrt(np.arange(ANNULI + 1) / ANNULI)
    within = 2.0 * np.sqrt(np.maximum(edge**2 - aside[:, None] ** 2, 0.0))
    return np.diff(within, axis=1)
