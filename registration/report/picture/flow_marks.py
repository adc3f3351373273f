"""Draw flow direction arrows, inlets and outlets over a network's picture."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from matplotlib.patheffects import withStroke

from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray
from registration.report.picture.camera import Camera

MOST_PORTS: Final = 40
"""Inlets, or outlets, that are marked; a tree's hundreds of terminals aren't."""
_NAMED: Final = 6
"""So many of a kind have their name beside them."""
_MOST_ARROWS: Final = 60
_APART: Final = 0.07
"""Least distance of two arrows, of the picture's width."""
_LONG: Final = 0.035
"""Length of a port's arrow, of the picture's width."""
_ROOM: Final = 0.09
"""Room for arrow and name beyond a port, of the network's size."""
_LEAST, _GREATEST = 0.0045, 0.012
"""Half an arrow's length on a vessel, of the picture's width."""
_FACING: Final = 0.35
"""Of its length that a piece must show from the side to have an arrow."""
_INK: Final = "#1c2126"


def draw_flow_marks(
    axes: Axes,
    network: VesselNetwork,
    flow: FloatArray | None,
    camera: Camera,
    depth: FloatArray,
) -> None:
    """Mark inlets and outlets by arrows into and out of the part, the flow by arrowheads.

    Parameters
    ----------
    axes : Axes
        In pixels of the camera, y downwards.
    network : VesselNetwork
    flow : (v,) float64 or None
        Of each vessel, below 0 where it runs against the vessel; None (and NaN): as designed.
    camera : Camera
    depth : (height, width) float64
        Of the vessels' fronts towards the eye, pixels; hidden vessels have no arrows.
    """
    turned = np.ones(network.vessel_count)
    if flow is not None:
        turned = np.where(flow < 0.0, -1.0, 1.0)
    _draw_arrows(axes, network, turned, camera, depth)
    for name, nodes, way in (("inlet", network.inlets(), -1.0), ("outlet", network.outlets(), 1.0)):
        if len(nodes) <= MOST_PORTS:
            _draw_ports(axes, network, nodes, name if len(nodes) <= _NAMED else "", way, camera)


def port_reach(network: VesselNetwork) -> FloatArray:
    """Places (k, 3), mm, that the picture must hold for the ports' arrows and names."""
    reach = _ROOM * float(np.ptp(network.points, axis=0).max())
    places = [np.empty((0, 3))]
    for nodes in (network.inlets(), network.outlets()):
        for node in nodes.tolist() if len(nodes) <= MOST_PORTS else []:
            points, _ = _last_piece(network, node)
            way = points[0] - points[1]
            places.append((points[0] + reach * way / np.linalg.norm(way))[None])
    return np.concatenate(places)


def _draw_ports(
    axes: Axes, network: VesselNetwork, nodes: IntArray, name: str, way: float, camera: Camera
) -> None:
    """An arrow at each port: towards it for ``way`` -1, away from it for 1."""
    long = _LONG * camera.width
    for node in nodes.tolist():
        port, outward, radius = _port(network, node, camera)
        begin = port + outward * (1.15 * radius + 0.15 * long)
        end = begin + outward * long
        tail, tip = (end, begin) if way < 0.0 else (begin, end)
        axes.annotate(
            "", (float(tip[0]), float(tip[1])), (float(tail[0]), float(tail[1])),
            arrowprops={"arrowstyle": "-|>,head_width=0.22,head_length=0.42", "color": _INK,
                        "linewidth": 1.3, "shrinkA": 0.0, "shrinkB": 0.0},
        )  # fmt: skip
        if name:
            across = "left" if outward[0] > 0.4 else "right" if outward[0] < -0.4 else "center"
            up = "center" if abs(outward[1]) < 0.4 else "top" if outward[1] > 0.0 else "bottom"
            x, y = (end + 0.3 * long * outward).tolist()
            drawn = axes.text(x, y, name, ha=across, va=up, color=_INK, fontsize=8.0)
            drawn.set_path_effects([withStroke(linewidth=2.0, foreground="white")])


def _port(
    network: VesselNetwork, node: int, camera: Camera
) -> tuple[FloatArray, FloatArray, float]:
    """Place of a port, the way out of the part (one pixel long), and its radius, pixels."""
    points, radius = _last_piece(network, node)
    seen = camera.project(points)[:, :2]
    way = seen[0] - seen[1]
    length = float(np.linalg.norm(way))
    # A vessel that points at the eye leaves upwards.
    unit = way / length if length > 1e-6 else np.array([0.0, -1.0])
    return seen[0], unit, radius * camera.pixels_per_mm


def _last_piece(network: VesselNetwork, node: int) -> tuple[FloatArray, float]:
    """The port and the point before it, (2, 3), and the radius there, mm."""
    vessel, end = np.argwhere(network.vessel_nodes == node)[0].tolist()
    points, radius = network.polyline(vessel)
    at, inner = (0, 1) if end == 0 else (-1, -2)
    return points[[at, inner]], float(radius[at])


def _draw_arrows(
    axes: Axes, network: VesselNetwork, turned: FloatArray, camera: Camera, depth: FloatArray
) -> None:
    """Arrowheads in the middle of vessels, the widest first, where there is room for one."""
    taken = np.empty((0, 2))
    for vessel in np.argsort(-network.mean_radius(), kind="stable").tolist():
        middle = _middle(network, vessel, camera, depth)
        if middle is None:
            continue
        place, way, radius = middle
        if len(taken) and np.linalg.norm(taken - place, axis=1).min() < _APART * camera.width:
            continue
        half = float(np.clip(1.1 * radius, _LEAST * camera.width, _GREATEST * camera.width))
        ahead, aside = half * turned[vessel] * way, half * 0.62 * np.array([-way[1], way[0]])
        corners = [place + ahead, place - 0.7 * ahead + aside, place - 0.7 * ahead - aside]
        axes.add_patch(
            Polygon(corners, facecolor="white", edgecolor=_INK, linewidth=0.5, joinstyle="round")
        )
        taken = np.concatenate([taken, place[None]])
        if len(taken) == _MOST_ARROWS:
            return


def _middle(
    network: VesselNetwork, vessel: int, camera: Camera, depth: FloatArray
) -> tuple[FloatArray, FloatArray, float] | None:
    """Middle, way and radius of a vessel in pixels; None where it isn't seen from the side."""
    points, radius = network.polyline(vessel)
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    along = np.cumsum(step)
    piece = int(np.searchsorted(along, 0.5 * along[-1]))
    share = 1.0 - (along[piece] - 0.5 * along[-1]) / step[piece]
    seen = camera.project(points[piece : piece + 2])
    way = seen[1, :2] - seen[0, :2]
    length = float(np.linalg.norm(way))
    place = seen[0] + share * (seen[1] - seen[0])
    wide = float(radius[piece]) * camera.pixels_per_mm
    if length < _FACING * float(np.linalg.norm(seen[1] - seen[0])):
        return None
    x, y = round(float(place[0])), round(float(place[1]))
    inside = 0 <= y < depth.shape[0] and 0 <= x < depth.shape[1]
    if not inside or depth[y, x] > place[2] + 1.5 * wide + 2.0:
        return None
    return place[:2], way / length, wide
