"""Tissues: a closed shape and its signed distance, from files, surfaces or parameters."""

from design.tissue.arrays import GridArrays
from design.tissue.grid import SignedDistanceGrid
from design.tissue.heart import biventricle
from design.tissue.load import load_tissue
from design.tissue.shapes import Surface, annulus, block, cylinder, folded_cortex
from design.tissue.spacing import SpacingRule
from design.tissue.surface import SizeLimits, tissue_from_surface
from design.tissue.tissue import Tissue

__all__ = [
    "GridArrays",
    "SignedDistanceGrid",
    "SizeLimits",
    "SpacingRule",
    "Surface",
    "Tissue",
    "annulus",
    "biventricle",
    "block",
    "cylinder",
    "folded_cortex",
    "load_tissue",
    "tissue_from_surface",
]
