"""Publication picture of a network: shaded scene with colour bar, scale bar and axes, as PNG."""

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
from matplotlib.patches import Patch
from matplotlib.ticker import LogFormatter, MaxNLocator
from numpy.typing import NDArray
from PIL import Image

from design.geometry.surface import Surface
from design.network import VesselNetwork
from kernels.arrays import FloatArray
from registration.report.picture.camera import Camera, View, fitted_camera
from registration.report.picture.colours import DIVERGING, NO_DATA, SEQUENTIAL
from registration.report.picture.flow_marks import draw_flow_marks, port_reach
from registration.report.picture.quantity import Quantity
from registration.report.picture.render import shade

FINER: Final = 2
LEGEND_AT_MOST: Final = 12
_INK: Final = "#1c2126"
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
        One of `registration.report.picture.camera.DIRECTIONS`.
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
    norm = LogNorm(low, high) if quantity.scale == "log" else Normalize(low, high)
    bar = figure.add_axes((left + 0.015, 0.22, 0.016, 0.62))
    colours = DIVERGING if quantity.scale == "diverging" else SEQUENTIAL
    drawn = figure.colorbar(ScalarMappable(norm, colours), cax=bar)
    drawn.outline.set_linewidth(0.5)
    if quantity.scale == "log":
        decades = np.log10(high / low)
        labelled = (1.0, 2.0, 5.0) if decades < 2.5 else (1.0,)
        drawn.ax.yaxis.set_minor_formatter(_PlainLog(labelled, decades))
        drawn.ax.yaxis.set_major_formatter(_PlainLog(labelled, decades))
    else:
        drawn.locator = MaxNLocator(6, steps=[1, 2, 2.5, 5, 10])
        drawn.update_ticks()
    bar.set_title(fill(quantity.title, 15), loc="left", fontsize=8.5, pad=8)


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
