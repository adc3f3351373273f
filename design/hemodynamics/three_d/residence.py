"""Residence time (age) of fluid throughout a lumen, and streamlines, of a steady 3D flow.

Age a obeys ∇·(u a) - D Δa = 1: it grows by a second each second, is carried, and spreads by
diffusion. Fluid comes in with age 0; nothing spreads through walls and ports. The weak form

    -∫ a u·∇w + ∫ D ∇a·∇w + ∫_ports max(u·n, 0) a w = ∫ w,

tested with w = 1, says that the flow-weighted mean age of what leaves is the lumen's volume over
the flow, exactly, for the discrete solution too: streamline diffusion (SUPG, Brooks & Hughes 1982,
doi 10.1016/0045-7825(82)90071-8) is tested with u·∇w, and adds nothing to that.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.errors import FlowError
from design.hemodynamics.three_d.engine import engine_mesh, port_name, running_engine
from design.hemodynamics.three_d.meshing.lumen_mesh import shapes
from design.hemodynamics.three_d.newton import Spaces, spaces
from design.hemodynamics.three_d.solution import Field, ThreeDSolution, sample_function, state_of
from kernels.arrays import FloatArray

GLUCOSE: Final = 6e-4
"""Diffusivity of glucose in water near 25 °C, mm²/s: without any, age at the wall is endless."""

_ORDER: Final = 2
"""Degree of the age."""


@dataclass(frozen=True)
class ResidenceTime:
    """Age of the fluid in steady flow.

    Attributes
    ----------
    age : (t, 10) float64, s
        At the nodes of degree 2 of every element, in the order of `lumen_mesh.nodes`.
    port_age : (p,) float64, s
        Flow-weighted mean of what leaves by each port; NaN where flow comes in.
    mean_s : float, s
        Of all that leaves: volume over flow.
    volume_ul : float, µL
    """

    age: FloatArray
    port_age: FloatArray
    mean_s: float
    volume_ul: float


def residence_time(solution: ThreeDSolution, diffusivity_mm2_s: float = GLUCOSE) -> ResidenceTime:
    """Solve for the age of the fluid in a steady solution.

    Raises
    ------
    FlowError
        No flow, a diffusivity that isn't above 0, the extra not installed.
    """
    if not (np.isfinite(diffusivity_mm2_s) and diffusivity_mm2_s > 0.0):
        raise FlowError(
            f"diffusivity {diffusivity_mm2_s:g} mm²/s isn't above 0; glucose has {GLUCOSE:g}"
        )
    if not np.any(solution.port_flow):
        raise FlowError("nothing flows, so that fluid stays for ever; give a flow")
    field = solution.field
    with running_engine() as ng:
        inner = engine_mesh(ng, field.mesh)
        room = spaces(ng, inner, len(field.mesh.ports), field.order, None)
        velocity = state_of(room, solution.coefficients).components[0]
        age = _solve(ng, inner, velocity, diffusivity_mm2_s, len(field.mesh.ports))
        return _result(ng, room, solution, velocity, age)


def _solve(ng: Any, mesh: Any, velocity: Any, diffusivity: float, ports: int) -> Any:
    space = ng.H1(mesh, order=_ORDER)
    a, w = space.TnT()
    out = velocity * ng.specialcf.normal(3)
    names = "|".join(port_name(k) for k in range(ports))
    speed = ng.sqrt(velocity * velocity) + 1e-12
    size = ng.specialcf.mesh_size / _ORDER
    # Half an element's crossing where it is carried, less where diffusion does it faster.
    delay = 1.0 / ng.sqrt((2.0 * speed / size) ** 2 + (12.0 * diffusivity / size**2) ** 2)
    along = velocity * ng.grad(w)
    # NGSolve counts the degrees of what is tested, and not the velocity's.
    inside, ends = ng.dx(bonus_intorder=3), ng.ds(names, bonus_intorder=3)
    form = ng.BilinearForm(space)
    form += (diffusivity * ng.grad(a) - a * velocity) * ng.grad(w) * inside
    form += ng.IfPos(out, out, 0.0) * a * w * ends
    form += delay * (velocity * ng.grad(a)) * along * inside
    form.Assemble()
    load = ng.LinearForm(space)
    load += (w + delay * along) * inside
    load.Assemble()
    age = ng.GridFunction(space)
    age.vec.data = form.mat.Inverse(space.FreeDofs(), inverse="umfpack") * load.vec
    return age


def _result(
    ng: Any, room: Spaces, solution: ThreeDSolution, velocity: Any, age: Any
) -> ResidenceTime:
    flow = solution.port_flow
    carried = np.zeros(len(flow))
    out = velocity * ng.specialcf.normal(3)
    for k in range(len(flow)):
        region = room.mesh.Boundaries(port_name(k))
        leaving = ng.IfPos(out, out, 0.0) * age
        carried[k] = ng.Integrate(leaving, room.mesh, definedon=region, order=4 + room.order)
    leaves = np.maximum(flow, 0.0)
    port_age = np.divide(carried, leaves, out=np.full(len(flow), np.nan), where=leaves > 0.0)
    return ResidenceTime(
        age=sample_function(room, solution.field.mesh, age, _ORDER)[..., 0],
        port_age=port_age,
        mean_s=float(carried.sum() / leaves.sum()),
        volume_ul=float(ng.Integrate(ng.CoefficientFunction(1.0), room.mesh, order=6)),
    )


class _Tracing(NamedTuple):
    """Limits of streamlines."""

    neighbours: int = 24  # elements tried for a place, by their centres
    outside: float = -0.1  # least barycentric coordinate inside: curved walls bulge
    still: float = 1e-6  # of the greatest speed: a line ends there
    lines: int = 200  # by default
    steps: int = 1500  # each way


_TRACING: Final = _Tracing()


def trace_streamlines(
    field: Field, seeds: FloatArray | None = None
) -> list[tuple[FloatArray, FloatArray]]:
    """Trace streamlines through places both ways, by midpoint steps of an element's size.

    Parameters
    ----------
    field : Field
    seeds : (n, 3) float64, mm, optional
        By default the centres of 200 elements, which are as many in thin vessels as in wide ones.

    Returns
    -------
    list of ((k, 3) float64, (k,) float64)
        Points along a line, mm, in the flow's direction, and the speed there, mm/s.
    """
    search = _Elements(field)
    if seeds is None:
        seeds = search.centre[:: max(1, len(search.centre) // _TRACING.lines)]
    back, ahead = (_half_lines(search, seeds, sign) for sign in (-1.0, 1.0))
    lines = [np.concatenate([back[:0:-1, k], ahead[:, k]]) for k in range(len(seeds))]
    lines = [line[np.isfinite(line[:, 3])] for line in lines]
    return [(line[:, :3], line[:, 3]) for line in lines if len(line) > 1]


def _half_lines(search: _Elements, seeds: FloatArray, sign: float) -> FloatArray:
    """Return points and speed, (steps, n, 4), NaN beyond a line's end."""
    count, place = len(seeds), seeds.copy()
    going, steps = np.arange(count), list[FloatArray]()
    for _ in range(_TRACING.steps):
        velocity, size, inside = search.velocity(place[going])
        speed = np.linalg.norm(velocity, axis=1)
        kept = inside & (speed > _TRACING.still * search.fastest)
        going = going[kept]
        if not len(going):
            break
        here = np.full((count, 4), np.nan)
        here[going] = np.column_stack([place[going], speed[kept]])
        steps.append(here)
        step = (sign * size / np.where(speed > 0.0, speed, 1.0))[kept, None]
        middle = search.velocity(place[going] + 0.5 * step * velocity[kept])[0]
        length = np.linalg.norm(middle, axis=1, keepdims=True)
        place[going] += sign * size[kept, None] * middle / np.maximum(length, 1e-300)
    return np.array(steps).reshape(-1, count, 4)


