"""`printctl calibrate walls`: fit a scanner's wall offset to registered scans of known channels."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from printctl.calibration import Estimate
from printctl.cli.calibrate_options import print_estimates
from printctl.cli.options import JsonFlag, messages
from printctl.errors import UsageError
from registration.walls_file import measured_walls, write_walls

NUMBERS = "registration.json"


def walls(
    phantoms: Annotated[
        list[Path],
        typer.Argument(
            help="Folders of `printctl register`, of scans of a phantom whose channels are known.",
            show_default=False,
        ),
    ],
    write: Annotated[
        Path | None, typer.Option("--write", help="YAML file for `register --walls`.")
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Offset of walls, from registered scans of a phantom whose model is what it really is.

    The model's diameters are taken as exact: the phantom's, not a print's design.
    """
    vessels = [_vessels(folder) for folder in phantoms]
    known, measured = (
        [np.array([vessel[name] for vessel in scan], dtype=float) for scan in vessels]
        for name in ("designed_um", "measured_um")
    )
    calibration = measured_walls(known, measured)
    low, high = (
        calibration.offset_um - calibration.interval_um,
        calibration.offset_um + calibration.interval_um,
    )
    notes = [
        f"from {calibration.scans} scan(s), {sum(map(len, known))} channels of "
        f"{calibration.from_um:.0f} to "
        f"{calibration.to_um:.0f} µm; holds for this device, voxel size and material alone"
    ]
    if calibration.scans == 1:
        notes.append("one scan: its interval doesn't hold what differs from scan to scan")
    estimates = {
        "walls lie further into the gel by": Estimate(calibration.offset_um, low, high, "µm")
    }
    print_estimates(estimates, notes, as_json)
    if write is not None:
        write_walls(write, calibration)
        messages().print(f"wrote {write}", markup=False)


def _vessels(folder: Path) -> list[dict[str, Any]]:
    """The open vessels that were measured."""
    path = folder / NUMBERS if folder.is_dir() else folder
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        part = data.get("registration", data)
        if part.get("walls") is not None:
            raise UsageError(f"{path}: was registered with --walls already; register it without")
        rows = part["vessels"]
        return [v for v in rows if v["open"] and v["sections"] > 0 and v["measured_um"]]
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as exc:
        raise UsageError(
            f"{path}: no result of `printctl register` there ({type(exc).__name__}: {exc})"
        ) from exc
