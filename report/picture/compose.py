"""Publication pictures and film frames of a network, with colour and scale bar."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from textwrap import fill
from typing import Final

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize, to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Polygon
from matplotlib.patheffects import withStroke
from matplotlib.ticker import LogFormatter, MaxNLocator
from numpy.typing import NDArray
from PIL import Image

from design.geometry.surface import Surface
from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray
from report.picture.camera import Camera, View, fitted_camera
from report.picture.colours import DIVERGING, NO_DATA, SEQUENTIAL
from report.picture.quantity import Quantity, bar_ends, bar_limits
from report.picture.render import shade

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


FINER: Final = 2
LEGEND_AT_MOST: Final = 12
_MUTED: Final = "#5f6972"
_BAR_SHARE = 0.15
_BAR_COLOURS = 72
_LEAST_HEIGHT, _GREATEST_HEIGHT = 0.42, 0.95
STYLE: Final = {
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "text.color": _INK,
    "axes.labelcolor": _INK,
    "axes.edgecolor": _MUTED,
    "xtick.color": _INK,
    "ytick.color": _INK,
    "ytick.major.width": 0.6,
    "ytick.minor.width": 0.4,
    "text.parse_math": True,
    "axes.formatter.use_mathtext": True,
}


@dataclass(frozen=True)
class PictureOptions:
    """Options of a picture.

    Attributes
    ----------
    view : str
        One of `report.picture.camera.DIRECTIONS`.
    width : int
        Pixels, colour bar included.
    palette : bool
        At most 256 colours, for a small file.
    """

    view: View = "oblique"
    width: int = 1600
    palette: bool = False


def draw_picture(
    network: VesselNetwork,
    quantity: Quantity,
    surface: Surface | None,
    options: PictureOptions,
    flow: FloatArray | None = None,
) -> bytes:
    """Draw the network in its tissue and return a PNG; same input, same bytes.

    Arrows mark inlets, outlets and the way of the flow.

    Parameters
    ----------
    network : VesselNetwork
    quantity : Quantity
        What the vessels are coloured by.
    surface : Surface or None
        The tissue's, shown as a translucent shell.
    options : PictureOptions
    flow : (v,) float64, optional
        Of each vessel, below 0 where it runs against the vessel; as designed where it isn't known.
    """
    camera = scene_camera(network, surface, options)
    image, depth = shade(network, quantity, surface, camera, FINER)

    def mark(figure: Figure) -> None:
        draw_flow_marks(_in_pixels(figure, camera, options.width), network, flow, camera, depth)

    drawn = annotated(image, quantity, camera, options.width, mark)
    if options.palette:
        drawn = _few_colours(drawn, quantity)
    stream = io.BytesIO()
    dpi = dots_per_inch(options.width)
    drawn.save(stream, format="png", optimize=True, dpi=(dpi, dpi))
    return stream.getvalue()


def dots_per_inch(width: int) -> float:
    """Letters keep their share of a picture, whatever its width in pixels."""
    return width / 8.0


def annotated(
    image: NDArray[np.uint8],
    quantity: Quantity,
    camera: Camera,
    width: int,
    mark: Callable[[Figure], None],
) -> Image.Image:
    """A shaded scene with its colour bar, scale bar and axes, ``width`` pixels wide.

    ``mark`` draws what else belongs to it.
    """
    height, dpi = len(image), dots_per_inch(width)
    with rc_context(STYLE):
        figure = Figure(figsize=(width / dpi, height / dpi), dpi=dpi, facecolor="white")
        figure.figimage(image, 0, 0, origin="upper")
        mark(figure)
        _explain(figure, quantity, image.shape[1] / width)
        _scale_bar(figure, camera.pixels_per_mm / FINER, width, height)
        _axes(figure, camera, width, height)
        return rendered(figure)


def rendered(figure: Figure) -> Image.Image:
    """The pixels of a figure."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")


def _few_colours(image: Image.Image, quantity: Quantity) -> Image.Image:
    """The picture in 256 colours, some of them kept for the colour bar."""
    colours = image.quantize(256 - _BAR_COLOURS, Image.Quantize.MEDIANCUT).getpalette() or []
    bar = DIVERGING if quantity.scale == "diverging" else SEQUENTIAL
    steps = bar(np.linspace(0.0, 1.0, _BAR_COLOURS), bytes=True)[:, :3]
    palette = Image.new("P", (1, 1))
    palette.putpalette([*colours[: 3 * (256 - _BAR_COLOURS)], *steps.ravel().tolist()])
    return image.quantize(palette=palette, dither=Image.Dither.NONE)


