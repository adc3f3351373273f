"""Compiled kernels of the 1D flow solver: rates in cells, states at vessel ends, time steps.

Goes in: cells and nodes as arrays. Comes out: their state some time steps later, in place.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from design.hemodynamics.one_d.grid import KIND, Grid, Nodes
from kernels import jit
from kernels.arrays import FloatArray


class NodeLimits(NamedTuple):
    """Newton's method at nodes."""

    rows: int = 14
    """Of ``work.ends``: see `solve_ends`."""
    iterations: int = 50
    close: float = 1e-9
    """Pressure left over, of the wall's stiffness; the step taken after it leaves rounding."""


LIMITS: Final = NodeLimits()


class State(NamedTuple):
    """Cross-sections and flows of all cells, and the outlets' state, at one time.

    Attributes
    ----------
    area, flow : (n,) float64, mm², µL/s
        Of cells.
    stored : (m,) float64, Pa
        Behind each outlet's first resistance.
    passed : (m,) float64, µL
        What has left the network at each node.
    """

    area: FloatArray
    flow: FloatArray
    stored: FloatArray
    passed: FloatArray


class MarchScratch(NamedTuple):
    """Scratch: one set a network, so that a step allocates nothing."""

    pressure: FloatArray
    area_rate: FloatArray
    flow_rate: FloatArray
    area: FloatArray
    flow: FloatArray
    stored: FloatArray
    ends: FloatArray
    mean_flow: FloatArray
    late_flow: FloatArray
    smoothed: FloatArray
    lines: FloatArray


def make_work(grid: Grid, nodes: Nodes) -> MarchScratch:
    """Return scratch for a network."""
    cells, ends = len(grid.area), 2 * len(grid.cell)
    pressure, area_rate, flow_rate, area, flow = np.zeros((5, cells))
    mean_flow, late_flow, smoothed = np.zeros((3, ends))
    return MarchScratch(
        pressure=pressure,
        area_rate=area_rate,
        flow_rate=flow_rate,
        area=area,
        flow=flow,
        stored=np.zeros(len(nodes.kind)),
        ends=np.zeros((LIMITS.rows, ends)),
        mean_flow=mean_flow,
        late_flow=late_flow,
        smoothed=smoothed,
        lines=np.zeros((2, cells)),
    )


@jit
def _to_faces(before: float, after: float, small: float) -> tuple[float, float]:
    """Change from a cell's value to its near face (taken off) and to its far face (added).

    ``before`` and ``after`` are the steps between cells; van Albada's limiter leaves them where
    they are alike or small, and is 0 at a kink.

    A_t + Q_x = 0 and Q_t + (α Q²/A)_x + (A/ϱ) p_x = -f Q/A. Pressure and flow, not area, are
    carried to a cell's faces (κ = 1/3 with van Albada's limiter), where A₀ and K have one value; so
    a network at rest, p the same and Q = 0, has equal states on both sides of every face, however
    its radius changes. The pressure's term isn't in conservation form: in each cell it is A Δp/ϱ.
    Between cells stands the flux α Q²/A + Φ(A), with Φ = ∫ c² dA = K A₀/(3ϱ) (A/A₀)^{3/2} at the
    face's A₀ and K, of Harten, Lax & van Leer (1983, doi 10.1137/1025002); what each cell adds of Φ
    at its two faces is taken off again, and at rest nothing is left.

    Each vessel is one loop: a cell-step is some tens of nanoseconds, and a second pass over the
    cells would cost as much in memory traffic.
    """
    product = 2.0 * before * after + small
    share = product / (before * before + after * after + small) if product > 0.0 else 0.0
    t = share * (1.0 / 3.0)
    return (
        0.25 * share * ((1.0 - t) * after + (1.0 + t) * before),
        0.25 * share * ((1.0 - t) * before + (1.0 + t) * after),
    )


@jit
def _push_at_node(flow: float, area: float, base: float, alpha: float, weight: float) -> float:
    """Momentum flux over density through a vessel's end; ``base`` is the area without pressure."""
    return alpha * flow * flow / area + weight * (area / base) * np.sqrt(area / base)


@jit
def _flux(
    y0: float,
    q0: float,
    phi0: float,
    y1: float,
    q1: float,
    phi1: float,
    base: float,
    square: float,
    alpha: float,
) -> tuple[float, float]:
    """Mass and momentum flux between two states at a face, of Harten, Lax & van Leer.

    A state is y = √(A/A₀), Q and Φ; ``base`` is A₀, ``square`` c² of both, without the flow.
    """
    area0, area1 = base * y0 * y0, base * y1 * y1
    u0, u1 = q0 / area0, q1 / area1
    u = 0.5 * (u0 + u1)
    speed = np.sqrt(square + alpha * (alpha - 1.0) * u * u)
    slow, fast, span = alpha * u - speed, alpha * u + speed, 0.5 / speed
    mass = (fast * q0 - slow * q1 + slow * fast * (area1 - area0)) * span
    push0, push1 = alpha * q0 * u0 + phi0, alpha * q1 * u1 + phi1
    return mass, (fast * push0 - slow * push1 + slow * fast * (q1 - q0)) * span


