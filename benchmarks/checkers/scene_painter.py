"""Paint camera pictures and laser height maps of bioprints with known truth.

Modelled
    Beads with elliptic to parabolic cross-section, coalescence of touching beads, layers that
    sag into gaps below, width wobble, lateral wander, blobby ends; a granular bath with mottle
    and small bubbles; dome, ring and side light with cast shadows; five inks; pinhole camera
    with tilt, lens blur, vignetting, shot and read noise, gamma, 8 bits; a triangulation laser.
Not modelled
    Lens distortion, rolling shutter, depth of field across a tilted plane, interreflection,
    ink diffusion with time, drying.

Frames: printer coordinates in mm, z up. Pictures are (row, col[, RGB]); y up is row down.
A stroke's z is the nozzle tip, the nominal top of its bead.

Formulas
    Lambert cosine law; Blinn-Phong half vector (Blinn 1977, doi:10.1145/563858.563893);
    Schlick's Fresnel term (1994, doi:10.1111/1467-8659.1330233); Beer-Lambert double pass
    exp(-2 a t); Kubelka-Munk layer (Kubelka 1948, doi:10.1364/JOSA.38.000448); Snell's law for
    small angles: apparent depth d/n, image displacement t (1 - 1/n) grad(h); cos^4 vignetting;
    Poisson photon noise, sigma_e = sqrt(N + read^2).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

Array = NDArray[Any]
KINDS = ("single", "stack", "embedded", "laser")
INKS = ("pale", "dark", "dyed", "clear", "milky")
TRUTH_STEP_MM = 0.05
REFRACTIVE_INDEX = 1.35  # hydrogel, close to water's 1.333
GREY = np.array([0.299, 0.587, 0.114], np.float32)


# ---------------------------------------------------------------- values
@dataclass
class Scene:
    """A picture, what was meant to be printed, and what was really there."""

    picture: Array
    before: Array | None
    to_pixels: Callable[[Array], Array]
    expected: dict[str, Any]
    truth: dict[str, Any]
    info: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Grid:
    """Regular world grid; row j is y0 + j * pitch."""

    x0: float
    y0: float
    pitch: float
    shape: tuple[int, int]

    def index(self, xy: Array) -> Array:
        """Return columns and rows of places."""
        return (np.asarray(xy)[..., :2] - (self.x0, self.y0)) / self.pitch

    def axes(self) -> tuple[Array, Array]:
        """Return x and y of columns and rows."""
        h, w = self.shape
        return self.x0 + np.arange(w) * self.pitch, self.y0 + np.arange(h) * self.pitch


@dataclass(frozen=True)
class Camera:
    """Pinhole above the print; points below `surface_z` appear at depth d / n."""

    position: Array
    rotation: Array
    focal_px: float
    shape: tuple[int, int]
    surface_z: float | None = None

    @property
    def centre_px(self) -> Array:
        """Return the middle of the picture, px."""
        return np.array([(self.shape[1] - 1) / 2, (self.shape[0] - 1) / 2])

    def apparent(self, points: Array) -> Array:
        """Return places as seen through the surface, and their scale."""
        p = np.atleast_2d(np.asarray(points, float)).copy()
        if self.surface_z is not None:
            depth = np.maximum(self.surface_z - p[:, 2], 0)
            p[:, 2] += depth * (1 - 1 / REFRACTIVE_INDEX)
        return p

    def project(self, points: Array) -> Array:
        """Return (n, 2) pixels (col, row) of (n, 3) points in mm."""
        q = (self.apparent(points) - self.position) @ self.rotation.T
        return self.focal_px * q[:, :2] / q[:, 2:] + self.centre_px

    def onto_plane(self, points: Array, z: float) -> tuple[Array, Array]:
        """Return where the sight lines to `points` cross the plane z, and the scale."""
        p = self.apparent(points)
        scale = (self.position[2] - z) / (self.position[2] - p[:, 2])
        return self.position[:2] + (p[:, :2] - self.position[:2]) * scale[:, None], scale

    def sight_lines(self) -> Array:
        """Return a ray through each pixel."""
        v, u = np.mgrid[: self.shape[0], : self.shape[1]].astype(np.float32)
        c = self.centre_px
        d = np.stack([(u - c[0]) / self.focal_px, (v - c[1]) / self.focal_px, np.ones_like(u)], -1)
        return (d @ self.rotation).astype(np.float32)


@dataclass(frozen=True)
class Light:
    """Lamps over a print."""

    dome: float
    ring: float
    ring_angle: float  # rad from the vertical
    side: float
    azimuth: float
    elevation: float
    gradient: tuple[float, float]  # relative change per scene width
    vignette: float
    tint: tuple[float, float, float]
    gain: float = 1.0


@dataclass(frozen=True)
class Optics:
    """Ink and bath as the light meets them; colours linear RGB, lengths mm."""

    ink: str
    colour: Array
    bath: Array
    absorb: Array
    scatter: float
    gloss: float
    bath_gloss: float
    roughness: float
    bath_mu: float


@dataclass(frozen=True)
class Sensor:
    """A camera's sensor."""

    blur_px: float
    full_well: float
    read_e: float
    gamma: float
    target: float
    colour: bool


@dataclass
class Stroke:
    """A line to be written."""

    path: Array
    width: float
    number: int
    fresh: bool
    thickness: float

    def along(self) -> Array:
        """Return the way from the begin to each point."""
        return np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(self.path, axis=0), axis=1))])

    @property
    def length(self) -> float:
        """Return the whole way."""
        return float(self.along()[-1])

    def at(self, s: Array) -> Array:
        """Return points at ways from the begin."""
        a = self.along()
        return np.stack([np.interp(s, a, self.path[:, k]) for k in range(3)], -1)


@dataclass
class Deposit:
    """Dabs of ink whose envelope is the bead."""

    xyz: Array
    radius: Array
    height: Array


@dataclass(frozen=True)
class Process:
    """How this layer really came out."""

    flow: float
    shift: tuple[float, float]
    width_cv: float
    wander: float
    spread: float  # width ~ share^spread, height ~ share^(1 - spread)
    power: float  # profile (1 - (d/r)^2)^power: 0.5 ellipse, 1 parabola
    sag: float


# ---------------------------------------------------------------- strokes
def _circle(cx: float, cy: float, r: float, start: float = 0.0) -> Array:
    n = max(24, int(2 * np.pi * r / 0.2))
    a = start + np.linspace(0, 2 * np.pi, n + 1)
    return np.stack([cx + r * np.cos(a), cy + r * np.sin(a)], -1)


def _lines(rng: Any, half: float, wavy: bool) -> tuple[list[Array], float, list[Any]]:
    n = int(rng.integers(5, 13 if not wavy else 10))
    while 2 * half / (n - 1) < 0.36 and n > 2:
        n -= 1
    pitch = 2 * half / (n - 1)
    width = rng.uniform(0.2, max(0.21, min(0.6, (0.62 if not wavy else 0.5) * pitch)))
    paths = []
    amp = rng.uniform(0.3, 1.2) * pitch if wavy else 0.0
    period = rng.uniform(1.6, 3.0)
    amp = min(amp, 0.28 * period)
    for k in range(n):
        m = int(2 * half / 0.1) if wavy else 1
        x = np.linspace(-half, half, m + 1)
        y = (-half + k * pitch) * (1 - amp / half) + amp * np.sin(2 * np.pi * x / period)
        p = np.stack([x, y], -1)
        paths.append(p[::-1] if k % 2 else p)
    if wavy:  # neighbours are in phase: their clearance shrinks by the cosine of the slope
        width = max(
            0.2, min(width, 0.7 * pitch * (1 - amp / half) / np.hypot(1, 2 * np.pi * amp / period))
        )
    return paths, width, []