def scene_camera(
    network: VesselNetwork, surface: Surface | None, options: PictureOptions
) -> Camera:
    """A camera whose picture is as high as the scene needs."""
    shown = [_hull(network), port_reach(network)]
    points = np.vstack(shown if surface is None else [*shown, surface.vertices])
    width = round(options.width * (1.0 - _BAR_SHARE))
    margin = round(0.035 * width)
    trial = fitted_camera(points, options.view, 1000, 100_000, 0).project(points)
    across, up = np.ptp(trial[:, :2], axis=0)
    share = float(np.clip(up / max(across, 1e-9), _LEAST_HEIGHT, _GREATEST_HEIGHT))
    # Room at the bottom for the scale bar.
    height = round(share * (width - 2 * margin) + 3.2 * margin)
    return fitted_camera(points, options.view, FINER * width, FINER * height, FINER * margin)


def _hull(network: VesselNetwork) -> FloatArray:
    """Corners of boxes around all points' spheres, mm."""
    reach = network.radius[:, None]
    return np.vstack([network.points - reach, network.points + reach])


def _explain(figure: Figure, quantity: Quantity, left: float) -> None:
    """The colour bar, or the names of the colours."""
    if quantity.scale == "names":
        names = list(zip(quantity.labels, quantity.colours, strict=True))[:LEGEND_AT_MOST]
        patches = [Patch(facecolor=to_rgb(colour), label=name) for name, colour in names]
        if len(quantity.labels) > LEGEND_AT_MOST:
            more = len(quantity.labels) - LEGEND_AT_MOST
            patches.append(Patch(facecolor="none", label=f"and {more} more"))
        if np.isnan(quantity.values).any():
            patches.append(Patch(facecolor=to_rgb(NO_DATA), label="none"))
        figure.legend(handles=patches, title=quantity.title, loc="center left",
                      bbox_to_anchor=(left - 0.01, 0.55), frameon=False, alignment="left",
                      handlelength=1.0, handleheight=1.0, title_fontsize=8.5)  # fmt: skip
        return
    low, high = quantity.limits
    norm = LogNorm(low, high) if quantity.scale == "log" else Normalize(*bar_limits((low, high)))
    bar = figure.add_axes((left + 0.015, 0.22, 0.016, 0.62))
    colours = DIVERGING if quantity.scale == "diverging" else SEQUENTIAL
    beyond = bar_ends(quantity.limits, quantity.extremes)
    drawn = figure.colorbar(ScalarMappable(norm, colours), cax=bar, extend=beyond)
    drawn.outline.set_linewidth(0.5)
    if quantity.scale == "log":
        decades = np.log10(high / low)
        labelled = (1.0, 2.0, 5.0) if decades < 2.5 else (1.0,)
        drawn.ax.yaxis.set_minor_formatter(_PlainLog(labelled, decades))
        drawn.ax.yaxis.set_major_formatter(_PlainLog(labelled, decades))
    elif high == low:
        drawn.set_ticks([low])
    else:
        drawn.locator = MaxNLocator(6, steps=[1, 2, 2.5, 5, 10])
        drawn.update_ticks()
    least, greatest = quantity.extremes
    span = f"\n({least:.3g} to {greatest:.3g})" if beyond != "neither" else ""
    title = fill(quantity.title, 15) + span.replace("-", "\u2212")
    bar.set_title(title, loc="left", fontsize=8.5, pad=8 if beyond in ("neither", "min") else 16)


class _PlainLog(LogFormatter):
    """0.01, 0.2, 5: few digits, and powers only where the numbers are long."""

    def __init__(self, labelled: tuple[float, ...], decades: float) -> None:
        super().__init__()
        self.labelled, self.decades = labelled, decades

    def __call__(self, value: float, position: int | None = None) -> str:
        power = np.floor(np.log10(value) + 1e-9)
        digit = round(value / 10.0**power, 6)
        if digit not in self.labelled:
            return ""
        if -4 <= power <= 4:
            return f"{value:.6g}"
        factor = "" if digit == 1.0 else rf"{digit:g}\cdot"
        return rf"${factor}10^{{{int(power)}}}$"


def _scale_bar(figure: Figure, pixels_per_mm: float, width: int, height: int) -> None:
    """A bar of a round length; the projection is orthographic, so it holds everywhere."""
    length = round_down(0.16 * width / pixels_per_mm)
    share = length * pixels_per_mm / width
    axes = _over(figure)
    left, bottom = 0.03, 0.024 * width / height
    axes.plot([left, left + share], [bottom, bottom], color=_INK, linewidth=1.8,
              solid_capstyle="butt")  # fmt: skip
    text = f"{length:g} mm" if length >= 1.0 else f"{1000 * length:g} µm"
    axes.text(left + share / 2, bottom + 0.008 * width / height, text, ha="center", va="bottom")