@jit
def cell_rates(grid: Grid, state: State, work: MarchScratch) -> None:
    """Write rates of change of every cell's area and flow.

    After `settle_ends`, whose ends are the faces at nodes; the pressure outside is the same all
    along a vessel and drives nothing.
    """
    area, flow, pressure = state.area, state.flow, work.pressure
    node_area, node_flow = work.ends[0], work.ends[1]
    area_rate, flow_rate = work.area_rate, work.flow_rate
    per_density = 1.0 / grid.density
    third_density, quarter_density = 1.0 / 3.0 * per_density, 0.25 * per_density
    for vessel in range(len(grid.cell)):
        first, last = grid.offset[vessel], grid.offset[vessel + 1] - 1
        alpha, per_cell = grid.alpha[vessel], 1.0 / grid.cell[vessel]
        small_p, small_q = grid.small_pressure[vessel] + 1e-300, grid.small_flow[vessel] + 1e-300
        # The face before the first cell is the node's.
        mass_in, face = -node_flow[2 * vessel], first + vessel
        base, stiff = grid.face_area[face], grid.face_stiffness[face]
        weight = stiff * base * third_density
        push_in = _push_at_node(mass_in, node_area[2 * vessel], base, alpha, weight)
        b_p, b_q = pressure[first + 1] - pressure[first], flow[first + 1] - flow[first]
        left_p = pressure[first] - 0.5 * b_p
        y = 1.0 + left_p / stiff
        phi_in = weight * y * y * y
        near_p, near_q = pressure[first] + 0.5 * b_p, flow[first] + 0.5 * b_q
        for i in range(first, last + 1):
            # Here near_… is cell i's own value at its far face, left_… at its near one.
            face = i + vessel + 1
            base, stiff = grid.face_area[face], grid.face_stiffness[face]
            inverse = 1.0 / stiff
            weight = stiff * base * third_density
            y0 = 1.0 + near_p * inverse
            own = weight * y0 * y0 * y0
            far_own, far_left_p, far_p, far_q = 0.0, 0.0, 0.0, 0.0
            if i < last:
                a_p, a_q = b_p, b_q
                here_p, here_q = pressure[i + 1], flow[i + 1]
                if i + 1 < last:
                    b_p, b_q = pressure[i + 2] - here_p, flow[i + 2] - here_q
                less_p, more_p = _to_faces(a_p, b_p, small_p)
                less_q, more_q = _to_faces(a_q, b_q, small_q)
                far_left_p, far_p, far_q = here_p - less_p, here_p + more_p, here_q + more_q
                y1 = 1.0 + far_left_p * inverse
                far_own = weight * y1 * y1 * y1
                square = stiff * (y0 + y1) * quarter_density
                mass, push = _flux(
                    y0, near_q, own, y1, here_q - less_q, far_own, base, square, alpha
                )
            else:
                mass = node_flow[2 * vessel + 1]
                push = _push_at_node(mass, node_area[2 * vessel + 1], base, alpha, weight)
            area_rate[i] = (mass_in - mass) * per_cell
            driven = (push_in - push) + (own - phi_in) - area[i] * per_density * (near_p - left_p)
            flow_rate[i] = driven * per_cell - grid.friction[i] * flow[i] / area[i]
            mass_in, push_in, phi_in = mass, push, far_own
            left_p, near_p, near_q = far_left_p, far_p, far_q