def _rings(rng: Any, half: float) -> tuple[list[Array], float, list[Any]]:
    if rng.random() < 0.5:
        width = rng.uniform(0.2, 0.5)
        inner = rng.uniform(0.5, 1.0) + width / 2
        pitch = rng.uniform(1.7, 2.6) * width
        n = int(np.clip((half - inner) / pitch + 1, 1, 8))
        radii = inner + pitch * np.arange(n)
        start = rng.uniform(0, 2 * np.pi)
        lumen = ("lumen 0", _circle(0, 0, inner - width / 2), 2 * inner - width)
        return [_circle(0, 0, r, start) for r in radii], width, [lumen]
    n = int(rng.integers(2, 4))
    cell = 2 * half / n
    width = rng.uniform(0.2, min(0.5, cell / 5))
    paths = list[Array]()
    lumens = list[Any]()
    for i in range(n):
        for j in range(n):
            r = rng.uniform(0.3, 0.42) * cell
            c = (-half + (i + 0.5) * cell, -half + (j + 0.5) * cell)
            paths.append(_circle(*c, r, rng.uniform(0, 6.28)))
            name = f"lumen {len(lumens)}"
            lumens.append((name, _circle(*c, r - width / 2), 2 * r - width))
    return paths, width, lumens


def _solid(rng: Any, half: float, hole: bool) -> tuple[list[Array], float, list[Any]]:
    width = rng.uniform(0.25, 0.6)
    a, b = half * rng.uniform(0.6, 1.0, 2)
    paths, lumens = [], []
    r = rng.uniform(0.22, 0.4) * min(a, b) if hole else 0.0
    if hole:
        paths.append(_circle(0, 0, r + width / 2, rng.uniform(0, 6.28)))
        lumens.append(("lumen 0", _circle(0, 0, r), 2 * r))
    keep_out = r + 1.35 * width  # the round ends overlap the contour by 0.15 width
    pitch = width * rng.uniform(0.9, 1.0)
    for k, y in enumerate(np.arange(-b, b + 1e-9, pitch)):
        pieces = [(-a, a)]
        if hole and abs(y) < r + 1.05 * width:
            x = np.sqrt(keep_out**2 - y**2)
            pieces = [(-a, -x), (x, a)]
        for lo, hi in pieces:
            if hi - lo > 2 * width:
                p = np.array([[lo, y], [hi, y]])
                paths.append(p[::-1] if k % 2 else p)
    return paths, width, lumens


def _pattern(name: str, rng: Any, half: float) -> tuple[list[Array], float, list[Any]]:
    if name in ("lines", "waves"):
        return _lines(rng, half, name == "waves")
    return _rings(rng, half) if name == "rings" else _solid(rng, half, name == "solid_hole")


def _turn(xy: Array, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return xy @ np.array([[c, s], [-s, c]])


# ---------------------------------------------------------------- faults
def _count(value: Any) -> int:
    return len(value) if isinstance(value, (list, tuple)) else int(value or 0)


def _free_interval(taken: list[Any], length: float, stroke: Stroke, rng: Any, margin: float) -> Any:
    room = stroke.length - length - 2 * margin
    if room <= 0:
        return None
    for _ in range(30):
        a = margin + rng.uniform(0, room)
        if all(a > t[1] + 4 * stroke.width or a + length < t[0] - 4 * stroke.width for t in taken):
            return a, a + length
    return None


def _covered(stroke: Stroke, interval: Any, points: dict[int, Array]) -> bool:
    """Tell whether other fresh strokes hide more than half of an interval from above."""
    mine = stroke.at(np.linspace(interval[0], interval[1], 9))[:, :2]
    others = [p for n, p in points.items() if n != stroke.number]
    if not others:
        return False
    near = [np.hypot(*(np.vstack(others) - q).T).min() < 0.6 * stroke.width for q in mine]
    return float(np.mean(near)) > 0.5


def _plan(strokes: list[Stroke], faults: dict[str, Any], rng: Any) -> dict[str, Any]:
    """Choose where gaps, thin stretches and missing strokes go; they never overlap."""
    taken: dict[int, list[Any]] = {s.number: [] for s in strokes}
    plan: dict[str, Any] = {"gaps": [], "thin": [], "missing": []}
    spare = list(strokes)
    points = {
        s.number: s.at(np.linspace(0.0, float(s.length), int(s.length / 0.05) + 2))[:, :2]
        for s in strokes
    }
    for _ in range(min(_count(faults.get("missing")), max(len(strokes) - 1, 0))):
        s = spare.pop(int(rng.integers(len(spare))))
        plan["missing"].append(s.number)
        plan["gaps"].append((s.number, 0.0, s.length))
    for kind in ("gaps", "thin"):
        wanted = faults.get(kind)
        for k in range(_count(wanted)):
            for _ in range(40):
                s = spare[int(rng.integers(len(spare)))]
                given = wanted[k] if isinstance(wanted, (list, tuple)) else None
                if kind == "gaps":
                    top = min(3.0, 0.5 * s.length)
                    size = given or float(np.exp(rng.uniform(np.log(0.2), np.log(max(top, 0.21)))))
                    late = (
                        given is None
                        and rng.random() < 0.2
                        and not taken[s.number]
                        and not np.allclose(s.path[0], s.path[-1])
                    )
                    got = (
                        (0.0, size)
                        if late
                        else _free_interval(taken[s.number], size, s, rng, 2 * s.width)
                    )
                else:
                    if s.length < 2.6:
                        continue
                    size = rng.uniform(2.0, min(10.0, 0.8 * s.length))
                    got = _free_interval(taken[s.number], size, s, rng, 0.05)
                if got is None or (kind == "gaps" and _covered(s, got, points)):
                    continue
                taken[s.number].append(got)
                extra = () if kind == "gaps" else (float(given or rng.uniform(0.5, 0.8)),)
                plan[kind].append((s.number, float(got[0]), float(got[1]), *extra))
                break
    return plan


def _correlated(n: int, step: float, length: float, rng: Any) -> Array:
    """Return unit-variance noise with Gaussian correlation of the given length."""
    pad = int(4 * length / step) + 1
    z = gaussian_filter1d(rng.standard_normal(n + 2 * pad), length / step)[pad : pad + n]
    return z * np.sqrt(2 * np.sqrt(np.pi) * length / step)


def _deposit(stroke: Stroke, proc: Process, plan: dict[str, Any], rng: Any) -> tuple[Deposit, Any]:
    """Return the dabs of one stroke and its true share every 0.05 mm.

    A bead's end reaches exactly to the gap: its last dab is one radius short of it.  Within
    the round end the cross-section is that of a spheroid, area ~ (1 - u^2)^(power + 1/2).
    """
    step = 0.08 * stroke.width
    n = max(int(np.ceil(stroke.length / step)) + 1, 3)
    s = np.linspace(0, stroke.length, n)
    step = s[1]
    gaps = [g[1:3] for g in plan["gaps"] if g[0] == stroke.number]
    share = proc.flow * (
        1
        + proc.width_cv
        / proc.spread
        * np.clip(_correlated(n, step, rng.uniform(2, 5) * stroke.width, rng), -2.5, 2.5)
    )
    for _, a, b, f in (t for t in plan["thin"] if t[0] == stroke.number):
        ramp = np.clip(np.minimum(s - a, b - s) / (0.5 * stroke.width) + 0.5, 0, 1)
        share = share * (1 - (1 - f) * ramp * ramp * (3 - 2 * ramp))
    ends = [(0.0, 0.5), (stroke.length, 0.5)] + [(e, 0.2) for g in gaps for e in g]
    for e, most in ends:
        centre = (
            e
            + (0.9 * stroke.width if e in [g[1] for g in gaps] else 0)
            - (0.9 * stroke.width if e in [g[0] for g in gaps] else 0)
        )
        share = share * (
            1 + rng.uniform(0, most) * np.exp(-(((s - centre) / (0.8 * stroke.width)) ** 2))
        )
    r = stroke.width / 2 * share**proc.spread
    wander = proc.wander * _correlated(n, step, rng.uniform(3, 7) * stroke.width, rng)
    last = [np.interp(a, s + r, s) for a, _ in gaps if a > r[0]]  # dabs that touch the gap
    first = [np.interp(b, s - r, s) for _, b in gaps if b < stroke.length - r[-1]]
    s, old = np.unique(np.concatenate([s, last, first])), s
    share, r, wander = (np.interp(s, old, q) for q in (share, r, wander))
    n, active = len(s), np.ones(len(s), bool)
    for a, b in gaps:
        active &= (s + r <= a + 1e-6) | (s - r >= b - 1e-6)
    xyz = stroke.at(s)
    tangent = np.gradient(xyz[:, :2], axis=0)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
    if np.allclose(stroke.path[0], stroke.path[-1]):  # closed: the wander must meet itself
        wander = wander - s / s[-1] * (wander[-1] - wander[0])
    xyz[:, :2] += wander[:, None] * np.stack([-tangent[:, 1], tangent[:, 0]], -1) + proc.shift
    t = np.append(np.arange(0, stroke.length, TRUTH_STEP_MM), stroke.length)
    true = np.zeros(len(t))
    if active.any():
        idx = np.flatnonzero(active)
        right = np.clip(np.searchsorted(s[idx], t), 0, len(idx) - 1)
        for j in (idx[np.maximum(right - 1, 0)], idx[right]):
            u = np.abs(t - s[j]) / r[j]
            u = np.where(
                active[np.clip(np.searchsorted(s, t), 0, n - 1)]
                & active[np.clip(np.searchsorted(s, t) - 1, 0, n - 1)],
                0,
                u,
            )
            true = np.maximum(true, share[j] * np.clip(1 - u * u, 0, 1) ** (proc.power + 0.5))
    height = stroke.thickness * share ** (1 - proc.spread)
    return Deposit(xyz[active], r[active], height[active]), (t, true)


# ---------------------------------------------------------------- height field
def _stamp(
    out: Array,
    grid: Grid,
    xy: Array,
    radius: Array,
    height: Array,
    power: float,
    depth: Array | None = None,
    z: Array | None = None,
) -> None:
    """Raise `out` to the envelope of spheroidal dabs; note each pixel's dab depth."""
    idx = grid.index(xy)
    for k in range(len(idx)):
        cx, cy = idx[k]
        r = radius[k] / grid.pitch
        i0, i1 = max(int(cx - r), 0), min(int(cx + r) + 2, grid.shape[1])
        j0, j1 = max(int(cy - r), 0), min(int(cy + r) + 2, grid.shape[0])
        if i0 >= i1 or j0 >= j1:
            continue
        dx = (np.arange(i0, i1, dtype=np.float32) - cx) / r
        dy = (np.arange(j0, j1, dtype=np.float32) - cy) / r
        v = np.maximum(1 - dy[:, None] ** 2 - dx[None] ** 2, 0)
        v = height[k] * (np.sqrt(v) if power == 0.5 else v**power)
        view = out[j0:j1, i0:i1]
        if depth is not None and z is not None:
            depth[j0:j1, i0:i1][v > view] = z[k]
        np.maximum(view, v, out=view)


def _disc(radius_px: float) -> Array:
    k = 2 * max(round(radius_px), 1) + 1
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (k, k))