def _axes(figure: Figure, camera: Camera, width: int, height: int) -> None:
    """Which way x, y and z point."""
    axes = _over(figure)
    origin = np.array([1.0 - 0.075, 0.055 * width / height])
    for name, way in zip("xyz", camera.turn.T, strict=True):
        across, up = way[0], -way[1]
        if np.hypot(across, up) < 0.12:
            continue
        tip = origin + 0.030 * np.array([across, up * width / height])
        axes.plot(*np.stack([origin, tip]).T, color=_MUTED, linewidth=0.9)
        end = origin + 0.042 * np.array([across, up * width / height])
        axes.text(end[0], end[1], name, ha="center", va="center", color=_MUTED, fontsize=7.5)


def _in_pixels(figure: Figure, camera: Camera, width: int) -> Axes:
    """Axes over the scene, in the camera's pixels."""
    share = camera.width / FINER / width
    axes = figure.add_axes((0.0, 0.0, share, 1.0), zorder=1)
    axes.set(xlim=(-0.5, camera.width - 0.5), ylim=(camera.height - 0.5, -0.5))
    axes.set_axis_off()
    return axes


def _over(figure: Figure) -> Axes:
    """Axes over the whole figure, in shares of it."""
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), zorder=2)
    axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    axes.set_axis_off()
    return axes


def round_down(length: float) -> float:
    """The largest of 1, 2 or 5 times a power of ten that isn't above ``length``."""
    power = 10.0 ** np.floor(np.log10(length))
    factor = max(f for f in (1.0, 2.0, 5.0) if f * power <= length * (1.0 + 1e-9))
    return float(f"{factor * power:.1g}")


Frame = NDArray[np.uint8]
_STRIP = 0.16
"""Height of the wave's strip over the film's width."""


@dataclass(frozen=True, eq=False)
class DrivingWave:
    """A value over a cycle, drawn below the scene with a mark at the frame's time.

    Attributes
    ----------
    time_s, value : (t,) float64
        The cycle's end left out.
    title : str
        Name and unit of the value.
    period_s : float, s
    """

    time_s: FloatArray
    value: FloatArray
    title: str
    period_s: float


@dataclass(frozen=True, eq=False)
class FilmScene:
    """What all frames share: the whole network, which sets the camera, and the tissue."""

    whole: VesselNetwork
    surface: Surface | None
    options: PictureOptions

    def frame(self, network: VesselNetwork, quantity: Quantity, caption: str) -> Frame:
        """Draw what there is of the network; (height, width, 3), red, green, blue."""
        camera = scene_camera(self.whole, self.surface, self.options)
        image, _ = shade(network, quantity, self.surface, camera, FINER)

        def mark(figure: Figure) -> None:
            figure.text(0.03, 0.985, caption, ha="left", va="top", fontsize=10.0)

        drawn = annotated(image, quantity, camera, self.options.width, mark)
        return _even(np.asarray(drawn))

    def strip(self, wave: DrivingWave, time_s: float) -> Frame:
        """Draw the wave that drives the network, and where in it a time is."""
        width = self.options.width
        dpi, height = dots_per_inch(width), 2 * round(0.5 * _STRIP * width)
        with rc_context(STYLE):
            figure = Figure(figsize=(width / dpi, height / dpi), dpi=dpi, facecolor="white")
            axes = figure.add_axes((0.12, 0.36, 0.70, 0.56))
            closed = np.append(wave.time_s, wave.period_s), np.append(wave.value, wave.value[0])
            axes.plot(*closed, color="#5f6972", linewidth=1.0)
            now = float(np.interp(time_s, *closed))
            axes.plot([time_s], [now], "o", color="#d55e00", markersize=4.5)
            axes.set(xlim=(0.0, wave.period_s), xlabel="Time / s")
            axes.set_ylabel(wave.title.replace(" / ", "\n/ "), fontsize=7.5)
            axes.spines[["top", "right"]].set_visible(False)
            return _even(np.asarray(rendered(figure)))


def _even(image: Frame) -> Frame:
    """Without a last row or column of an odd size, which film formats can't hold."""
    return np.ascontiguousarray(image[: len(image) // 2 * 2, : image.shape[1] // 2 * 2])
