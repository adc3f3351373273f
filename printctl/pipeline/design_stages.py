"""List of the design stages in running order; loads nothing of toolpath, print or scan."""

from __future__ import annotations

from collections.abc import Sequence

from printctl.pipeline.stage import Stage
from printctl.pipeline.stages import (
    fidelities,
    flow,
    measures,
    oxygen,
    solid,
    tissue,
    vasculature,
)

DESIGN: Sequence[Stage] = (
    tissue.STAGE,
    vasculature.STAGE,
    flow.STAGE,
    fidelities.STAGE,
    measures.STAGE,
    oxygen.STAGE,
    solid.STAGE,
)
