"""Tell how wide beads are whose ink, blur and camera aren't known, and how sure that is.

A profile at half of its height is as wide as the bead only where ink is opaque and the camera
linear. What else it means follows from the ink's absorption (μ, `registration.microscope.shade`),
the blur (σ) and the camera's γ. Each of a few kinds of ink and γ is fitted to the mean profile; the
width is the mean of all, weighted by how well they fit (Bayesian model averaging: Hoeting et al.
1999, Stat. Sci. 14, 382), and their disagreement is its uncertainty.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import least_squares

from registration.layer_images.in_light import LightMix
from registration.layer_images.values import FloatArray
from registration.microscope.shade import Shade, shade_profile

GAMMAS: Final = (1.0, 1.6, 2.2)
_LINEAR: Final = 0.1
"""Logarithm of ink over bath, below which γ changes nothing."""
_KINDS: Final = ((1.0, 0.1), (3.0, 0.1), (300.0, 0.3))
"""μ d of a translucent, a cloudy and an opaque ink, and how likely each is beforehand."""
_GLOWING: Final = ((0.3, 0.2),)
"""The same of ink lighter than the bath that scatters a little."""
ROUND: Final = (2.0, 0.5)
_DYES: Final = ((ROUND, 0.3), ((2.0, 0.75), 0.06), ((2.0, 1.0), 0.04), ((3.5, 0.286), 0.1))
"""The same of a clear dye, or of clear ink in a dark bath, in a bead that is round, a drop, a flat
drop (a parabola), or flattened with round sides. What the middle's light tells is μ d, below 0
where ink lets through more than the bath that it stands for.
"""
_CELLS: Final = 30
"""Steps of a computed profile in half a bead."""
_LEAST: Final = 0.05
_DOUBT: Final = 4.0
"""What widths may be off by, over what none of the kinds explains of a profile's height."""
_MODEL: Final = 0.0012
"""Of a profile's height: what none of the models is right to."""
_TOGETHER: Final = 1.5
"""Pixels over which a profile's errors are one."""


@dataclass(frozen=True)
class Optics:
    """What a picture's beads and camera are like.

    Attributes
    ----------
    shade : Shade
        Of the likeliest kind; its ``spread`` is the relative standard uncertainty of all widths.
    gamma : float
        Of the likeliest kind.
    diameter_mm : float, mm
        Of the bead of the mean profile, by all kinds.
    thickness : float
        μ d of the likeliest kind.
    """

    shade: Shade
    gamma: float
    diameter_mm: float
    thickness: float


@dataclass(frozen=True)
class _Kind:
    """A kind of ink and camera.

    Attributes
    ----------
    gamma : float
    thickness : (c,) float64
        μ d in each channel.
    prior : float
    section : (a, b)
        Way through the bead over that in its middle, (1 − |t|^a)^b at a part t of its half width.
    """

    gamma: float
    thickness: FloatArray
    prior: float
    section: tuple[float, float] = ROUND

    def shade(
        self, across_mm: FloatArray, diameter_mm: float, thickness: float, blur_mm: float
    ) -> FloatArray:
        """Light that is taken away at places across, over that in the unblurred middle, (m,)."""
        if self.section == ROUND:
            return shade_profile(across_mm, diameter_mm, thickness / diameter_mm, blur_mm)
        step = diameter_mm / (2 * _CELLS)
        beyond = math.ceil(5 * blur_mm / step) + 2
        fine = (np.arange(-_CELLS - beyond, _CELLS + beyond) + 0.5) * step
        part = np.minimum(np.abs(2.0 * fine / diameter_mm), 1.0)
        way = (1.0 - part ** self.section[0]) ** self.section[1]
        shade = np.expm1(-thickness * way) / math.expm1(-thickness)
        blurred = gaussian_filter1d(shade, blur_mm / step, mode="nearest", truncate=5.0)
        return np.interp(across_mm, fine, blurred)


@dataclass(frozen=True)
class _Fit:
    """A kind, fitted.

    Attributes
    ----------
    kind : _Kind
    diameter, blur : float, mm
    height : (c,) float64
    rms : float
        Of what stays, over the profile's height.
    spread : float
        Of the diameter's logarithm, by errors of the profile of its height.
    """

    kind: _Kind
    diameter: float
    blur: float
    height: FloatArray
    rms: float
    spread: float


