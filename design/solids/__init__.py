"""Printable solids (lumens, tubes, bodies, fittings) from networks: build, check, read, write.

Goes in: a network and a body. Comes out: closed triangle surfaces and their files. Begin with
`lumen.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from design.geometry.crossings import find_crossings
    from design.solids.connectors import (
        PlacedConnector,
        connector_parts,
        with_connector,
        with_connectors,
    )
    from design.solids.construct import (
        block_solid,
        chamber_solid,
        construct_solid,
        cylinder_solid,
        solid_from_surface,
    )
    from design.solids.dimensions import Chamber, Connector, check_connector
    from design.solids.files.check import validate_file, validate_files
    from design.solids.files.read import read_solid
    from design.solids.files.step import write_step
    from design.solids.files.threemf import Part, write_3mf
    from design.solids.files.write import write_obj, write_ply, write_solid_vtp, write_stl
    from design.solids.lumen import lumen_pair, lumen_solid, tube_outside, tube_solid
    from design.solids.marks import fiducial_places, text_solid, with_text
    from design.solids.ports import Port, end_ports, find_ports, open_ends
    from design.solids.solid import Solid
    from design.solids.topology import construct_genus, network_genus, surface_genus

__all__ = [
    "Chamber",
    "Connector",
    "Part",
    "PlacedConnector",
    "Port",
    "Solid",
    "block_solid",
    "chamber_solid",
    "check_connector",
    "connector_parts",
    "construct_genus",
    "construct_solid",
    "cylinder_solid",
    "end_ports",
    "fiducial_places",
    "find_crossings",
    "find_ports",
    "lumen_pair",
    "lumen_solid",
    "network_genus",
    "open_ends",
    "read_solid",
    "solid_from_surface",
    "surface_genus",
    "text_solid",
    "tube_outside",
    "tube_solid",
    "validate_file",
    "validate_files",
    "with_connector",
    "with_connectors",
    "with_text",
    "write_3mf",
    "write_obj",
    "write_ply",
    "write_solid_vtp",
    "write_step",
    "write_stl",
]

__getattr__, __dir__ = on_demand(__name__)
