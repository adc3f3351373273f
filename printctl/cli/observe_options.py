"""Typer options of `printctl observe`: camera frame file, largest shift for a valid frame."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

FrameFile = Annotated[
    Path, typer.Option("--frame", help="File of `printctl observe frame`.", show_default=False)
]
LimitOption = Annotated[
    float, typer.Option("--limit-um", help="Shift at the dish up to which a frame holds.", min=1)
]
