"""Find a tissue's separate parts; assign points to them; refuse parts without a terminal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.errors import TissueError
from design.geometry import build_triangle_tree
from design.tissue.closed import FaceArray, enclosed_volume
from design.tissue.depth import winding_number
from design.tissue.shells import enclosures, shells_of
from design.tissue.tissue import Tissue

FloatArray = NDArray[np.float64]

_TRIED = 4000
"""Points drawn in a part's bounds when it is asked whether perfusion is wanted there."""


@dataclass(frozen=True)
class Part:
    """A piece of a tissue that doesn't hang together with the rest.

    Attributes
    ----------
    faces : (m, 3) int32
        Of the tissue's vertices: its outer shell, without cavities.
    volume_mm3 : float
        Without its cavities and what lies in them.
    middle_mm : (3,) float64
        Of its bounds.
    """

    faces: FaceArray
    volume_mm3: float
    middle_mm: FloatArray


def parts_of(tissue: Tissue) -> tuple[Part, ...]:
    """The separate parts of a tissue, the largest first; parts that touch in a point are two.

    Raises
    ------
    TissueError
        When the surface has more than 2,000 shells.
    """
    points, faces = tissue.surface.vertices, tissue.surface.faces
    shell = shells_of(faces)
    count = int(shell.max()) + 1
    signed = np.array([enclosed_volume(points, faces[shell == n]) for n in range(count)])
    solid = np.flatnonzero(signed > 0)
    if len(solid) == 1:
        return (_part(tissue, faces[shell == solid[0]], tissue.volume_mm3),)
    holds = enclosures(points, faces, shell)
    volume = signed.copy()
    for cavity in np.flatnonzero(signed <= 0):
        around = solid[holds[solid, cavity]]
        if len(around):
            volume[around[np.argmin(signed[around])]] += signed[cavity]
    order = solid[np.argsort(-volume[solid], kind="stable")]
    return tuple(_part(tissue, faces[shell == n], float(volume[n])) for n in order)


def _part(tissue: Tissue, faces: FaceArray, volume_mm3: float) -> Part:
    corners = tissue.surface.vertices[np.unique(faces)]
    middle: FloatArray = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    return Part(np.ascontiguousarray(faces), volume_mm3, middle)


def part_numbers(tissue: Tissue, parts: tuple[Part, ...], points: FloatArray) -> NDArray[np.int64]:
    """Number of the part that each of ``points`` (n, 3), mm, lies in; -1 for none.

    Of parts within one another's cavities, the innermost.
    """
    number = np.full(len(points), -1)
    for n, part in enumerate(parts):  # the innermost, which is the smaller one, comes last
        tree = build_triangle_tree(tissue.surface.vertices, part.faces)
        for k, (x, y, z) in enumerate(points):
            if winding_number(tree, x, y, z) != 0:
                number[k] = n
    return number


def check_supplied(tissue: Tissue, ends: FloatArray) -> None:
    """Refuse a network none of whose terminals lies in some part where perfusion is wanted.

    Parameters
    ----------
    tissue : Tissue
    ends : (n, 3) float64, mm
        Where its terminals end.

    Raises
    ------
    TissueError
        Naming each part without a terminal by its size and place.
    """
    parts = parts_of(tissue)
    if len(parts) == 1:
        return
    reached = set(part_numbers(tissue, parts, ends).tolist())
    left = [n for n in range(len(parts)) if n not in reached and _wanted(tissue, parts, n)]
    if left:
        raise TissueError(
            f"the tissue has {len(parts)} separate parts, and vessels that enter one can't reach "
            f"another: no vessel ends in {_said(parts, left)}. Make a recipe of its own for each "
            "part, or take the part out of the mesh"
        )


def _wanted(tissue: Tissue, parts: tuple[Part, ...], number: int) -> bool:
    """Whether any place of a part has a demand above 0."""
    corners = tissue.surface.vertices[np.unique(parts[number].faces)]
    low, high = corners.min(axis=0), corners.max(axis=0)
    tried = low + np.random.default_rng(0).random((_TRIED, 3)) * (high - low)
    tried = tried[tissue.contains(tried)]
    own = tried[part_numbers(tissue, parts, tried) == number]
    return len(own) == 0 or bool((tissue.demand.weight(own) > 0).any())


def _said(parts: tuple[Part, ...], left: list[int], most: int = 3) -> str:
    """Size and place of some parts, for a message."""
    told = [
        "the part of {:.3g} mm³ around ({:.4g}, {:.4g}, {:.4g}) mm".format(
            parts[n].volume_mm3, *parts[n].middle_mm
        )
        for n in left[:most]
    ]
    more = f" and {len(left) - most} more" if len(left) > most else ""
    return ", ".join(told) + more
