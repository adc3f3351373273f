"""Command-line options for supervising a print: checkpoints, dead-man's time, syringes, log."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

import typer

from printctl.machine.link.care import Care

CheckpointOption = Annotated[
    float,
    typer.Option(
        "--checkpoint-every",
        metavar="SECONDS",
        min=0.0,
        help="Verify the position where a layer or pass ends, at most so often, s; 0 for each end, "
        "inf for none.",
    ),
]
DeadmanOption = Annotated[
    float,
    typer.Option(
        "--deadman",
        metavar="MINUTES",
        min=0.0,
        help="Pause unless somebody confirms within so many min (`printctl alive`).",
    ),
]
DeadmanStopsFlag = Annotated[bool, typer.Option("--deadman-stops", help="Stop instead of pausing.")]
PrimeOption = Annotated[
    float, typer.Option("--prime-ul", min=0.0, help="Ink to push in addition after a pause, µL.")
]
ReloadFlag = Annotated[
    bool, typer.Option("--reload", help="Pause for a new syringe where one doesn't last.")
]
SilentLimitOption = Annotated[
    float | None,
    typer.Option(
        "--silent-limit",
        metavar="SECONDS",
        min=10.0,
        max=86_400.0,
        help="End the print when the printer gives no usable answer for so long, s; 60, or 1800 "
        "for one line of Klipper and RepRapFirmware, which may be busy with it.",
    ),
]
NoiseLimitOption = Annotated[
    int,
    typer.Option(
        "--noise-limit",
        metavar="LINES",
        min=1,
        help="Pause when more lines than this among 500 had to be sent again.",
    ),
]
WireLogOption = Annotated[
    str,
    typer.Option(
        "--wire-log",
        metavar="PATH",
        help="Write all traffic to this file or folder; else the last of it is kept on an alarm.",
    ),
]


def care_for(
    syringes: Sequence[str],
    capacity_mm: Sequence[float],
    checkpoint_every: float,
    deadman: float,
    stops: bool,
) -> Care:
    """From the options' seconds and minutes; of several heads, what is in each."""
    several = len(syringes) > 1
    return Care(
        checkpoint_s=None if math.isinf(checkpoint_every) else checkpoint_every,
        deadman_s=60.0 * deadman,
        deadman_stops=stops,
        syringe=syringes[0],
        capacity_mm=capacity_mm[0],
        head_syringes=tuple(syringes) if several else (),
        head_capacity_mm=tuple(capacity_mm) if several else (),
    )