def fit_optics(
    across_mm: FloatArray,
    logs: FloatArray,
    mix: LightMix,
    width_mm: float,
    px_mm: float,
    noise: float,
) -> Optics:
    """Fit kinds of ink and camera to a mean profile.

    Parameters
    ----------
    across_mm : (m,) float64, mm
        From 0 on: both halves are one.
    logs : (m, c) float64
        Channels of the mean profile, bath 0.
    mix : LightMix
        Of logarithms.
    width_mm : float, mm
        About.
    px_mm : float, mm
        A pixel.
    noise : float
        Standard uncertainty of the mean profile's values.
    """
    beads = _Beads(across_mm, logs[:, mix.used], mix.ink[mix.used], px_mm)
    fits = list(_fits(beads, width_mm))
    together = _TOGETHER * px_mm / float(across_mm[1] - across_mm[0])
    independent = max(4.0, len(across_mm) * len(mix.used) / max(together, 1.0))
    rest = np.array([f.rms for f in fits]) ** 2 + _MODEL**2
    prior = np.array([f.kind.prior for f in fits])
    score = np.log(prior) - 0.5 * independent * rest / rest.min()
    share = np.exp(score - score.max())
    share /= share.sum()
    diameter = np.array([f.diameter for f in fits])
    mean = float(share @ diameter)
    # Each fit's own uncertainty: what errors of the mean profile do to it.
    own = np.array([f.spread for f in fits]) * math.hypot(noise, _MODEL) * max(together, 1.0) ** 0.5
    best = fits[int(share.argmax())]
    unlike = _DOUBT * math.sqrt(max(best.rms**2 - noise**2, 0.0))
    spread = math.sqrt(float(share @ ((diameter / mean - 1.0) ** 2 + own**2)) + unlike**2)
    weight = np.abs(mix.mix * mix.ink)[mix.used]
    thickness = float(weight @ best.kind.thickness / weight.sum())
    return Optics(
        Shade(thickness / best.diameter, best.blur, best.rms, spread),
        best.kind.gamma,
        mean,
        thickness,
    )


@dataclass(frozen=True)
class _Beads:
    """Mean profile of beads: logarithms (m, c), ink's level in each channel, and a pixel."""

    across_mm: FloatArray
    logs: FloatArray
    ink: FloatArray
    px_mm: float


def _fits(beads: _Beads, width_mm: float) -> Iterator[_Fit]:
    flat = float(np.abs(beads.ink).max()) < _LINEAR
    for gamma in (1.0,) if flat else GAMMAS:
        light: FloatArray = np.expm1(gamma * beads.logs)
        first = _fit(beads, light, _Kind(gamma, _dense(-gamma * beads.ink), 1.0), width_mm)
        # Blur lessens the middle: a dye is as dense as the unblurred bead must be.
        dye = _dense(-np.log(np.clip(1.0 + first.height, 0.02, 50.0)))
        for section, prior in _DYES:
            yield _fit(beads, light, _Kind(gamma, dye, prior, section), first.diameter)
        lighter = bool(dye.max() < 0)
        for thickness, prior in (*_KINDS, *(_GLOWING if lighter else ())):
            if thickness > dye.max():  # pigments take less light than a dye as dense
                kind = _Kind(gamma, np.full(len(dye), thickness), prior)
                yield _fit(beads, light, kind, first.diameter)


def _dense(density: FloatArray) -> FloatArray:
    """Densities that a profile can be computed of."""
    return np.where(np.abs(density) < _LEAST, np.copysign(_LEAST, density), density)


def _fit(beads: _Beads, light: FloatArray, kind: _Kind, width_mm: float) -> _Fit:
    """Diameter and blur; each channel's height and ground are linear (variable projection)."""
    across = beads.across_mm
    size = math.sqrt(float((np.abs(light).max(axis=0) ** 2).sum()))
    middle = light.mean(axis=0)
    # Channels of one thickness share a shade.
    thick, of = np.unique(kind.thickness, return_inverse=True)

    def solved(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        diameter, blur = math.exp(p[0]), math.exp(p[1])
        shades = [kind.shade(across, diameter, float(t), blur) for t in thick]
        shade = np.column_stack(shades)[:, of]
        shade = shade - shade.mean(axis=0)
        power = np.maximum((shade**2).sum(axis=0), 1e-12)
        height = (shade * light).sum(axis=0) / power
        return (height * shade + middle - light) / size, height

    begin = [math.log(width_mm), math.log(max(0.1 * width_mm, 0.5 * beads.px_mm))]
    low = [math.log(width_mm / 2), math.log(0.15 * beads.px_mm)]
    high = [math.log(width_mm * 2), math.log(0.6 * width_mm)]
    found = least_squares(
        lambda p: solved(p)[0].ravel(),
        begin,
        bounds=(low, high),
        x_scale="jac",
        ftol=1e-4,
        max_nfev=20,
    )
    rest, height = solved(found.x)
    inverse = np.linalg.pinv(found.jac.T @ found.jac)
    rms = math.sqrt(float((rest**2).sum()) / len(across))
    return _Fit(
        kind, math.exp(found.x[0]), math.exp(found.x[1]), height, rms, math.sqrt(inverse[0, 0])
    )
