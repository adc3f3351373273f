"""Command-line options of the scan generator; those of the shared generator among them."""

from __future__ import annotations

import argparse
from typing import Any

from benchmarks.scans.designs import DESIGNS

SINGLE: dict[str, tuple[Any, str]] = {
    "seed": (0, ""),
    "orientation": (0, "0 to 23, on top of yaw and tilt; 0 is upright"),
    "yaw": (None, "degrees; default within 12"),
    "roughness-um": (8.0, ""),
    "grain-um": (110.0, "size of the roughness's cells"),
    "contrast": (None, "gel over both bath and lumen (power)"),
    "bath": (None, "percent of the gel; default 0.5"),
    "lumen": (None, "percent of the gel; default 2"),
    "snr-db": (32.0, ""),
    "rolloff-db-mm": (0.5, ""),
    "index": (1.333, "true group index; the file says 1.333"),
    "attenuation-per-mm": (0.25, "of the gel, one way"),
    "tail": (0.05, "multiply scattered over single scattered power"),
    "reflection-db": (12.0, "of a level wall over the gel"),
    "looks": (1, ""),
    "per-cell": (1.2, "scatterers per 3 um of depth in the beam"),
    "resolution-um": (14.0, ""),
    "beam-um": (22.0, "1/e2 radius at the waist"),
    "focus-mm": (1.3, ""),
    "rayleigh-mm": (1.6, ""),
}
"""Options of one number: default, help."""
LISTS: dict[str, tuple[Any, str]] = {
    "tilt": (None, "X,Y: degrees; default within 2"),
    "shrink": (None, "X,Y,Z: scale; default 0.965 to 1.005"),
    "voxel-um": ([50.0, 50.0, 25.0], "X,Y,Z"),
}
DEFECTS = {
    "bulge": "VESSEL,AT,SIGMA_MM,AMP_MM",
    "radius-change": "VESSEL,AMP_MM",
    "plug": "VESSEL,AT,LENGTH_MM",
    "leak": "VESSEL,AT,DIAMETER_MM[,OTHER]",
}
"""Each may be given again; VESSEL is a number, AT a share 0 to 1 of its length."""


def numbers(text: str) -> list[float]:
    """Parse numbers separated by commas."""
    return [float(v) for v in text.split(",")]


def parser() -> argparse.ArgumentParser:
    """Return the parser of `python -m benchmarks.scans.make`."""
    ap = argparse.ArgumentParser(description="Make a synthetic OCT scan and its truth.")
    ap.add_argument("design", choices=sorted(DESIGNS))
    ap.add_argument("out", help="prefix; part.stl and network.csv go to PREFIX_design/")
    for name, (usual, about) in SINGLE.items():
        kind = float if usual is None else type(usual)
        ap.add_argument(f"--{name}", type=kind, default=usual, help=about)
    for name, (usual, about) in LISTS.items():
        ap.add_argument(f"--{name}", type=numbers, default=usual, help=about)
    for name, shown in DEFECTS.items():
        ap.add_argument(f"--{name}", metavar=shown, type=numbers, action="append", default=[])
    ap.add_argument("--missing", metavar="VESSEL", type=int, action="append", default=[])
    ap.add_argument("--turned-over", action="store_true", help="light enters through the bottom")
    ap.add_argument("--half-field", action="store_true", help="lower half of x only")
    ap.add_argument("--mirror", choices="xyz", help="reverse this axis and don't say so")
    return ap
