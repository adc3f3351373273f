"""Put raised or engraved text on a solid's flat face; compute fiducial dimples' centres."""

from __future__ import annotations

import numpy as np
from manifold3d import CrossSection, FillRule, Manifold
from numpy.typing import NDArray

from design.errors import SolidError
from design.solids.manifolds import solid_manifold, subtract, unite
from design.solids.snap import solid_from_manifold
from design.solids.solid import Solid

Vector = NDArray[np.float64]

CHIRAL_PATTERN = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.55]])
"""Places of three fiducials over the pattern's size: a right triangle of three unequal sides.

Only the identity and the reflection in the triangle's own plane bring it onto itself, and the
latter puts the body on the wrong side of the face: so a face that carries it has one pose, and a
mirrored scan has none.
"""


def text_solid(text: str, height_mm: float, depth_mm: float) -> Solid:
    """``text`` in DejaVu Sans (shipped with matplotlib), in the xy plane, rising from z = 0.

    Parameters
    ----------
    text : str
        Reads along +x as seen from +z; begins at the origin.
    height_mm : float, mm
        Of a capital letter, about.
    depth_mm : float, mm

    Raises
    ------
    SolidError
        When a length isn't above 0, the text has nothing to be seen, or the font lacks a character.
    """
    if not (height_mm > 0.0 and depth_mm > 0.0):
        raise SolidError(f"text of {height_mm:g} x {depth_mm:g} mm; give lengths above 0")
    if not text.strip():
        raise SolidError(f"text {text!r} has nothing to be seen; give letters or digits")
    # Heavy (a CPU second), and every solid's module loads this one.
    from matplotlib.font_manager import FontProperties, findfont, get_font
    from matplotlib.textpath import TextPath

    font = FontProperties("DejaVu Sans")
    glyphs = get_font(findfont(font)).get_charmap()
    lacking = [sign for sign in dict.fromkeys(text) if ord(sign) not in glyphs]
    if lacking:
        raise SolidError(
            f"text {text!r}: DejaVu Sans has no {', '.join(map(repr, lacking))}; write it with "
            "other characters, in one line"
        )
    plain = text.replace("$", r"\$")  # or matplotlib reads a formula
    # 0.729 em is DejaVu's capital height.
    path = TextPath((0.0, 0.0), plain, size=height_mm / 0.729, prop=font)
    closed = [np.asarray(outline, dtype=np.float64) for outline in path.to_polygons()]
    outlines = [outline[:-1] for outline in closed if len(outline) > 3]
    section = CrossSection(outlines, FillRule.NonZero)
    return solid_from_manifold(Manifold.extrude(section, depth_mm), "the text")


def with_text(
    body: Solid, text: Solid, at: Vector, along: Vector, outward: Vector, *, engraved: bool = False
) -> Solid:
    """``body`` with a `text_solid` on a face, raised or engraved by the text's depth.

    Parameters
    ----------
    body, text : Solid
    at : (3,) float64, mm
        Where the text begins, on the face.
    along : (3,) float64
        Reading direction, in the face.
    outward : (3,) float64
        The face's normal, out of the body.
    engraved : bool
        Cut into the body; otherwise it rises from it.

    Raises
    ------
    SolidError
        When the directions don't make a frame.
    """
    z = _unit(outward, "outward")
    x = np.asarray(along, dtype=np.float64)
    x = _unit(x - (x @ z) * z, "along")
    mark = solid_manifold(text, "the text")
    deep = float(text.bounds[1, 2])
    # One part in twenty across the face, so that the two surely overlap or cut through.
    shift = -0.95 * deep if engraved else -0.05 * deep
    frame = np.column_stack([x, np.cross(z, x), z, np.asarray(at) + shift * z])
    placed, whole = mark.transform(frame), solid_manifold(body, "the body")
    done = subtract(whole, [placed]) if engraved else unite([whole, placed])
    return solid_from_manifold(done, "the body with its text")


def fiducial_places(at: Vector, along: Vector, outward: Vector, size_mm: float) -> Vector:
    """Centres (3, 3) of three dimples on a flat face that no turn or mirror confuses.

    Parameters
    ----------
    at : (3,) float64, mm
        The right angle's corner, on the face.
    along : (3,) float64
        The long leg's direction.
    outward : (3,) float64
        The face's normal.
    size_mm : float, mm
        Length of the long leg; the short one is 0.55 of it.

    Returns
    -------
    (3, 3) float64, mm
        For `construct_solid`'s ``dimples``.

    Raises
    ------
    SolidError
        When the size isn't above 0 or the directions don't make a frame.
    """
    if not size_mm > 0.0:
        raise SolidError(f"size_mm {size_mm:g}; give a length above 0")
    z = _unit(outward, "outward")
    x = np.asarray(along, dtype=np.float64)
    x = _unit(x - (x @ z) * z, "along")
    plane = np.stack([x, np.cross(z, x)])
    places: Vector = np.asarray(at, dtype=np.float64) + size_mm * CHIRAL_PATTERN @ plane
    return places


def _unit(vector: Vector, name: str) -> Vector:
    length = float(np.linalg.norm(vector))
    if not length > 1e-12:
        raise SolidError(f"{name} has no length of its own; give another direction")
    return np.asarray(vector, dtype=np.float64) / length
