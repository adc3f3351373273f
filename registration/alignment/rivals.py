"""Find equivalent poses by the design's symmetry; describe where alternatives differ."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from kernels.arrays import FloatArray
from registration.alignment.distance import ModelSurface
from registration.alignment.fit import Fit
from registration.alignment.search import Search

AXES = "xyz"
NEAR_DEG = 12.0
"""A turn or an axis that is off by less has the name of the plain one."""
STILL_DEG, STILL_MM = 2.0, 0.25
"""What turns or shifts by less isn't named."""
_TURNS = {180: "half turn", 90: "quarter turn", 120: "third of a turn"}


def motion_words(motion: FloatArray, middle: FloatArray) -> str:
    """Describe a motion (4, 4) of a part, or a mirroring, about its middle (3,) mm."""
    linear = motion[:3, :3]
    mirrored = bool(np.linalg.det(linear) < 0)
    u, _, vt = np.linalg.svd(linear)
    turn = Rotation.from_matrix((-1.0 if mirrored else 1.0) * (u @ vt)).as_rotvec(degrees=True)
    angle = float(np.linalg.norm(turn))
    axis = _axis_words(turn / angle) if angle > STILL_DEG else ""
    words = []
    if mirrored and angle > 180 - NEAR_DEG:
        words.append(f"mirrored along {axis}")
    else:
        words += ["mirrored through the middle"] * mirrored
        words += [f"{_turn_words(angle)} about {axis}"] * (angle > STILL_DEG)
    shift = motion[:3, :3] @ middle + motion[:3, 3] - middle
    length = float(np.linalg.norm(shift))
    if length > STILL_MM or not words:
        along = _axis_words(shift / max(length, 1e-12))
        words.append(f"a shift of {length:.2f} mm along {along}")
    return " and ".join(words)


def orientation_words(enters: FloatArray) -> str:
    """Say how a part lay whose light runs along the unit vector `enters` (3,) of its frame."""
    tilt = float(np.rad2deg(np.arccos(np.clip(np.abs(enters).max(), 0, 1))))
    axis = int(np.abs(enters).argmax())
    side = f"{'low' if enters[axis] > 0 else 'high'} {AXES[axis]}"
    lean = f", tilted by {tilt:.0f} degrees" if tilt >= 0.5 else ""
    if axis == 2:
        name = "turned over" if enters[2] > 0 else "upright"
        return f"{name}{lean} (light entered at its {side} side)"
    return f"on its side{lean} (light entered at its {side} side)"


def _turn_words(angle: float) -> str:
    for plain, name in _TURNS.items():
        if abs(angle - plain) < (NEAR_DEG if plain != 120 else 3.0):
            return f"a {name}"
    return f"a turn by {angle:.0f} degrees"


def _axis_words(axis: FloatArray) -> str:
    strongest = int(np.abs(axis).argmax())
    if abs(axis[strongest]) > np.cos(np.deg2rad(NEAR_DEG)):
        return AXES[strongest]
    return f"({axis[0]:.2f}, {axis[1]:.2f}, {axis[2]:.2f})"


DESIGN_POINTS = 12_000
"""On the design's surface, to find where two poses differ."""
SAME_MM = 0.05
"""Surfaces that differ by less everywhere are the same."""
BESIDE_MM = 0.25
"""A place is seen where a scanned point lies as near."""
CLOSE_MM = 0.25
"""Scanned points farther from the design don't belong to it."""
MIRROR = np.array([-1.0, 1.0, 1.0])
"""Of the scan's axes, to try its mirror image."""


@dataclass(frozen=True)
class AlternativePose:
    """Alternative pose of a scan.

    Attributes
    ----------
    motion : str
        Of the part from the pose found to this one, in words.
    mirrored : bool
        Whether it is one of the scan's mirror image.
    lead : float
        How many times as badly it fits where the two differ, see `contest`.
    apart_um : float, µm
        By how much the design differs from itself so moved, at most.
    place_mm : (3,) float64, mm
        Where that is, in the part's frame.
    seen : bool
        Whether the scan shows that place.
    amid : bool
        Whether scanned surface lies to all sides of that place, along each axis of the part.
    matrix : (4, 4) float64, mm
        The motion.
    vessels : tuple of int
        The vessel on which each comes to lie, where the design is the same; else empty.
    """

    motion: str
    mirrored: bool
    lead: float
    apart_um: float
    place_mm: FloatArray
    seen: bool
    amid: bool = False
    matrix: FloatArray = field(default_factory=lambda: np.eye(4))
    vessels: tuple[int, ...] = ()

    @property
    def same(self) -> bool:
        """Whether the design itself is the same under this motion."""
        return self.apart_um < 1e3 * SAME_MM


def design_symmetries(search: Search, points: FloatArray, best: Fit, most: int) -> list[Fit]:
    """Return poses of the scan under which the design as seen comes to lie on the design.

    They don't depend on how well the scan fits them: `points` (n, 3) of the scan are laid onto the
    design by `best`, and the design's nearest points are searched for on the design.
    """
    near = search.surface.query(best.apply(points))
    feet = near.foot[np.abs(near.distance - best.offset_mm) < CLOSE_MM]
    if len(feet) < 100:
        return []
    return [
        replace(
            best,
            rotation=own.rotation @ best.rotation,
            shift=own.rotation @ best.shift + own.shift,
            stretch=np.ones(3),
        )
        for own in search.poses(feet, most)
    ]


def describe(
    surface: ModelSurface, seen: FloatArray, best: Fit, other: Fit, lead: float, mirrored: bool
) -> AlternativePose:
    """Describe another pose.

    Parameters
    ----------
    seen : (n, 3) float64, mm
        The scanned surface laid onto the design by `best`.
    other : Fit
        Of the scan, or of the scan times `MIRROR`.
    """
    turned = np.diag([*MIRROR, 1.0]) if mirrored else np.eye(4)
    motion = _rigid(other) @ turned @ np.linalg.inv(_rigid(best))
    points = spread_points(surface)
    apart = np.abs(surface.query(points @ motion[:3, :3].T + motion[:3, 3]).distance)
    worst = int(apart.argmax())
    near = (np.linalg.norm(points - points[worst], axis=1) < 1.0) & (apart > 0.8 * apart[worst])
    place = np.median(points[near], axis=0)
    place = points[near][np.linalg.norm(points[near] - place, axis=1).argmin()]
    away = float(cKDTree(seen).query(place)[0])
    return AlternativePose(
        motion=motion_words(motion, surface.bounds.mean(axis=0)),
        mirrored=mirrored,
        lead=lead,
        apart_um=1e3 * float(apart[worst]),
        place_mm=place,
        seen=away < BESIDE_MM,
        amid=bool(((seen.min(axis=0) < place) & (place < seen.max(axis=0))).all()),
        matrix=motion,
    )


def _rigid(fit: Fit) -> FloatArray:
    """The map without its stretch about the part's middle."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = fit.rotation, fit.shift
    return out


def spread_points(surface: ModelSurface, count: int = DESIGN_POINTS) -> FloatArray:
    """Return points (count, 3) spread evenly over the surface, the same every time."""
    rng = np.random.default_rng(0)
    a, b, c = (surface.triangles[:, k] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    chosen = rng.choice(len(area), count, p=area / area.sum())
    u, v = np.sort(rng.uniform(size=(2, count)), axis=0)[:, :, None]
    return np.asarray(u * a[chosen] + (v - u) * b[chosen] + (1 - v) * c[chosen])
