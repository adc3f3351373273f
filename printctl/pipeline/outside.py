"""Report how much of a given network lies outside the tissue; refuse one wholly outside."""

from __future__ import annotations

from typing import Final

import numpy as np

from design.network import VesselNetwork
from design.tissue import Tissue
from printctl.errors import RecipeError

_PLACES: Final = 400
"""Along the longest side of the tissue, at which vessels are looked at."""

_TOLD: Final = 0.02
"""Of the vessels' length; ends that stand out of the tissue, so that they can be fed, are usual."""


def outside_note(tissue: Tissue, network: VesselNetwork) -> tuple[str, ...]:
    """A sentence on vessels outside the tissue, which nothing is cut out for; none for few.

    Raises
    ------
    RecipeError
        When no vessel lies in the tissue.
    """
    low, high = (bound(tissue.surface.vertices, axis=0) for bound in (np.min, np.max))
    start, end, *_ = network.pieces()
    length = np.linalg.norm(end - start, axis=1)
    count = np.clip(np.ceil(length * _PLACES / (high - low).max()), 1, _PLACES).astype(np.int64)
    piece = np.repeat(np.arange(len(length)), count)
    along = (np.arange(len(piece)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[
        piece
    ]
    places = start[piece] + along[:, None] * (end - start)[piece]
    outside = ~tissue.contains(np.ascontiguousarray(places))
    share = (length / count)[piece]
    total, out = float(share.sum()), float(share[outside].sum())
    if out <= _TOLD * total:
        return ()
    if outside.all():
        ends = np.concatenate([start, end])
        raise RecipeError(
            "no vessel of the network lies in the tissue: vessels reach from "
            f"{_text(ends.min(0))} to {_text(ends.max(0))} mm, "
            f"the tissue from {_text(low)} to {_text(high)} mm; move one of them, "
            "or see to the network's unit"
        )
    depth = tissue.grid.distance(np.ascontiguousarray(places[outside]))
    worst = places[outside][int(np.argmax(depth))]
    return (
        f"{out:.3g} of {total:.3g} mm of vessels lie outside the tissue, up to {depth.max():.3g} "
        f"mm at {_text(worst)} mm: nothing is cut out for them there",
    )


def _text(point: np.ndarray) -> str:
    return "({:.4g}, {:.4g}, {:.4g})".format(*point)
