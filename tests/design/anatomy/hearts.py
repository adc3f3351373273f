"""A heart's tissue and options that several modules of tests grow in."""

from functools import cache

import numpy as np
from manifold3d import Manifold

from design.geometry.surface import Surface
from design.tissue import Tissue, biventricle, shapes
from design.tissue.zones import arrays_of
from design.vasculature import GrowthOptions
from tests.design.tissue.kept import kept_tissue

HEART = GrowthOptions(terminals=160, clearance_mm=0.05, murray_exponent=2.5, pressure_drop_pa=1100)


@cache
def heart_tissue() -> Tissue:
    return kept_tissue(biventricle(60.0))


def closed_heart(
    lid_mm: float, cut_mm: float = shapes.BASE_Z, left_wall: float = 9.0, right_wall: float = 4.5
) -> Surface:
    """`biventricle` with walls of a thickness, mm, cut at a height; a lid closes both cavities."""
    sides = 64
    left, right = shapes.LEFT_OUTER, shapes.RIGHT_OUTER
    cavity = Manifold.sphere(1.0, sides).scale(tuple(axis - left_wall for axis in left))
    left_whole = Manifold.sphere(1.0, sides).scale(left)
    right_whole = Manifold.sphere(1.0, sides).scale(right).translate(shapes.RIGHT_CENTRE)
    crescent = Manifold.sphere(1.0, sides).scale(tuple(axis - right_wall for axis in right))
    crescent = crescent.translate(shapes.RIGHT_CENTRE) - left_whole
    below = (cavity + crescent).trim_by_plane((0.0, 0.0, -1.0), lid_mm - cut_mm)
    body = (left_whole + right_whole).trim_by_plane((0.0, 0.0, -1.0), -cut_mm)
    return Surface(*arrays_of(body - below))


def trunk_length(trees):
    return sum(np.linalg.norm((t.distal - t.proximal)[t.given], axis=1).sum() for t in trees)
