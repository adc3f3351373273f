"""Describe in words a part's motion between two poses, and its orientation to the light."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from kernels.arrays import FloatArray

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
