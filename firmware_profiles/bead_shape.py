"""Accepted settings of a line's cross-section: three shape names, or a measured excess width."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

BeadShape = Literal["rounded", "rectangle", "ellipse"]
MeasuredExcess = Annotated[float, Field(ge=0, le=500, allow_inf_nan=False)]
"""Measured width over area / height, µm."""