def _coalesce(total: Array, width: float, grid: Grid) -> Array:
    """Level valleys narrower than capillarity bridges; leave real gaps open."""
    mask = (total > 1e-4).astype(np.uint8)
    mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, _disc(0.025 / grid.pitch)) > 0
    filled = cv2.morphologyEx(total, cv2.MORPH_CLOSE, _disc(min(0.25 * width, 0.07) / grid.pitch))
    level = np.where(mask, 0.3 * total + 0.7 * filled, 0).astype(np.float32)
    sigma = 0.08 * width / grid.pitch
    return np.where(mask, cv2.GaussianBlur(level, (0, 0), sigma), 0).astype(np.float32)


def _bead_layer(deposits: list[Deposit], width: float, power: float, grid: Grid) -> Array:
    total = np.zeros(grid.shape, np.float32)
    for d in deposits:
        one = np.zeros(grid.shape, np.float32)
        _stamp(one, grid, d.xyz, d.radius, d.height, power)
        total += one
    if deposits:
        top = max((float(d.height.max()) for d in deposits if len(d.height)), default=0.0)
        np.minimum(total, 1.35 * top, out=total)
    return _coalesce(total, width, grid)


def _lay(below: Array, bead: Array, width: float, sag: float, grid: Grid) -> Array:
    """Return the surface after beads were laid on `below`: they bridge and sag."""
    small = cv2.resize(below, None, fx=0.2, fy=0.2, interpolation=cv2.INTER_AREA)
    small = cv2.morphologyEx(small, cv2.MORPH_CLOSE, _disc(0.24 * width / grid.pitch))
    small = cv2.GaussianBlur(small, (0, 0), 0.06 * width / grid.pitch)
    span = cv2.resize(small, grid.shape[::-1], interpolation=cv2.INTER_LINEAR)
    support = np.maximum(below, (1 - sag) * span + sag * below)
    grip = np.clip(bead / (0.35 * bead.max() + 1e-9), 0, 1) ** 0.5
    return (below + (support - below) * grip + bead).astype(np.float32)