@jit
def smooth_viscously(grid: Grid, state: State, work: MarchScratch, step: float) -> None:
    """Let a Kelvin-Voigt wall's pressure, -γ Q_x, act for a step: implicit Euler on Q.

    γ is the drag over √A. Q_t = (A/ϱ) (γ Q_x)_x in each vessel by Thomas' elimination, the flow at
    its ends that of the nodes at the step's end (``late_flow``); stable for any step. What it did
    to the last cells' outward flow goes into ``smoothed``.
    """
    area, flow, node_flow = state.area, state.flow, work.late_flow
    smoothed, lines = work.smoothed, work.lines
    for vessel in range(len(grid.cell)):
        first, last = grid.offset[vessel], grid.offset[vessel + 1] - 1
        before_first, before_last = flow[first], flow[last]
        scale = step / (grid.density * grid.cell[vessel] ** 2)
        face = first + vessel
        left = 2.0 * grid.face_drag[face] / np.sqrt(area[first])
        before, upper = 0.0, 0.0
        for i in range(first, last + 1):
            face = i + vessel + 1
            beside = area[i] if i == last else 0.5 * (area[i] + area[i + 1])
            right = grid.face_drag[face] / np.sqrt(beside)
            right *= 2.0 if i == last else 1.0
            weight = scale * area[i]
            value = flow[i]
            if i == first:
                value -= weight * left * node_flow[2 * vessel]
            if i == last:
                value += weight * right * node_flow[2 * vessel + 1]
            lower = 0.0 if i == first else weight * left
            pivot = 1.0 + weight * (left + right) - lower * upper
            upper = 0.0 if i == last else weight * right / pivot
            before = (value + lower * before) / pivot
            lines[0, i], lines[1, i] = upper, before
            left = right
        flow[last] = lines[1, last]
        for i in range(last - 1, first - 1, -1):
            flow[i] = lines[1, i] + lines[0, i] * flow[i + 1]
        smoothed[2 * vessel] = before_first - flow[first]
        smoothed[2 * vessel + 1] = flow[last] - before_last


@jit
def gather_ends(grid: Grid, state: State, work: MarchScratch, share: float) -> int:
    """Write cells' elastic pressures; carry pressure and flow to vessels' ends in straight lines.

    ``share`` is the part of a step that has gone by without the wall's viscosity, which acts at its
    end: the difference to the node's flow would be wrong by what it does in a step.

    A vessel's end brings its outgoing invariant W = u + 4c (u towards the node); what its area and
    flow become there has the same. In terms of c everything is a polynomial: p = 2ϱc² - K, u = W -
    4c, A = A₀ (2ϱc²/K)². The invariant is that of α = 1 (Formaggia et al. 2003); it is used only
    over the small step from the cell's value at the end to the node's, so that the scheme stays of
    second order for other profiles.

    All ends of a node share P: at a junction the total pressure p + ½ϱu², at an inlet or outlet the
    pressure; p has the pressure outside the vessel in it. Newton's method on (c of each end, P) has
    an arrow for its matrix: with Y = -dQ/dH, each end's admittance, P = (Σ(Q + Y H) - g₀)/(ΣY +
    g₁), where g₀ + g₁ P is what leaves the node outwards, and then c += (P - H)/H'. No number of
    vessels is special, and loops need nothing.

    In a viscous wall the end's pressure has -γ Q_x besides, over half a cell: a resistance in
    series.

    Helpers take numbers, not the grid: a tuple of arrays handed to a call counts references, which
    took ten times as long as the sums.

    Returns
    -------
    int
        -1, or the first vessel that collapses or is outrun.
    """
    area, flow, pressure = state.area, state.flow, work.pressure
    smoothed, ends = work.smoothed, work.ends
    for i in range(len(area)):
        pressure[i] = grid.stiffness[i] * (np.sqrt(area[i]) * grid.root[i] - 1.0)
    density, per_density = grid.density, 1.0 / grid.density
    for vessel in range(len(grid.cell)):
        for side in range(2):
            if side == 0:
                i, back, sign, face = grid.offset[vessel], 1, -1.0, grid.offset[vessel] + vessel
            else:
                i, back, sign = grid.offset[vessel + 1] - 1, -1, 1.0
                face = grid.offset[vessel + 1] + vessel
            end = 2 * vessel + side
            stiff, base = grid.face_stiffness[face], grid.face_area[face]
            p = 1.5 * pressure[i] - 0.5 * pressure[i + back]
            q = sign * (1.5 * flow[i] - 0.5 * flow[i + back])
            y = 1.0 + p / stiff
            if not y > 0.0:
                return vessel
            c = np.sqrt(0.5 * stiff * y * per_density)
            u = q / (base * y * y)
            if not abs(u) < c:
                return vessel
            ends[3, end], ends[4, end] = c, u + 4.0 * c
            ends[5, end], ends[6, end] = stiff, base * 4.0 * density * density / (stiff * stiff)
            ends[7, end], ends[8, end] = 0.0, 0.0
            ends[13, end] = stiff - grid.external[vessel]
            if grid.viscous:
                g = grid.face_drag[face] / np.sqrt(area[i])
                ends[7, end], ends[8, end] = 2.0 * g / grid.cell[vessel], sign * flow[i]
                ends[8, end] += share * smoothed[end]
    return -1


