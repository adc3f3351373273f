"""Painted layers as the tests ask for them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.checkers import layer_painter as painter
from registration.inspection import ExpectedLines


def expected(plan: painter.Plan, fresh: bool = True, first_stroke: int = 0) -> ExpectedLines:
    count = len(plan.width)
    start, end = (np.column_stack([p, np.full(count, 0.3)]) for p in (plan.start, plan.end))
    return ExpectedLines(
        start,
        end,
        plan.width.astype(float),
        np.arange(count),
        plan.stroke.astype(np.int64) + first_stroke,
        np.full(count, fresh),
    )


def both(one: ExpectedLines, other: ExpectedLines) -> ExpectedLines:
    return ExpectedLines(
        *(np.concatenate([getattr(one, name), getattr(other, name)]) for name in vars(one))
    )


@dataclass
class Scene:
    """A square of 4 mm with one layout, 20 µm per px unless told."""

    seed: int
    kind: str = "opaque"
    layout: str = "rings"
    contrast: float = 0.4
    um_per_px: float = 20.0
    size: float = 4.0
    width: float = 0.3

    def plan(self) -> painter.Plan:
        rng = np.random.default_rng(self.seed)
        return painter.plan_layer(self.layout, self.size, self.width, rng)

    def paint(
        self,
        gaps: tuple[tuple[int, float, float], ...] = (),
        ratio: float = 1.0,
        thin: tuple[float, float, float] | None = None,
        **more: object,
    ) -> painter.Painted:
        """Paint it, all strokes from one way on to another with a part of their width."""
        rng = np.random.default_rng(self.seed + 1)
        plan = self.plan()
        look = painter.random_look(self.kind, rng, self.contrast)
        look.light = min(look.light, 0.25)
        ink = painter.lay(plan, rng, ratio=ratio, gaps=list(gaps))
        if thin is not None:
            at, stroke, along, width = ink
            less = (along > thin[0]) & (along < thin[1])
            ink = at, stroke, along, np.where(less, thin[2] * width, width)
        return painter.paint(plan, ink, list(gaps), self.size, self.um_per_px, look, rng, **more)  # type: ignore[arg-type]