def _sky_line(height: Array, pitch: float, azimuth: float, elevation: float) -> Array:
    """Return how far (mm) each point lies below the light's horizon, 0 if lit.

    Along the light's direction x the horizon is max over x' < x of h(x') - (x - x') tan(e),
    a running maximum of h + x tan(e).
    """
    h, w = height.shape
    n = int(np.ceil(np.hypot(h, w))) + 2
    # image axes: col = +x, row = +y; light travels from azimuth towards the print
    m = cv2.getRotationMatrix2D(((w - 1) / 2, (h - 1) / 2), np.degrees(azimuth) + 180, 1)
    m[:, 2] += ((n - w) / 2, (n - h) / 2)
    turned = cv2.warpAffine(
        height, m, (n, n), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    lifted = turned + np.arange(n, dtype=np.float32) * pitch * np.float32(np.tan(elevation))
    deficit = np.maximum.accumulate(lifted, axis=1) - lifted
    return cv2.warpAffine(deficit, m, (w, h), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)


# ---------------------------------------------------------------- bath, ink, light
def _noise(shape: tuple[int, int], sigma_px: float, rng: Any) -> Array:
    f = max(int(sigma_px / 2), 1)
    small = rng.standard_normal((shape[0] // f + 2, shape[1] // f + 2)).astype(np.float32)
    small = cv2.GaussianBlur(small, (0, 0), sigma_px / f)
    out = cv2.resize(small, (shape[1], shape[0]), interpolation=cv2.INTER_CUBIC)
    return out / max(float(out.std()), 1e-9)


@dataclass
class Bath:
    """What a bath looks like."""

    grain: Array  # relative reflectance
    relief: Array  # mm
    bubbles: list[tuple[float, float, float]]


def _make_bath(grid: Grid, rng: Any) -> Bath:
    """Paint gel microparticles of 20-60 um, mottle, and bubbles."""
    size = rng.uniform(0.015, 0.04) / grid.pitch
    fine, coarse = _noise(grid.shape, size, rng), _noise(grid.shape, 3 * size, rng)
    mottle = _noise(grid.shape, 0.9 / grid.pitch, rng)
    a = rng.uniform(0.008, 0.03, 3)
    x, y = grid.axes()
    count = int(rng.poisson(5))
    bubbles = [
        (rng.uniform(x[0], x[-1]), rng.uniform(y[0], y[-1]), float(rng.uniform(0.03, 0.12)))
        for _ in range(count)
    ]
    relief = 1e-3 * (rng.uniform(0.2, 0.9) * fine + rng.uniform(0.5, 2.5) * coarse) + 4e-3 * mottle
    return Bath(1 + a[0] * fine + a[1] * coarse + a[2] * mottle, relief, bubbles)


def _stir(bath: Bath, share: float, grid: Grid, rng: Any) -> Bath:
    """Return the bath as it was earlier: part of its grains lay otherwise."""
    other = _make_bath(grid, rng)
    mix = np.sqrt(1 - share**2)
    return Bath(
        1 + mix * (bath.grain - 1) + share * (other.grain - 1),
        mix * bath.relief + share * other.relief,
        bath.bubbles,
    )


def _bath_colour(bath: Bath, optics: Optics, grid: Grid) -> Array:
    img = bath.grain[..., None] * optics.bath.astype(np.float32)
    x, y = grid.axes()
    for bx, by, r in bath.bubbles:
        i = slice(*np.searchsorted(x, (bx - 1.5 * r, bx + 1.5 * r)))
        j = slice(*np.searchsorted(y, (by - 1.5 * r, by + 1.5 * r)))
        u = np.hypot(x[None, i] - bx, y[j, None] - by) / r
        spot = np.exp(
            -((np.hypot(x[None, i] - bx + 0.35 * r, y[j, None] - by - 0.35 * r) / (0.25 * r)) ** 2)
        )
        rim = np.exp(-(((u - 0.9) / 0.14) ** 2))
        img[j, i] = img[j, i] * (1 - 0.5 * rim[..., None]) + 0.5 * spot[..., None]
    return np.maximum(img, 0.005).astype(np.float32)


def _kubelka_munk(ground: Array, scatter: float, absorb: Array, t: Array) -> Array:
    """Return a layer's reflectance: (1 - Rg(a - b coth bSt)) / (a - Rg + b coth bSt)."""
    a = 1 + absorb / scatter
    b = np.sqrt(a * a - 1)
    coth = 1 / np.tanh(np.maximum(b * scatter * t[..., None], 1e-4))
    r = (1 - ground * (a - b * coth)) / (a - ground + b * coth)
    return np.where(t[..., None] > 1e-4, r, ground).astype(np.float32)


def _wide_blur(img: Array, sigma_px: float) -> Array:
    """Return a Gaussian blur, computed on a reduced image if it is wide."""
    f = int(sigma_px // 3)
    if f < 2:
        return cv2.GaussianBlur(img, (0, 0), sigma_px)
    h, w = img.shape[:2]
    small = cv2.resize(img, (w // f, h // f), interpolation=cv2.INTER_AREA)
    return cv2.resize(
        cv2.GaussianBlur(small, (0, 0), sigma_px / f), (w, h), interpolation=cv2.INTER_LINEAR
    )


def _gradient(h: Array, pitch: float) -> tuple[Array, Array]:
    return (
        cv2.Sobel(h, cv2.CV_32F, 1, 0, ksize=3, scale=1 / (8 * pitch)),
        cv2.Sobel(h, cv2.CV_32F, 0, 1, ksize=3, scale=1 / (8 * pitch)),
    )


def _ink_colour(ground: Array, t: Array, surface: Array, optics: Optics, grid: Grid) -> Array:
    """Return linear RGB reflectance of ink of vertical thickness t (mm) over `ground`."""
    if optics.ink in ("pale", "dark"):
        a = (1 - np.exp(-t / 0.02))[..., None]
        return ground * (1 - a) + optics.colour.astype(np.float32) * a
    if optics.ink == "dyed":  # Beer-Lambert, down and up again
        through = np.exp(-2 * optics.absorb.astype(np.float32) * t[..., None])
        return ground * through + 0.03 * (1 - np.exp(-2 * t))[..., None] * optics.colour.astype(
            np.float32
        )
    if optics.ink == "milky":  # light wanders sideways about one transport length
        soft = cv2.GaussianBlur(t, (0, 0), max(0.35 / optics.scatter, 0.02) / grid.pitch)
        return _kubelka_munk(ground, optics.scatter, optics.absorb.astype(np.float32), soft)
    return _clear(ground, t, surface, grid)


def _clear(ground: Array, t: Array, surface: Array, grid: Grid) -> Array:
    """Refract the bath through the bead; focus light below it; darken its steep rims."""
    wet = t > 1e-3
    gx, gy = _gradient(surface, grid.pitch)
    n = 1 - 1 / REFRACTIVE_INDEX
    jj, ii = np.mgrid[: grid.shape[0], : grid.shape[1]].astype(np.float32)
    limit = np.float32(0.5)
    mx = ii - np.where(wet, np.clip(t * n * gx, -limit, limit), 0) / grid.pitch
    my = jj - np.where(wet, np.clip(t * n * gy, -limit, limit), 0) / grid.pitch
    seen = cv2.remap(
        ground,
        mx.astype(np.float32),
        my.astype(np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REFLECT,
    )
    smooth = cv2.GaussianBlur(surface, (0, 0), 0.03 / grid.pitch)
    bend = cv2.Laplacian(smooth, cv2.CV_32F) / grid.pitch**2
    focus = 1 / np.clip(1 + 0.5 * n * t * bend, 0.75, 1.6)  # caustic of a weak lens
    cos = 1 / np.sqrt(1 + gx * gx + gy * gy)
    fresnel = 0.02 + 0.98 * (1 - cos) ** 5  # Schlick
    pass_ = np.where(wet, (1 - fresnel) ** 2 * focus * (0.93 + 0.07 * cos), 1)
    return seen * cv2.GaussianBlur(pass_.astype(np.float32), (0, 0), 0.012 / grid.pitch)[..., None]


def _shade(
    surface: Array, wet: Array, light: Light, optics: Optics, grid: Grid
) -> tuple[Array, Array]:
    """Return irradiance and highlight maps of a surface under dome, ring and side lamp."""
    gx, gy = _gradient(surface, grid.pitch)
    cos = 1 / np.sqrt(1 + gx * gx + gy * gy)
    tilt = np.arccos(np.clip(cos, 0, 1))
    smooth = cv2.GaussianBlur(surface, (0, 0), 0.35 / grid.pitch)
    open_sky = 1 - np.clip(0.9 * (smooth - surface), 0, 0.35)
    lx, ly = (
        np.cos(light.elevation) * np.cos(light.azimuth),
        np.cos(light.elevation) * np.sin(light.azimuth),
    )
    lz = np.sin(light.elevation)
    lambert = np.maximum((lz - gx * lx - gy * ly) * cos, 0)
    deficit = _sky_line(surface, grid.pitch, light.azimuth, light.elevation)
    lit = 1 - cv2.GaussianBlur(np.clip((deficit - 0.01) / 0.04, 0, 1), (0, 0), 0.03 / grid.pitch)
    irradiance = (
        light.dome * open_sky * (0.5 + 0.5 * cos)
        + light.ring * cos * open_sky
        + light.side * lambert / lz * lit
    )
    gloss = np.where(wet, optics.gloss, optics.bath_gloss)
    rough = np.where(wet, optics.roughness, 0.22)
    ring = np.exp(-(((tilt - light.ring_angle / 2) / rough) ** 2)) * light.ring
    leds = 1 + 0.35 * np.cos(12 * np.arctan2(gy, gx))
    half = np.array([lx, ly, lz + 1])
    half /= np.linalg.norm(half)
    away = np.arccos(np.clip((half[2] - gx * half[0] - gy * half[1]) * cos, -1, 1))
    lamp = np.exp(-((away / rough) ** 2)) * light.side * lit * 1.5
    x = np.linspace(-0.5, 0.5, grid.shape[1], dtype=np.float32)
    y = np.linspace(-0.5, 0.5, grid.shape[0], dtype=np.float32)
    ramp = 1 + light.gradient[0] * x[None] + light.gradient[1] * y[:, None]
    return irradiance * ramp * light.gain, gloss * (ring * leds + lamp) * ramp * light.gain


# ---------------------------------------------------------------- embedded lines
def _through_bath(
    img: Array, t: Array, depth: Array, optics: Optics, light: Light, grid: Grid
) -> Array:
    """Lay one family of immersed lines over the deeper ones.

    Contrast falls as exp(-2 mu d) and scatter blurs by sigma(d) = 0.01 + 0.035 mu d mm per
    mm^-1 mm: the small-angle spread of a scattering slab grows with its optical depth.
    """
    sigmas = np.array([0.01, 0.04, 0.09, 0.16, 0.26])
    weight = _wide_blur((t > 0).astype(np.float32), 0.25 / grid.pitch) + 1e-6
    d = _wide_blur(np.where(t > 0, depth, 0).astype(np.float32), 0.25 / grid.pitch) / weight
    sigma = np.clip(0.01 + 0.06 * optics.bath_mu * d, sigmas[0], sigmas[-1])
    if optics.ink == "clear":  # index step of about 0.02: weak lens, one flank bright, one dark
        gx, gy = _gradient(cv2.GaussianBlur(t, (0, 0), 0.02 / grid.pitch), grid.pitch)
        g = gx * np.cos(light.azimuth) + gy * np.sin(light.azimuth)
        change = (
            np.clip(-0.06 * g, -0.15, 0.2)
            - np.clip(0.05 * np.hypot(gx, gy), 0, 0.14)
            + 0.06 * (t > 0) * t / max(float(t.max()), 1e-9)
        )[..., None].astype(np.float32)
    else:
        seen = _ink_colour(img, t, t, optics, grid)
        gx, gy = _gradient(cv2.GaussianBlur(0.5 * t, (0, 0), 0.02 / grid.pitch), grid.pitch)
        slant = gx * np.cos(light.azimuth) + gy * np.sin(light.azimuth)
        cos = 1 / np.sqrt(1 + gx * gx + gy * gy)
        directed = light.side / (light.side + light.ring + light.dome)
        lambert = 0.7 * (cos * (1 - directed * np.clip(slant, -1, 1)) - 1)
        solid = 0.3 if optics.ink == "dyed" else 1.0
        change = seen / img * (1 + solid * (1 - np.exp(-t / 0.02)) * lambert)[..., None] - 1
    stack = [_wide_blur(np.atleast_3d(change).astype(np.float32), s / grid.pitch) for s in sigmas]
    out = np.zeros_like(img)
    pos = np.interp(sigma, sigmas, np.arange(len(sigmas)))
    for k, layer in enumerate(stack):
        out += np.atleast_3d(layer) * np.clip(1 - np.abs(pos - k), 0, 1)[..., None].astype(
            np.float32
        )
    return np.maximum(img * (1 + out * np.exp(-2 * optics.bath_mu * d)[..., None]), 0.002)


# ---------------------------------------------------------------- camera
def _make_camera(
    centre: Array, um: float, shape: tuple[int, int], rng: Any, surface_z: float | None
) -> Camera:
    distance = rng.uniform(70, 160)
    tilt, roll = np.radians(rng.normal(0, 1.2, 2)), np.radians(rng.uniform(-3, 3))
    return _aim(centre, distance, np.clip(tilt, -0.05, 0.05), roll, um, shape, surface_z)


def _aim(
    centre: Array,
    distance: float,
    tilt: Array,
    roll: float,
    um: float,
    shape: tuple[int, int],
    surface_z: float | None,
) -> Camera:
    down = np.diag([1.0, -1.0, -1.0])
    vec = [
        cv2.Rodrigues(np.array(v, float))[0]
        for v in ((tilt[0], 0, 0), (0, tilt[1], 0), (0, 0, roll))
    ]
    rot = vec[2] @ vec[1] @ vec[0] @ down
    return Camera(centre - distance * rot[2], rot, distance * 1000 / um, shape, surface_z)


def _moved(cam: Camera, um: float, rng: Any) -> Camera:
    turn = cv2.Rodrigues(np.array([0, 0, np.radians(rng.normal(0, 0.15))]))[0]
    move = np.array([*rng.normal(0, 2.0 * um / 1000, 2), 0.0])
    return replace(cam, position=cam.position + move, rotation=turn @ cam.rotation)


def _see(cam: Camera, grid: Grid, surface: Array, base_z: float, maps: list[Array]) -> list[Array]:
    """Sample world maps at each pixel's first hit of the height field (3 fixed-point steps)."""
    d = cam.sight_lines()
    z = np.full(cam.shape, base_z, np.float32)
    smooth = cv2.GaussianBlur(surface, (0, 0), 1.5)
    for _ in range(3):
        k = (z - cam.position[2]) / d[..., 2]
        u = ((cam.position[0] + d[..., 0] * k - grid.x0) / grid.pitch).astype(np.float32)
        v = ((cam.position[1] + d[..., 1] * k - grid.y0) / grid.pitch).astype(np.float32)
        z = base_z + cv2.remap(smooth, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return [cv2.remap(m, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE) for m in maps]


def _cover(img: Array, cam: Camera, covers: list[Any], z: float, um: float, seed: int) -> Array:
    """Draw bubbles, glare and the needle over the linear picture."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[: cam.shape[0], : cam.shape[1]].astype(np.float32)
    level = float(np.median(img))
    for kind, x, y, r, angle in covers:
        c = cam.project(np.array([[x, y, z]]))[0]
        rp = r * 1000 / um
        d = np.hypot(u - c[0], v - c[1]) / rp
        if kind == "bubble":
            soft = np.clip((1.0 - d) * rp / 1.5 + 0.5, 0, 1)[..., None]
            dome = np.sqrt(np.clip(1 - d * d, 0, 1))
            tone = level * (0.55 + 0.6 * dome + 0.25 * (v - c[1]) / rp * dome)
            tone = tone * (1 - 0.65 * np.exp(-(((d - 0.93) / 0.07) ** 2)))
            spot = np.hypot(u - c[0] + 0.4 * rp, v - c[1] + 0.4 * rp) / (0.16 * rp)
            tone = (
                tone
                + 2.5 * level * np.exp(-(spot**4))
                + 0.8
                * level
                * np.exp(
                    -((np.hypot(u - c[0] - 0.45 * rp, v - c[1] - 0.4 * rp) / (0.12 * rp)) ** 2)
                )
            )
            img = img * (1 - 0.97 * soft) + 0.97 * soft * tone[..., None]
        elif kind == "glare":
            wob = 1 + 0.12 * np.sin(3 * np.arctan2(v - c[1], u - c[0]) + angle)
            img = (
                img
                + (9 * level * np.exp(-((d * wob / 0.8) ** 4)) + 0.15 * level * np.exp(-d))[
                    ..., None
                ]
            )
        else:
            du, dv = np.cos(angle), -np.sin(angle)
            along = (u - c[0]) * du + (v - c[1]) * dv
            across = ((v - c[1]) * du - (u - c[0]) * dv) / rp
            wide = 1 + 0.0006 * np.maximum(along, 0)
            q = across / wide
            soft = (np.clip((1 - np.abs(q)) * rp / 3 + 0.5, 0, 1) * np.clip(along / 3 + 0.5, 0, 1))[
                ..., None
            ]
            tone = (
                0.35
                + 0.5 * np.exp(-(((q - 0.3) / 0.18) ** 2))
                + 0.25 * np.exp(-(((q + 0.55) / 0.12) ** 2))
            )
            tone = tone * level * (1 + 0.03 * rng.standard_normal(tone.shape[:1] + (1,)))
            img = img * (1 - soft) + soft * tone[..., None]
    return img.astype(np.float32)


def _expose(
    img: Array, cam: Camera, light: Light, sensor: Sensor, scale: float, rng: Any
) -> tuple[Array, Array]:
    """Return the 8-bit picture and its noise-free twin."""
    v, u = np.mgrid[: cam.shape[0], : cam.shape[1]].astype(np.float32)
    c = cam.centre_px
    far = np.hypot(u - c[0], v - c[1]) / np.hypot(*c)
    img = img * (1 / (1 + light.vignette * far**2) ** 2)[..., None]  # cos^4 = (1 + tan^2)^-2
    img = img * np.array(light.tint, np.float32) * scale
    if not sensor.colour:
        img = img @ GREY
    clean = np.clip(img, 0, 1)
    electrons = img * sensor.full_well
    noisy = electrons + np.sqrt(np.maximum(electrons, 0) + sensor.read_e**2) * rng.standard_normal(
        img.shape
    )
    out = np.clip(noisy / sensor.full_well, 0, 1)
    code = [255 * np.power(q, sensor.gamma) for q in (out, clean)]
    return np.round(code[0]).astype(np.uint8), code[1]


# ---------------------------------------------------------------- choice of the setting
def _make_light(rng: Any) -> Light:
    style = rng.choice(["dome", "ring", "side", "mixed"])
    dome, ring, side = {
        "dome": (1, 0.1, 0.1),
        "ring": (0.35, 0.8, 0.05),
        "side": (0.4, 0.1, 0.8),
        "mixed": (0.5, 0.4, 0.35),
    }[str(style)] * rng.uniform(0.8, 1.2, 3)
    return Light(
        dome,
        ring,
        np.radians(rng.uniform(30, 60)),
        side,
        rng.uniform(0, 2 * np.pi),
        np.radians(rng.uniform(28, 55)),
        tuple(rng.normal(0, 0.12, 2)),
        rng.uniform(0.02, 0.12),
        tuple(1 + rng.normal(0, 0.05, 3)),
    )


def _make_optics(ink: str, rng: Any) -> Optics:
    baths = [(0.40, 0.36, 0.28), (0.45, 0.46, 0.44), (0.52, 0.50, 0.45), (0.33, 0.34, 0.33)]
    bath = np.array(baths[int(rng.integers(4))]) * rng.uniform(0.85, 1.1)
    if ink == "milky" and rng.random() < 0.4:
        bath = np.array([0.10, 0.11, 0.12])
    colour, absorb, scatter = bath, np.full(3, 0.1), 5.0
    if ink == "pale":
        colour = (
            bath
            * (1 + rng.choice([-1, 1]) * rng.uniform(0.04, 0.12))
            * (1 + rng.normal(0, 0.015, 3))
        )
    elif ink == "dark":
        colour = np.array(
            [(0.05, 0.05, 0.06), (0.16, 0.03, 0.03), (0.03, 0.06, 0.14)][int(rng.integers(3))]
        )
    elif ink == "dyed":
        dye = [(0.3, 1.6, 1.4), (1.8, 0.9, 0.25), (0.25, 0.5, 1.9), (1.5, 0.5, 1.0)][
            int(rng.integers(4))
        ]
        absorb = np.array(dye) * rng.uniform(0.5, 1.6)
        colour = np.exp(-absorb)
    elif ink == "milky":
        absorb, scatter = np.array([0.10, 0.13, 0.2]) * rng.uniform(0.5, 1.5), rng.uniform(3, 9)
    gloss = rng.uniform(0.3, 0.8) if ink == "clear" else rng.uniform(0.03, 0.35)
    return Optics(
        ink,
        colour,
        bath,
        absorb,
        scatter,
        gloss,
        rng.uniform(0, 0.03),
        rng.uniform(0.08, 0.16),
        rng.uniform(0.08, 0.22),
    )


def _make_process(rng: Any, width: float, flow: float = 1.0, shift: Any = None) -> Process:
    if shift is None:
        r, a = 0.15 * np.sqrt(rng.random()), rng.uniform(0, 2 * np.pi)
        shift = (float(r * np.cos(a)), float(r * np.sin(a)))
    return Process(
        flow,
        tuple(shift),
        rng.uniform(0.03, 0.06),
        rng.uniform(0.02, 0.05) * width,
        rng.uniform(0.5, 0.75),
        float(rng.choice([0.5, 0.75, 1.0])),
        rng.uniform(0.15, 0.6),
    )


@dataclass
class Layer:
    """Lines of one height."""

    strokes: list[Stroke]
    width: float
    lumens: list[Any]
    process: Process
    plan: dict[str, Any]
    deposits: list[Deposit]
    shares: list[Any]


def _make_layers(
    kind: str, rng: Any, faults: dict[str, Any], size: float, origin: Array
) -> list[Layer]:
    """Lay out all layers; only the last one's strokes (embedded: all) are fresh."""
    need_lumen = _count(faults.get("closed")) or faults.get("lumens")
    names = (
        ["rings", "solid_hole"]
        if need_lumen
        else ["lines", "lines", "rings", "waves", "solid", "solid_hole"]
    )
    if kind == "embedded":
        names = ["rings"] if need_lumen else ["lines", "waves", "rings"]
    name = faults.get("pattern") or str(rng.choice(names))
    count = {
        "single": 1,
        "stack": int(rng.integers(2, 7)),
        "embedded": int(rng.integers(2, 4)),
        "laser": int(rng.integers(1, 3)),
    }[kind]
    count = int(faults.get("layers") or count)
    half = (0.40 if kind in ("single", "laser") else 0.36) * size - 0.2
    first = rng.uniform(0, np.pi) if name not in ("solid", "solid_hole") else rng.normal(0, 0.05)
    if name in ("lines", "waves"):
        half *= 0.86
    turn = float(rng.choice([0, np.pi / 2, np.pi / 3 if name == "lines" else np.pi / 2]))
    if kind == "embedded" and turn == 0:
        turn = np.pi / 2
    base = _pattern(name, rng, half)
    thickness = base[1] * rng.uniform(0.5, 0.8)
    layers, number = [], 0
    depths = np.sort(rng.uniform(0.3, 4.0, count))[::-1]
    for k in range(count):
        fresh = kind == "embedded" or k == count - 1
        paths, width, lumens = base
        if kind == "embedded" and name != "rings" and k:
            paths, width, lumens = _pattern(name, rng, half)
        elif kind == "embedded" and k:
            paths, width, lumens = _pattern("lines", rng, half * 0.9)
        z = (k + 1) * thickness if kind != "embedded" else -depths[k]
        strokes = []
        for p in paths:
            xy = _turn(p, first + k * turn)
            slope = rng.uniform(-0.08, 0.08) if kind == "embedded" and name == "lines" else 0.0
            zs = (
                np.minimum(z + slope * xy[:, 0], -0.2)
                if kind == "embedded"
                else np.full(len(xy), z)
            )
            if kind == "embedded" and slope:  # straight but inclined: keep chords short
                a = np.linspace(0, 1, 21)
                xy = xy[0] + a[:, None] * (xy[-1] - xy[0])
                zs = np.minimum(z + slope * xy[:, 0], -0.2)
            thick = thickness if kind != "embedded" else width
            strokes.append(Stroke(np.column_stack([xy, zs]) + origin, width, number, fresh, thick))
            number += 1
        outlines = [
            (n, np.column_stack([_turn(o, first + k * turn), np.full(len(o), z)]) + origin, w)
            for n, o, w in lumens
        ]
        layers.append(Layer(strokes, width, outlines if fresh else [], None, {}, [], []))  # type: ignore[arg-type]
    return layers


def _print_layers(layers: list[Layer], rng: Any, faults: dict[str, Any]) -> dict[str, Any]:
    """Deposit every layer with its own process; plant faults into the fresh strokes."""
    fresh = [s for la in layers for s in la.strokes if s.fresh]
    plan = _plan(fresh, faults, rng)
    flow = faults.get("flow") or 1.0
    flow = float(rng.uniform(0.7, 1.3)) if flow is True else float(flow)
    proc = _make_process(rng, fresh[0].width, flow, faults.get("shift"))
    none: dict[str, Any] = {"gaps": [], "thin": [], "missing": []}
    for la in layers:
        mine = la.strokes[0].fresh
        la.process = proc if mine else _make_process(rng, la.width)
        la.plan = plan if mine else none
        done = [_deposit(s, la.process, la.plan, rng) for s in la.strokes]
        la.deposits, la.shares = [d for d, _ in done], [t for _, t in done]
    return {**plan, "flow": flow, "shift": proc.shift, "spread": proc.spread}


def _close_lumens(layers: list[Layer], count: int, rng: Any) -> list[Any]:
    """Fill `count` lumens with ink; return every lumen with its state."""
    every = [(la, lu) for la in layers for lu in la.lumens]
    shut = set(rng.permutation(len(every))[:count].tolist()) if every else set()
    out = []
    for k, (la, (name, outline, width)) in enumerate(every):
        if k in shut:
            c = outline[:-1].mean(0)
            c[:2] += la.process.shift
            r = width / 2 + 0.4 * la.width
            ring = np.linspace(0, 2 * np.pi, 24)
            xy = np.vstack(
                [
                    c[:2] + 0.6 * r * q * np.stack([np.cos(ring), np.sin(ring)], -1)
                    for q in (0, 0.5, 1)
                ]
            )
            h = rng.uniform(0.5, 0.9) * la.strokes[0].thickness
            size = 0.45 * r * (1 + 0.06 * rng.standard_normal(len(xy)))
            la.deposits.append(
                Deposit(np.column_stack([xy, np.full(len(xy), c[2])]), size, np.full(len(xy), h))
            )
        out.append((name, outline, float(width), k not in shut))
    return out


def _drop_blobs(
    layers: list[Layer], count: int, plan: dict[str, Any], size: float, origin: Array, rng: Any
) -> list[Any]:
    """Drop ink where no fresh path runs (a blob may touch a line's flank)."""
    top = layers[-1]
    fresh = [s for la in layers for s in la.strokes if s.fresh]
    pts = np.vstack(
        [s.at(np.linspace(0.0, float(s.length), int(s.length / 0.05) + 2))[:, :2] for s in fresh]
    )
    lumens = [lu for la in layers for lu in la.lumens]
    out: list[Any] = []
    for _ in range(count):
        for attempt in range(300):
            r = (
                rng.uniform(0.12, 0.5)
                * (0.7 if attempt > 100 else 1)
                * (0.7 if attempt > 200 else 1)
            )
            c = origin[:2] + rng.uniform(-0.41, 0.41, 2) * size
            clear = np.min(np.hypot(*(pts - c).T)) > top.width / 2 + 0.7 * r
            clear &= all(np.hypot(*(lu[1][:-1, :2].mean(0) - c)) > lu[2] / 2 + r for lu in lumens)
            clear &= all(np.hypot(c[0] - b[0], c[1] - b[1]) > r + b[2] for b in out)
            if clear:
                out.append((float(c[0]), float(c[1]), float(r)))
                n = 6
                xy = c + 0.12 * r * rng.standard_normal((n, 2))
                h = rng.uniform(0.5, 1.1) * top.strokes[0].thickness
                z = top.strokes[0].path[0, 2]
                top.deposits.append(
                    Deposit(
                        np.column_stack([xy, np.full(n, z)]), np.full(n, 0.9 * r), np.full(n, h)
                    )
                )
                break
    return out


def _choose_covers(
    wanted: Any, fresh: list[Stroke], size: float, rng: Any
) -> tuple[list[Any], list[Any]]:
    """Place bubbles, glare, needle upon lines; return (drawings, circles)."""
    kinds = (
        list(wanted)
        if isinstance(wanted, (list, tuple))
        else [
            str(rng.choice(["bubble", "glare", "needle"], p=[0.4, 0.4, 0.2]))
            for _ in range(int(wanted or 0))
        ]
    )
    covers, circles = [], []
    for kind in kinds:
        s = fresh[int(rng.integers(len(fresh)))]
        x, y = s.at(np.array([rng.uniform(0.1, 0.9) * s.length]))[0, :2]
        angle = rng.uniform(0, 2 * np.pi)
        r = float(rng.uniform(0.2, 0.45) if kind == "needle" else rng.uniform(0.3, 0.9))
        covers.append((kind, float(x), float(y), r, angle))
        if kind == "needle":
            for q in np.arange(0, 1.6 * size, 0.6 * r):
                circles.append(
                    (
                        float(x + (q + r * 0.5) * np.cos(angle)),
                        float(y + (q + r * 0.5) * np.sin(angle)),
                        1.25 * r,
                    )
                )
        else:
            circles.append((float(x), float(y), r * (1.1 if kind == "bubble" else 1.2)))
    return covers, circles


# ---------------------------------------------------------------- renderers
def _surfaces(
    layers: list[Layer], grid: Grid, floor: Array, level: float | None
) -> list[dict[str, Array]]:
    """Return surface, ink thickness and fresh thickness after each layer."""
    h, t, out = floor.copy(), np.zeros(grid.shape, np.float32), []
    for la in layers:
        bead = _bead_layer(la.deposits, la.width, la.process.power, grid)
        h, t = _lay(h, bead, la.width, la.process.sag, grid), t + bead
        out.append({"h": h, "t": t, "bead": bead})
    for o in out:  # a bath standing between the lines
        o["sunk"] = (
            np.maximum((level or 0) - o["h"], 0) if level else np.zeros(grid.shape, np.float32)
        )
        o["top"] = o["h"] + o["sunk"]
    return out


def _look(
    view: dict[str, Array], bath: Bath, optics: Optics, light: Light, grid: Grid, ink_grain: Array
) -> Array:
    ground = _bath_colour(bath, optics, grid)
    t = view["t"]
    img = _ink_colour(ground, t, view["h"], optics, grid)
    if optics.ink != "clear":
        img = img * (1 + ink_grain * (1 - np.exp(-t / 0.05)))[..., None]
    veil = np.exp(-2 * 1.2 * view["sunk"])[..., None]
    img = img * veil + ground * (1 - veil)
    wet = (t > 0.004) & (view["sunk"] < 0.01)
    relief = bath.relief * np.where(wet, 0.15, 1)
    bright, shine = _shade(view["top"] + relief.astype(np.float32), wet, light, optics, grid)
    return (img * bright[..., None] + shine[..., None] * 0.5).astype(np.float32)


def _look_into(
    layers: list[Layer],
    cam: Camera,
    z0: float,
    bath: Bath,
    optics: Optics,
    light: Light,
    grid: Grid,
) -> tuple[Array, Array]:
    """Paint immersed lines as seen on the bath's surface plane; also their coverage."""
    img = _bath_colour(bath, optics, grid)
    # far down the grains blend into a smooth background
    img = 0.6 * img + 0.4 * cv2.GaussianBlur(img, (0, 0), 0.1 / grid.pitch)
    cover = np.zeros(grid.shape, np.float32)
    for la in layers:
        t, depth = np.zeros(grid.shape, np.float32), np.zeros(grid.shape, np.float32)
        for d in la.deposits:
            if not len(d.xyz):
                continue
            p = d.xyz - (0, 0, 0.5 * la.strokes[0].thickness)
            xy, scale = cam.onto_plane(p, z0)
            _stamp(t, grid, xy, d.radius * scale, d.height, 0.5, depth, z0 - p[:, 2])
        np.maximum(cover, t, out=cover)
        img = _through_bath(img, t, depth, optics, light, grid)
    bright, shine = _shade(
        bath.relief.astype(np.float32), np.zeros(grid.shape, bool), light, optics, grid
    )
    return (img * bright[..., None] + 0.5 * shine[..., None]).astype(np.float32), cover


def _scan(
    view: dict[str, Array],
    grid: Grid,
    relief: Array,
    ink: str,
    covers: list[Any],
    axis: float,
    zero: tuple[float, Array],
    rng: Any,
) -> Array:
    """Return the height map of a triangulation laser, NaN where it saw nothing."""
    h, w = grid.shape
    t, top = view["t"], view["top"] + relief
    sink = {"pale": 0.0, "dark": 0.0, "dyed": 0.12, "clear": 0.35, "milky": 0.15}[
        ink
    ] * rng.uniform(0.6, 1.4)
    top = top - sink * np.minimum(t, 0.15)
    gx, gy = _gradient(top.astype(np.float32), grid.pitch)
    steep = np.hypot(gx, gy)
    out = (
        top
        + zero[0]
        + zero[1][0] * np.linspace(-0.5, 0.5, w)[None]
        + zero[1][1] * np.linspace(-0.5, 0.5, h)[:, None]
    )
    sigma = rng.uniform(0.010, 0.030)
    out = out + sigma * rng.standard_normal((h, w)) * (1 + 0.6 * np.minimum(steep, 2))
    out = out + 0.003 * rng.standard_normal((h, 1))
    spike = rng.random((h, w)) < 0.0008 + 0.01 * (steep > 1.5)
    out = np.where(spike, out + rng.normal(0, 0.15, (h, w)), out)
    patch = _noise((h, w), 0.12 / grid.pitch, rng) > (2.4 if ink != "clear" else 1.9)
    lost = (rng.random((h, w)) < 0.003 + 0.25 * np.clip((steep - 1.2) / 2, 0, 1)) | (
        patch & (rng.random((h, w)) < 0.8)
    )
    if ink == "clear":
        lost |= (t > 0.01) & (rng.random((h, w)) < 0.08)
    lost |= (
        _sky_line(top.astype(np.float32), grid.pitch, axis, np.radians(rng.uniform(45, 60))) > 0.03
    )
    x, y = grid.axes()
    for kind, cx, cy, r, angle in covers:
        d = np.hypot(x[None] - cx, y[:, None] - cy)
        if kind == "bubble":
            out = np.where(d < r, out + np.sqrt(np.clip(r * r - d * d, 0, None)) * 0.8, out)
            lost |= (d < r) & ((d > 0.75 * r) | (rng.random((h, w)) < 0.4))
        elif kind == "glare":
            lost |= d < r
        else:
            along = (x[None] - cx) * np.cos(angle) + (y[:, None] - cy) * np.sin(angle)
            across = np.abs((y[:, None] - cy) * np.cos(angle) - (x[None] - cx) * np.sin(angle))
            lost |= (along > 0) & (across < r)
    return np.where(lost, np.nan, out)


def _expected(layers: list[Layer]) -> dict[str, Any]:
    rows = [
        (a, b, s)
        for la in layers
        for s in la.strokes
        for a, b in zip(s.path[:-1], s.path[1:], strict=True)
    ]
    return {
        "start": np.array([r[0] for r in rows]),
        "end": np.array([r[1] for r in rows]),
        "width_mm": np.array([r[2].width for r in rows]),
        "stroke": np.array([r[2].number for r in rows], int),
        "fresh": np.array([r[2].fresh for r in rows], bool),
        "thickness_mm": float(layers[-1].strokes[0].thickness),
    }


def scene(
    kind: str,
    ink: str,
    rng: np.random.Generator,
    faults: dict[str, Any],
    *,
    size_mm: float = 8.0,
    um_per_px: float = 20.0,
) -> Scene:
    """Return a picture with known truth.

    Parameters
    ----------
    kind, ink : one of KINDS, one of INKS.
    faults : counts or explicit values.  ``gaps`` n or [length mm], ``thin`` n or [share],
        ``flow`` True or factor, ``blobs`` n, ``hidden`` n or list of "bubble", "glare",
        "needle", ``missing`` n strokes, ``closed`` n lumens.  Setting: ``shift`` (dx, dy),
        ``lumens`` True (a pattern with lumens), ``pattern`` "lines", "waves", "rings",
        "solid", "solid_hole", ``layers`` n, ``colour`` bool, ``before`` bool.

    Raises
    ------
    ValueError
        If kind, ink or a fault's name is unknown.
    """
    known = {
        "gaps",
        "thin",
        "flow",
        "blobs",
        "hidden",
        "missing",
        "closed",
        "shift",
        "lumens",
        "pattern",
        "layers",
        "colour",
        "before",
    }
    if kind not in KINDS or ink not in INKS or set(faults) - known:
        raise ValueError(
            f"unknown kind {kind!r}, ink {ink!r} or fault among {sorted(faults)}; "
            f"known: {KINDS}, {INKS}, {sorted(known)}"
        )
    origin = np.array([*rng.uniform(size_mm / 2, 100 - size_mm / 2, 2), rng.uniform(0, 60)])
    if kind == "embedded":
        origin[2] += 5.0
    layers = _make_layers(kind, rng, faults, size_mm, origin)
    plan = _print_layers(layers, rng, faults)
    lumens = _close_lumens(layers, _count(faults.get("closed")), rng)
    fresh = [s for la in layers for s in la.strokes if s.fresh]
    blobs = _drop_blobs(layers, _count(faults.get("blobs")), plan, size_mm, origin, rng)
    covers, hidden = _choose_covers(faults.get("hidden"), fresh, size_mm, rng)
    shares = [
        (s.number, t, q)
        for la in layers
        for s, (t, q) in zip(la.strokes, la.shares, strict=False)
        if s.fresh
    ]
    share = (
        np.concatenate([np.full(len(t), n) for n, t, _ in shares]),
        np.concatenate([t for _, t, _ in shares]),
        np.concatenate([q for _, _, q in shares]),
    )
    truth = {
        "gaps": plan["gaps"],
        "thin": plan["thin"],
        "flow": plan["flow"],
        "blobs": blobs,
        "hidden": hidden,
        "shift": plan["shift"],
        "width_ratio": float(np.median(share[2][share[2] > 0] ** plan["spread"])),
        "share": share,
        "lumens": lumens,
        "missing": plan["missing"],
    }
    paint = _paint_laser if kind == "laser" else _paint_camera
    picture, before, to_pixels, info = paint(
        kind, ink, rng, faults, layers, covers, origin, size_mm, um_per_px
    )
    return Scene(
        picture, before, to_pixels, _expected(layers), truth, {"kind": kind, "ink": ink, **info}
    )


def _paint_laser(
    kind: str,
    ink: str,
    rng: Any,
    faults: dict[str, Any],
    layers: list[Layer],
    covers: list[Any],
    origin: Array,
    size: float,
    um: float,
) -> tuple[Array, Array | None, Any, dict[str, Any]]:
    pitch, n = um / 1000, round(size * 1000 / um)
    grid = Grid(origin[0] - size / 2, origin[1] - size / 2, pitch, (n, n))
    bath = _make_bath(grid, rng)
    views = _surfaces(layers, grid, np.zeros(grid.shape, np.float32), None)
    zero, axis = (
        (origin[2] + rng.normal(0, 0.05), rng.normal(0, 0.02, 2)),
        float(rng.choice([0, np.pi / 2, np.pi])),
    )
    picture = _scan(views[-1], grid, bath.relief, ink, covers, axis, zero, rng)
    before = None
    if faults.get("before", len(layers) > 1):
        flat = {"t": np.zeros(grid.shape, np.float32), "top": np.zeros(grid.shape, np.float32)}
        before = _scan(
            views[-2] if len(views) > 1 else flat, grid, bath.relief, ink, [], axis, zero, rng
        )
    info = {"fresh_px": views[-1]["bead"], "ink_px": views[-1]["t"]}
    return picture, before, (lambda p: grid.index(np.atleast_2d(np.asarray(p, float)))), info


def _paint_camera(
    kind: str,
    ink: str,
    rng: Any,
    faults: dict[str, Any],
    layers: list[Layer],
    covers: list[Any],
    origin: Array,
    size: float,
    um: float,
) -> tuple[Array, Array | None, Any, dict[str, Any]]:
    n = round(size * 1000 / um)
    shape = (int(n * rng.choice([1.0, 0.94])), n)
    over = 2 if n <= 600 else 1
    pitch, wide = um / 1000 / over, 1.2 * size
    m = int(wide / pitch)
    grid = Grid(origin[0] - wide / 2, origin[1] - wide / 2, pitch, (m, m))
    optics, light = _make_optics(ink, rng), _make_light(rng)
    colour = bool(faults.get("colour", rng.random() < 0.5))
    sensor = Sensor(
        rng.uniform(0.6, 1.2),
        rng.uniform(6e3, 2e4),
        rng.uniform(4, 12),
        float(rng.choice([0.4545, 0.6, 1.0])),
        rng.uniform(0.6, 0.8),
        colour,
    )
    bath = _make_bath(grid, rng)
    grain = 0.012 * _noise(grid.shape, 0.03 / pitch, rng) + 0.01 * _noise(
        grid.shape, 0.3 / pitch, rng
    )
    in_bath = kind == "stack" and rng.random() < 0.5
    level = (
        float(layers[-1].strokes[0].path[0, 2] - origin[2]) * rng.uniform(0.35, 0.75)
        if in_bath
        else None
    )
    top_z = float(layers[-1].strokes[0].path[0, 2])
    cam = _make_camera(
        np.array([origin[0], origin[1], origin[2] if kind == "embedded" else top_z]),
        um,
        shape,
        rng,
        origin[2] if kind == "embedded" else None,
    )
    cam0 = _moved(cam, um, rng)
    light0 = replace(
        light,
        gain=light.gain * rng.uniform(0.92, 1.08),
        azimuth=light.azimuth + rng.normal(0, 0.05),
        gradient=tuple(np.array(light.gradient) + rng.normal(0, 0.03, 2)),
    )
    want = faults.get("before", kind == "stack")
    views = (
        []
        if kind == "embedded"
        else _surfaces(layers, grid, np.zeros(grid.shape, np.float32), level)
    )
    zero = np.zeros(grid.shape, np.float32)
    base = level or 0.0
    bare = {"h": zero, "t": zero, "bead": zero, "sunk": zero + base, "top": zero + base}
    shots = []
    for c, li, last in ((cam, light, True), (cam0, light0, False))[: 2 if want else 1]:
        b = bath if last else _stir(bath, 0.35, grid, rng)
        if kind == "embedded":
            radiance, cover = _look_into(layers if last else [], c, origin[2], b, optics, li, grid)
            surface, maps = zero, [cover]
        else:
            v = views[-1] if last else views[-2] if len(views) > 1 else bare
            radiance, surface, maps = (
                _look(v, b, optics, li, grid, grain),
                v["top"],
                [v["bead"], v["t"]],
            )
        radiance = cv2.GaussianBlur(radiance, (0, 0), sensor.blur_px * over)
        got = _see(c, grid, surface, origin[2], [radiance, *maps])
        img = _cover(got[0], c, covers, top_z, um, int(origin[0] * 1e6)) if last else got[0]
        shots.append((img, c, li, got[1:]))
    scale = sensor.target / float(np.percentile(shots[0][0] @ GREY, 90))
    exposed = [_expose(i, c, li, sensor, scale, rng) for i, c, li, _ in shots]
    noise = float(np.std((exposed[0][0] - exposed[0][1])[8:-8, 8:-8]))
    info = {
        "fresh_px": shots[0][3][0],
        "ink_px": shots[0][3][-1],
        "noise_levels": noise,
        "light": light,
        "sensor": sensor,
        "optics": optics,
        "before_to_pixels": cam0.project if want else None,
        "camera": cam,
        "bath_level_mm": level,
        "clean": exposed[0][1],
    }
    return exposed[0][0], exposed[1][0] if want else None, cam.project, info