class _Elements:
    """Elements by place; edges count as straight."""

    def __init__(self, field: Field) -> None:
        self._field = field
        corner = field.mesh.points[field.mesh.tets[:, :4]]
        edges = corner[:, 1:] - corner[:, :1]
        self._first, self._inverse = corner[:, 0], np.linalg.inv(edges)
        self._size = np.cbrt(np.abs(np.linalg.det(edges)) / 6.0)
        self.centre = corner.mean(axis=1)
        self._tree = cKDTree(self.centre)
        self.fastest = float(np.linalg.norm(field.velocity, axis=2).max())

    def velocity(self, points: FloatArray) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
        """Return velocity (n, 3) at points, size of their elements (n,), and if they lie in one."""
        near = self._tree.query(points, k=min(_TRACING.neighbours, len(self._size)))[1]
        near = near.reshape(len(points), -1)
        at = np.einsum("nkx,nkxa->nka", points[:, None] - self._first[near], self._inverse[near])
        at = np.concatenate([1.0 - at.sum(axis=2, keepdims=True), at], axis=2)
        row, best = np.arange(len(points)), at.min(axis=2).argmax(axis=1)
        tet, at = near[row, best], at[row, best]
        inside = at.min(axis=1) > _TRACING.outside
        at = np.clip(at, 0.0, None) / np.clip(at, 0.0, None).sum(axis=1, keepdims=True)
        value = shapes(self._field.order, at)[0]
        velocity = np.einsum("nq,nqx->nx", value, self._field.velocity[tet])
        return velocity, self._size[tet], inside
