"""Options of the 3D flow solver, its memory, and its finite-element library NGSolve."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from design.errors import FlowError
from design.hemodynamics.three_d.meshing.curve import least_jacobian
from design.hemodynamics.three_d.meshing.lumen_mesh import EDGES, LumenMesh
from design.units import WATER_DENSITY
from kernels.arrays import FloatArray

LAMINAR: Final = 2000.0
"""Reynolds number by the diameter above which steady flow in a lumen may not be laminar."""


@dataclass(frozen=True)
class FlowOptions:
    """Options of the 3D flow solver.

    Attributes
    ----------
    order : int
        Of velocity: 2 or 3; pressure has one less.
    convection : bool
        Navier–Stokes, or Stokes flow, without inertia of turning and of narrowing.
    density : float, Pa·s²/mm²
        Of steady flow; pulsatile conditions have their own.
    memory_gb : float, optional
        Limit; without it, what the machine has free.
    """

    order: int = 3
    convection: bool = True
    density: float = WATER_DENSITY
    memory_gb: float | None = None

    def __post_init__(self) -> None:
        if self.order not in (2, 3):
            raise FlowError(f"elements of order {self.order}; take 2 or 3")


_BYTES: Final = {2: 5500.0, 3: 7000.0, "general": 15000.0}
"""By unknown, by order; of a factor that isn't symmetric: a third more than was measured on pipes
and on networks of 170,000 unknowns."""


def unknowns(mesh: LumenMesh, order: int) -> int:
    """Return the number of velocity and pressure unknowns."""
    corners, edges, tets = mesh.corner_count, len(mesh.points) - mesh.corner_count, len(mesh.tets)
    triangles = (4 * tets + len(mesh.faces)) // 2
    if order == 2:
        return 3 * (corners + edges) + corners
    return 3 * (corners + 2 * edges + triangles) + corners + edges


def free_bytes() -> float | None:
    """Return the machine's free memory, or all of it where that is unknown, or None."""
    lines = Path("/proc/meminfo")
    if lines.exists():
        found = [x for x in lines.read_text().splitlines() if x.startswith("MemAvailable:")]
        if found:
            return float(found[0].split()[1]) * 1024.0
    try:
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, ValueError, OSError):
        return None


def fits_general(count: int) -> bool:
    """Return whether a factor of a matrix that isn't symmetric fits into the free memory."""
    free = free_bytes()
    return free is None or _BYTES["general"] * count < free


def check_memory(mesh: LumenMesh, options: FlowOptions) -> None:
    """Raise `FlowError` if a solution takes more memory than is free or allowed."""
    needed = 200e6 + _BYTES[options.order] * unknowns(mesh, options.order)
    limit = free_bytes() if options.memory_gb is None else options.memory_gb * 1e9
    if limit is not None and needed > limit:
        whose = "free here" if options.memory_gb is None else "allowed (memory_gb)"
        raise FlowError(
            f"3D flow on {len(mesh.tets):,} elements of order {options.order} has "
            f"{unknowns(mesh, options.order):,} unknowns and takes some {needed / 1e9:.1f} GB, "
            f"above the {limit / 1e9:.1f} GB {whose}; take order 2, a coarser mesh, a part of the "
            "network, or MPI ranks"
        )


CURVED: Final = 4
"""Degrees added to NGSolve's integration order, which leaves out the deformation that curves the
elements. Without it pressures are off by 2e-4 of FEniCSx's; with it they agree to 1.5e-8."""
_BLAS: Final = "OPENBLAS_NUM_THREADS"


def load_engine() -> Any:
    """Import ngsolve.

    Raises
    ------
    FlowError
        When the extra isn't installed.
    """
    # Its BLAS reads this once, as it is loaded. Threads of its own for blocks of some 50 rows
    # make a factorisation eight times slower (measured).
    before = os.environ.get(_BLAS)
    os.environ.setdefault(_BLAS, "1")
    try:
        import ngsolve
    except ImportError as exc:
        raise FlowError(
            "3D flow needs the finite-element engine NGSolve, which isn't installed; "
            "pip install 'printctl[flow3d]', or stay with 0D and 1D"
        ) from exc
    finally:
        if before is None:
            os.environ.pop(_BLAS, None)
    return ngsolve


