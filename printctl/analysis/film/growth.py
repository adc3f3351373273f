"""Frames of a network as it grew: terminal by terminal, or generation by generation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from design.measures.growth_order import GrowthOrder, growth_order
from design.network import VesselNetwork
from kernels.arrays import FloatArray
from printctl.analysis.film.film_file import Frame
from printctl.errors import UsageError
from registration.measuring.gauging import sub_network
from registration.report.picture import FilmScene, Quantity

By = Literal["terminals", "generations"]


@dataclass(frozen=True)
class GrowthFilm:
    """Settings of a film of growth.

    Attributes
    ----------
    by : "terminals" or "generations"
    steps : int
        Frames of growth by terminals; each generation is a step of its own.
    hold : int
        Frames that each generation, and the whole at the end, stands for.
    murray_exponent : float
        By which vessels are thinner while fewer terminals are there.
    """

    by: By = "terminals"
    steps: int = 60
    hold: int = 12
    murray_exponent: float = 3.0


def growth_frames(scene: FilmScene, quantity: Quantity, film: GrowthFilm) -> Iterator[Frame]:
    """Draw each step, then the whole network for a while.

    Raises
    ------
    UsageError
        For growth by terminals of a network that isn't trees.
    """
    network = scene.whole
    order = growth_order(network)
    if film.by == "generations":
        yield from _generations(scene, quantity, order, film)
        return
    if order.terminal is None:
        raise UsageError(
            "the network has loops that no connections close, so that no terminals came one by "
            "one; give --by generations"
        )
    total = _terminal_count(order)
    radius = quantity.key == "radius"
    frame: Frame | None = None
    for step in range(1, film.steps + 1):
        # As many in the first frames as can be followed by eye.
        count = max(1, round(total * (step / film.steps) ** 2))
        part = order.drawn(count / total)
        shown = part ** (1.0 / film.murray_exponent)
        frame = scene.frame(
            *_drawn(network, quantity, shown, radius),
            f"{count} of {total} terminals{_per_tree(order)}",
        )
        yield frame
    if frame is not None:
        yield from (frame for _ in range(film.hold))


def _generations(
    scene: FilmScene, quantity: Quantity, order: GrowthOrder, film: GrowthFilm
) -> Iterator[Frame]:
    last = int(order.generation.max())
    for number in range(last + 1):
        there = (order.generation <= number).astype(np.float64)
        count = int(there.sum())
        caption = f"generation {number} of {last}: {count} of {len(there)} vessels"
        frame = scene.frame(*_drawn(scene.whole, quantity, there, False), caption)
        yield from (frame for _ in range(film.hold))


def _terminal_count(order: GrowthOrder) -> int:
    """Terminals of the tree that has most."""
    if order.terminal is None or order.parent is None:
        return 0
    came = order.terminal[np.isfinite(order.terminal)]
    return max(1, round(1.0 / float(came.min())))


def _per_tree(order: GrowthOrder) -> str:
    trees = 0 if order.parent is None else int((order.parent < 0).sum())
    return "" if trees < 2 else " of the largest tree"


def _drawn(
    network: VesselNetwork, quantity: Quantity, shown: FloatArray, as_wide: bool
) -> tuple[VesselNetwork, Quantity]:
    """The vessels that are there, radii times ``shown`` (v,), and the quantity's values there."""
    kept = np.flatnonzero(shown > 0.0)
    part, _ = sub_network(network, kept)
    points = np.repeat(shown > 0.0, np.diff(network.offset))
    radius = part.radius * np.repeat(shown[kept], np.diff(part.offset))
    values = quantity.values[points if quantity.at_points(network) else kept]
    coloured = replace(quantity, values=radius if as_wide else values)
    return replace(part, radius=radius), coloured
