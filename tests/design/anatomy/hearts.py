"""A heart's tissue and options that several modules of tests grow in."""

from functools import cache

import numpy as np

from design.tissue import Tissue, biventricle, tissue_from_surface
from design.vasculature import GrowthOptions

HEART = GrowthOptions(terminals=160, clearance_mm=0.05, murray_exponent=2.5, pressure_drop_pa=1100)


@cache
def heart_tissue() -> Tissue:
    surface = biventricle(60.0)
    return tissue_from_surface(surface.vertices, surface.faces)


def trunk_length(trees):
    return sum(np.linalg.norm((t.distal - t.proximal)[t.given], axis=1).sum() for t in trees)