@contextmanager
def running_engine() -> Iterator[Any]:
    """Yield NGSolve on one thread.

    Results are the same to the last digit only for the same number of threads; on two cores that
    others use too, a second makes it slower (3.3 s for 1.1).
    """
    ngsolve = load_engine()
    ngsolve.SetNumThreads(1)
    ngsolve.ngsglobals.msg_level = 0
    with ngsolve.TaskManager():
        yield ngsolve


WALL_NAME: Final = "wall"


def port_name(port: int) -> str:
    """Return the name of a port's faces in NGSolve's mesh."""
    return f"port{port}"


def engine_mesh(ng: Any, mesh: LumenMesh) -> Any:
    """Convert a mesh to NGSolve's: straight tetrahedra, a deformation, named wall and ports.

    Raises
    ------
    FlowError
        An element that isn't mapped one to one (see `straighten_edges`), labels without a port.
    """
    _check(mesh)
    curved = ng.Mesh(_straight(mesh))
    if np.any(_bent(mesh)):
        # The deformation lives on the mesh that it deforms, so that it is held there.
        curved.SetDeformation(_deformation(ng, curved, mesh))
    return curved


def _check(mesh: LumenMesh) -> None:
    least = least_jacobian(mesh)
    bad = np.flatnonzero(least <= 0.0)
    if len(bad):
        raise FlowError(
            f"{len(bad)} curved elements of {len(least)} may fold (element {int(bad[0])}: least "
            f"Jacobian {least[bad[0]]:.2g} of the straight one's); straighten them first"
        )
    strangers = np.setdiff1d(mesh.label, np.arange(len(mesh.ports) + 1))
    if len(strangers):
        raise FlowError(
            f"boundary faces have label {int(strangers[0])}, and the mesh has {len(mesh.ports)} "
            "ports; label them 0 (wall) or the port's number plus 1"
        )


def _straight(mesh: LumenMesh) -> Any:
    from netgen import meshing  # comes with NGSolve

    straight = meshing.Mesh(dim=3)
    straight.AddPoints(np.ascontiguousarray(mesh.points[: mesh.corner_count]))
    names = [WALL_NAME, *(port_name(k) for k in range(len(mesh.ports)))]
    for label in range(len(names)):
        straight.Add(meshing.FaceDescriptor(surfnr=label + 1, domin=1, bc=label + 1))
        faces = mesh.faces[mesh.label == label, :3].astype(np.int32)
        if len(faces):
            straight.AddElements(dim=2, index=label + 1, data=np.ascontiguousarray(faces), base=0)
    tets = np.ascontiguousarray(mesh.tets[:, :4].astype(np.int32))
    straight.AddElements(dim=3, index=1, data=tets, base=0)
    for label, name in enumerate(names):
        straight.SetBCName(label, name)
    return straight


def _bent(mesh: LumenMesh) -> FloatArray:
    """Return how far each element's edge nodes are off the straight middles, (t, 6, 3), mm."""
    return np.asarray(mesh.points[mesh.tets[:, 4:]] - mesh.points[mesh.tets[:, EDGES]].mean(axis=2))


def _deformation(ng: Any, curved: Any, mesh: LumenMesh) -> Any:
    """Return the quadratic displacement; NGSolve's bubble of an edge is -1/8 at its middle."""
    ends = np.array([[v.nr for v in edge.vertices] for edge in curved.edges])
    key = _pair_key(ends, mesh.corner_count)
    order = np.argsort(key)
    ours = _pair_key(mesh.tets[:, EDGES].reshape(-1, 2), mesh.corner_count)
    edge = order[np.searchsorted(key[order], ours)]
    field = ng.GridFunction(ng.VectorH1(curved, order=2))
    values = field.vec.FV().NumPy().reshape(3, -1)
    values[:, mesh.corner_count + edge] = -8.0 * _bent(mesh).reshape(-1, 3).T
    return field


def _pair_key(pair: Any, count: int) -> Any:
    low, high = np.sort(pair, axis=1).T
    return low.astype(np.int64) * count + high
