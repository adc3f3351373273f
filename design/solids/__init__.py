"""From a network and a body to printable solids and their files."""

from design.solids.check import SolidCheck, validate_file
from design.solids.construct import block_solid, construct_solid, solid_from_surface
from design.solids.genus import construct_genus, network_genus
from design.solids.lumen import lumen_solid
from design.solids.ply import write_ply
from design.solids.ports import open_ends
from design.solids.read import read_solid
from design.solids.solid import Solid
from design.solids.stl import write_stl
from design.solids.threemf import write_3mf
from design.solids.topology import surface_genus

__all__ = [
    "Solid",
    "SolidCheck",
    "block_solid",
    "construct_genus",
    "construct_solid",
    "lumen_solid",
    "network_genus",
    "open_ends",
    "read_solid",
    "solid_from_surface",
    "surface_genus",
    "validate_file",
    "write_3mf",
    "write_ply",
    "write_stl",
]
