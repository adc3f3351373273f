"""3D flow in lumens by finite elements: mesh, solve steady or pulsatile, wall shear, export.

Goes in: a network, or a lumen's surface, and conditions. Comes out: velocity and pressure in the
lumen. Begin with `steady.py`.
"""

from design.hemodynamics.three_d.engine import FlowOptions
from design.hemodynamics.three_d.march import Stepping, check_cycles, march_flow
from design.hemodynamics.three_d.meshing.curve import least_jacobian, straighten_edges
from design.hemodynamics.three_d.meshing.lumen_mesh import LumenMesh
from design.hemodynamics.three_d.residence import ResidenceTime, residence_time
from design.hemodynamics.three_d.solution import (
    Field,
    ThreeDSolution,
    WallShear,
    at_points,
    face_mean,
    shear_of_faces,
    wall_shear,
    write_flow_vtu,
)
from design.hemodynamics.three_d.steady import estimate_error, solve_steady
from design.hemodynamics.three_d.vessels.sections import (
    probe_steady,
    sections_at,
)

__all__ = [
    "Field",
    "FlowOptions",
    "LumenMesh",
    "ResidenceTime",
    "Stepping",
    "ThreeDSolution",
    "WallShear",
    "at_points",
    "check_cycles",
    "estimate_error",
    "face_mean",
    "least_jacobian",
    "march_flow",
    "probe_steady",
    "residence_time",
    "sections_at",
    "shear_of_faces",
    "solve_steady",
    "straighten_edges",
    "wall_shear",
    "write_flow_vtu",
]