@jit
def solve_ends(
    grid: Grid, nodes: Nodes, state: State, drive: FloatArray, work: MarchScratch
) -> int:
    """Find area, flow and pressure at every vessel's ends, for waves ``drive`` (w,) at this time.

    Rows of ``work.ends`` (14, 2 v): 0 to 2, written, area, outward flow and pressure at each end;
    3 to 8, of `gather_ends`, c (changed), W, K, A/c⁴, resistance in series and the outward flow
    before it; 13, K less the pressure outside; 9 to 12, scratch, Q, H, H', Y.

    Returns
    -------
    int
        -1, or the first vessel that collapses or is outrun.
    """
    density, ends, stored = grid.density, work.ends, state.stored
    for node in range(len(nodes.kind)):
        kind, wave = nodes.kind[node], nodes.wave[node]
        given = drive[wave] if wave >= 0 else 0.0
        start, stop = nodes.start[node], nodes.start[node + 1]
        if kind == KIND.reflection:
            end = nodes.end[start]
            if not _reflect(given, nodes.reflection[node], density, end, ends):
                return end // 2
            continue
        kinetic = 1.0 if kind == KIND.junction else 0.0
        outward, conductance = 0.0, 0.0
        if kind == KIND.junction:
            outward = -given
        elif kind != KIND.pressure:
            conductance = 1.0 / nodes.proximal[node]
            outward = -stored[node] * conductance
        shared, total, over = given, 0.0, 0.0
        for _ in range(LIMITS.iterations):
            worst, total, weighted, over = 0.0, 0.0, 0.0, -outward
            for k in range(start, stop):
                end = nodes.end[k]
                q, head, slope, y = _at(ends[3, end], ends[4, end], ends[13, end], ends[6, end],
                                        ends[7, end], ends[8, end], kinetic, density)  # fmt: skip
                ends[9, end], ends[10, end], ends[11, end], ends[12, end] = q, head, slope, y
                total += y
                over += q
                weighted += y * head
            if kind != KIND.pressure:
                shared = (over + weighted) / (total + conductance)
            for k in range(start, stop):
                end = nodes.end[k]
                rest = shared - ends[10, end]
                worst = max(worst, abs(rest) / ends[5, end])
                ends[3, end] += rest / ends[11, end]
                if not ends[3, end] > 0.0:
                    return end // 2
            if worst < LIMITS.close:
                break
        bad = _settle(nodes, node, shared, outward + conductance * shared, density, kinetic, ends)
        if bad >= 0:
            return bad
    return -1


@jit
def _at(
    c: float,
    w: float,
    stiff: float,
    scale: float,
    series: float,
    inner: float,
    kinetic: float,
    density: float,
) -> tuple[float, float, float, float]:
    """Flow, pressure, its slope over c, and admittance of an end for its c.

    ``stiff`` is K less the pressure outside.
    """
    u = w - 4.0 * c
    square = c * c
    area = scale * square * square
    q = area * u
    head = 2.0 * density * square - stiff + 0.5 * density * kinetic * u * u
    slope = 4.0 * density * (c - kinetic * u)
    fall = 4.0 * area * (u - c) / c
    head -= series * (q - inner)
    slope -= series * fall
    return q, head, slope, -fall / slope


@jit
def _settle(
    nodes: Nodes,
    node: int,
    shared: float,
    leaving: float,
    density: float,
    kinetic: float,
    ends: FloatArray,
) -> int:
    """Write the node's ends; what Newton's method leaves of the flows' sum is shared out."""
    over, total = -leaving, 0.0
    for k in range(nodes.start[node], nodes.start[node + 1]):
        end = nodes.end[k]
        c = ends[3, end]
        u = ends[4, end] - 4.0 * c
        if not abs(u) < c:
            return end // 2
        area = ends[6, end] * c * c * c * c
        ends[0, end], ends[1, end] = area, area * u
        ends[2, end] = shared - 0.5 * density * kinetic * u * u
        over += area * u
        total += ends[12, end]
    if nodes.kind[node] != KIND.pressure:
        for k in range(nodes.start[node], nodes.start[node + 1]):
            end = nodes.end[k]
            ends[1, end] -= over * ends[12, end] / total
    return -1


@jit
def _reflect(given: float, part: float, density: float, end: int, ends: FloatArray) -> bool:
    """Send part of what the arriving wave is over the undisturbed state back."""
    stiff, arriving = ends[5, end], ends[4, end]
    y = (ends[13, end] + given) / stiff
    if not y > 0.0:
        return False
    rest = 4.0 * np.sqrt(0.5 * stiff * y / density)
    back = -rest - part * (arriving - rest)
    c, u = (arriving - back) / 8.0, (arriving + back) / 2.0
    if not (c > 0.0 and abs(u) < c):
        return False
    ends[0, end] = ends[6, end] * c * c * c * c
    ends[1, end] = ends[0, end] * u
    ends[2, end] = 2.0 * density * c * c - ends[13, end]
    return True
