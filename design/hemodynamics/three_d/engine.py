"""Import the finite-element library NGSolve on demand, with a given number of threads."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

import numpy as np

from design.errors import FlowError
from design.hemodynamics.three_d.meshing.curve import least_jacobian
from design.hemodynamics.three_d.meshing.lumen_mesh import EDGES, LumenMesh
from kernels.arrays import FloatArray

THREADS: Final = 1
"""How many it works on unless told. Results are the same to the last digit only for the same
number; on two cores that others use too, a second makes it slower (measured: 3.3 s for 1.1)."""
CURVED: Final = 4
"""Degrees by which integrals are taken finer than the engine does by itself: it doesn't count the
deformation that curves the elements. Without, pressures are off by 2e-4 (against FEniCSx, which
does; with it they agree to 1.5e-8)."""
_BLAS: Final = "OPENBLAS_NUM_THREADS"


def load_engine() -> Any:
    """The module ngsolve.

    Raises
    ------
    FlowError
        When the extra isn't installed.
    """
    # Its BLAS reads this once, as it is loaded. Threads of its own for blocks of some 50 rows
    # make a factorisation eight times slower (measured).
    asked = os.environ.get(_BLAS)
    os.environ.setdefault(_BLAS, "1")
    try:
        import ngsolve
    except ImportError as exc:
        raise FlowError(
            "3D flow needs the finite-element engine NGSolve, which isn't installed; "
            "pip install 'printctl[flow3d]', or stay with 0D and 1D"
        ) from exc
    finally:
        if asked is None:
            os.environ.pop(_BLAS, None)
    return ngsolve


@contextmanager
def engine_threads(threads: int = THREADS) -> Iterator[Any]:
    """The engine, with so many threads."""
    ngsolve = load_engine()
    ngsolve.SetNumThreads(threads)
    ngsolve.ngsglobals.msg_level = 0
    with ngsolve.TaskManager():
        yield ngsolve


# Convert a lumen mesh to an NGSolve mesh: straight tetrahedra with a curving deformation.

WALL_NAME: Final = "wall"


def port_name(port: int) -> str:
    """Name of a port's faces in the engine."""
    return f"port{port}"


def engine_mesh(ng: Any, mesh: LumenMesh) -> Any:
    """The engine's mesh of curved elements, its wall and ports named.

    Parameters
    ----------
    ng : module
        From `load_engine`.
    mesh : LumenMesh

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
    # Loaded by the engine already; ours to import only where it is.
    from netgen import meshing

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
    """How far each element's edge nodes are off the straight middles, (t, 6, 3), mm."""
    return np.asarray(mesh.points[mesh.tets[:, 4:]] - mesh.points[mesh.tets[:, EDGES]].mean(axis=2))


def _deformation(ng: Any, curved: Any, mesh: LumenMesh) -> Any:
    """Quadratic displacement; the engine's bubble of an edge is -1/8 at its middle."""
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
