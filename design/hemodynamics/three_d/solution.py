"""Data classes of 3D flow solutions, steady or over a cycle: fields, wall shear, power."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.hemodynamics.three_d.meshing.lumen_mesh import LumenMesh
from kernels.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Field:
    """Velocity and pressure at one time, element by element.

    Attributes
    ----------
    mesh : LumenMesh
    velocity : (t, n, 3) float64, mm/s
        At the nodes of degree k of every element, in the order of `lagrange.nodes`.
    pressure : (t, n', 1) float64, Pa
        At those of degree k - 1.
    order : int
        k.
    """

    mesh: LumenMesh
    velocity: FloatArray
    pressure: FloatArray
    order: int


@dataclass(frozen=True)
class WallShear:
    """Viscous force of the fluid on the wall, by area.

    Attributes
    ----------
    node : (w,) int64
        Of the mesh, on the wall.
    traction : (w, 3) float64, Pa
        Along the wall, the mean of what the faces that meet at the node say.
    """

    node: IntArray
    traction: FloatArray

    @property
    def magnitude(self) -> FloatArray:
        """(w,), Pa."""
        return np.asarray(np.linalg.norm(self.traction, axis=1), dtype=np.float64)


@dataclass(frozen=True)
class Energy:
    """Where power comes from and goes to; a Pa·µL/s is a nW.

    Attributes
    ----------
    ends_nw : float, nW
        Pressure, kinetic energy and viscous traction of what flows in, less those of what leaves.
    viscous_nw : float, nW
        μ ∫ ∇u:∇u.
    """

    ends_nw: float
    viscous_nw: float

    @property
    def imbalance(self) -> float:
        """Their difference over the larger."""
        largest = max(abs(self.ends_nw), abs(self.viscous_nw))
        return abs(self.ends_nw - self.viscous_nw) / largest if largest else 0.0


@dataclass(frozen=True)
class ThreeDSolution:
    """Steady flow in a lumen.

    Attributes
    ----------
    field : Field
    wall_shear : WallShear
    port_flow : (p,) float64, µL/s
        Out of the lumen by each port of the mesh.
    port_pressure : (p,) float64, Pa
        Mean over the port.
    reynolds : (p,) float64
        By mean speed and the diameter of the port's circle of the same area.
    energy : Energy
    unknowns : int
        Of velocity and pressure, given ones included.
    residual : (k,) float64
        After each of Newton's steps, of that of no flow.
    krylov : int
        Linear steps taken.
    coefficients : (unknowns,) float64
        The engine's own, from which it goes on (residence time).
    """

    field: Field
    wall_shear: WallShear
    port_flow: FloatArray
    port_pressure: FloatArray
    reynolds: FloatArray
    energy: Energy
    unknowns: int
    residual: FloatArray
    krylov: int
    coefficients: FloatArray

    @property
    def mass_imbalance(self) -> float:
        """What leaves less what comes in, of what comes in."""
        into = -float(self.port_flow[self.port_flow < 0.0].sum())
        return abs(float(self.port_flow.sum())) / into if into else 0.0


@dataclass(frozen=True)
class ThreeDWaves:
    """A cycle of pulsatile flow in its periodic state.

    Attributes
    ----------
    time_s : (t,) float64, s
        From 0, the cycle's end left out.
    port_flow : (p, t) float64, µL/s
        Out of the lumen.
    port_pressure : (p, t) float64, Pa
    section_flow, section_pressure : (s, t) float64
        At the sections that were asked for.
    kept : (f,) int64
        Which times fields are kept of.
    fields : tuple of Field
    change : (c,) float64
        From each cycle's begin to its end, relative; empty where the state was solved for.
    """

    time_s: FloatArray
    port_flow: FloatArray
    port_pressure: FloatArray
    section_flow: FloatArray
    section_pressure: FloatArray
    kept: IntArray
    fields: tuple[Field, ...]
    change: FloatArray
