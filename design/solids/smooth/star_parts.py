"""Refine a junction's triangulation by ray directions where triangles leave its wall (compiled)."""

from __future__ import annotations

from design.solids.smooth.fillet import rounded_distance
from design.solids.smooth.star_net import CAP, SEAM, Junction, Net, gap, unit
from design.solids.smooth.star_rays import at_ring, owner
from kernels import jit


@jit
def refine_directions(junction: Junction, net: Net, count: int, used: int) -> tuple[int, bool]:
    """Add directions where triangles leave the surface; return how many there are, and if full."""
    for t in range(used):
        a, b, c = net.tri[t, 0], net.tri[t, 1], net.tri[t, 2]
        if net.owner[a] == CAP or net.owner[b] == CAP or net.owner[c] == CAP:
            continue
        if count + 4 >= len(net.d):
            return count, True
        if max(gap(net, a, b), gap(net, b, c), gap(net, c, a)) < junction.least:
            continue
        if _is_settled(net, t):
            continue
        before = count
        if junction.rho <= 0.0:
            for k in range(3):
                count = _parted_edge(junction, net, net.tri[t, k], net.tri[t, (k + 1) % 3], count)
        if count == before:
            count = _parted_middle(junction, net, t, count)
        if count == before:
            _settle(net, t)
    return count, False


@jit
def _owners(net: Net, t: int) -> int:
    """Owners of a triangle's corners as one number."""
    a, b, c = net.tri[t, 0], net.tri[t, 1], net.tri[t, 2]
    return int((net.owner[a] << 32) ^ (net.owner[b] << 16) ^ net.owner[c])


@jit
def _is_settled(net: Net, t: int) -> bool:
    """Whether a triangle is as it was when it needed no direction: it needs none now."""
    for k in range(3):
        if net.settled[t, k] != net.tri[t, k]:
            return False
    return net.settled[t, 3] == _owners(net, t)


@jit
def _settle(net: Net, t: int) -> None:
    """Note that a triangle needs no direction; owners that were changed meanwhile may ask anew."""
    for k in range(3):
        net.settled[t, k] = net.tri[t, k]
    net.settled[t, 3] = _owners(net, t)


@jit
def _parted_middle(junction: Junction, net: Net, t: int, count: int) -> int:
    """Add a triangle's middle where it lies off the surface; return how many there are."""
    a, b, c = net.tri[t, 0], net.tri[t, 1], net.tri[t, 2]
    walls, d = junction.walls, net.d
    m = (net.away[a] * d[a] + net.away[b] * d[b] + net.away[c] * d[c]) / 3.0
    off = rounded_distance(
        walls, junction.rho, m[0] + walls[0, 0], m[1] + walls[0, 1], m[2] + walls[0, 2]
    )
    if abs(off) > junction.tolerance:
        unit(m)
        if not at_ring(walls, junction.reach, m, d, junction.ring_of):
            d[count] = m
            net.owner[count] = owner(walls, m[0], m[1], m[2])
            count += 1
    return count


@jit
def _parted_edge(junction: Junction, net: Net, p: int, q: int, count: int) -> int:
    """Add where an edge between two sharp walls crosses their seam; return how many there are."""
    whose = net.owner
    if p > q or whose[p] == SEAM or whose[q] == SEAM or whose[p] == whose[q]:
        return count
    if gap(net, p, q) < junction.least:
        return count
    low = _seam_on(junction, net, p, q)
    rings = len(junction.rings)
    if 0.02 < low < 0.98 and count < len(net.d):
        net.d[count] = (1.0 - low) * net.d[p] + low * net.d[q]
        unit(net.d[count])
        if not at_ring(junction.walls, junction.reach, net.d[count], net.d, junction.ring_of):
            whose[count] = SEAM
            count += 1
    elif low <= 0.02 and p >= rings:
        whose[p] = SEAM
    elif low >= 0.98 and q >= rings:
        whose[q] = SEAM
    return count


@jit
def _seam_on(junction: Junction, net: Net, p: int, q: int) -> float:
    """Share of the way from direction `p` to `q` at which another vessel's wall begins."""
    low, high = 0.0, 1.0
    for _ in range(40):
        half = 0.5 * (low + high)
        e = (1.0 - half) * net.d[p] + half * net.d[q]
        unit(e)
        if owner(junction.walls, e[0], e[1], e[2]) == net.owner[p]:
            low = half
        else:
            high = half
    return low
