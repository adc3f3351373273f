"""Names and limits of the models of a printed line's cross-section; needs no NumPy."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

BeadShape = Literal["rounded", "rectangle", "ellipse"]
MeasuredExcess = Annotated[float, Field(ge=0, le=500, allow_inf_nan=False)]
"""Measured width over area / height, µm."""
