"""Test for leak paths that may be only the shadow of a bubble or particle in OCT.

Air in water sends back some thirty decibels more than gel's walls do (Fresnel: 2 % at an index of
1 against 1.33, 0.001 % at 1.34 against 1.33), and little light passes it. Gel below it looks like
liquid down to the end of the A-scan, and no value there can tell. So a way is held again against
its limit with all that is shaded taken for gel.
"""

from __future__ import annotations

import numpy as np

from kernels.arrays import BoolArray, FloatArray
from registration.alignment import Fit
from registration.alignment.distance import ModelSurface
from registration.measuring.topology.gel_paths import LeakPath, Scene, mid_evidence
from registration.segmentation.evidence import GLARE, SIGMA_MM
from registration.segmentation.glints import Glints


def may_be_shade(
    way: LeakPath, width_mm: float, scene: Scene, glints: Glints, surface: ModelSurface, fit: Fit
) -> bool:
    """Return whether a way is none once what lies in the shade of a glint is taken for gel.

    Parameters
    ----------
    way : LeakPath
    width_mm : float, mm
        Of the way: a shadow is as wide as what throws it, and a glint lies anywhere on that.
    scene : Scene
    glints : Glints
    surface : ModelSurface
        Its walls send light back too: a glint near one counts only where it outshines the walls
        of this part `GLARE` times.
    fit : Fit
        Scan to part.
    """
    reach = width_mm / 2 + SIGMA_MM
    path = fit.invert(way.path)
    low, high = path[:, :2].min(axis=0) - reach, path[:, :2].max(axis=0) + reach
    around = ((glints.place[:, :2] > low) & (glints.place[:, :2] < high)).all(axis=1)
    place, share = glints.place[around], glints.share[around]
    away = np.abs(surface.query(fit.apply(place)).distance) if len(place) else np.empty(0)
    counts = (away > scene.clear_mm) | (share > GLARE * glints.usual)
    shaded = _below(path, place[counts], reach, glints.down)
    if not shaded.any():
        return False
    grid = scene.grid
    index = np.round((way.path - grid.origin_mm) / grid.step_mm).astype(np.int64)[:, ::-1]
    index = np.clip(index, 0, np.array(scene.mean.shape) - 1)
    mean = np.nan_to_num(scene.mean[tuple(index.T)].astype(np.float64), nan=1.0)
    return bool(np.where(shaded, 1.0, mean).mean() >= mid_evidence(scene.liquid))


def _below(path: FloatArray, glints: FloatArray, reach: float, down: int) -> BoolArray:
    """Return which places (n, 3) of a path lie below a glint (m, 3) within `reach`; mm, (n,).

    Nearer than twice that it may be the way's own ceiling, which faces the light.
    """
    apart = np.linalg.norm(path[:, None, :2] - glints[None, :, :2], axis=2)
    above = down * (path[:, None, 2] - glints[None, :, 2]) > 2 * reach
    return np.asarray(((apart <= reach) & above).any(axis=1))
