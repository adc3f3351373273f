"""Command-line options of the scan generator; those of the shared generator among them."""

from __future__ import annotations

import argparse

from benchmarks.scans.designs import DESIGNS


def numbers(text: str) -> list[float]:
    """Parse numbers separated by commas."""
    return [float(v) for v in text.split(",")]


def parser() -> argparse.ArgumentParser:
    """Return the parser of `python -m benchmarks.scans.make`."""
    ap = argparse.ArgumentParser(
        description="Make a synthetic spectral-domain OCT scan and its truth."
    )
    ap.add_argument("design", choices=sorted(DESIGNS))
    ap.add_argument("out", help="prefix; part.stl and network.csv go to PREFIX_design/")
    ap.add_argument("--seed", type=int, default=0)
    add_pose(ap.add_argument_group("pose and shape"))
    add_defects(ap.add_argument_group("planted defects (each may be given again)"))
    add_light(ap.add_argument_group("light"))
    add_file(ap.add_argument_group("file"))
    return ap


def add_pose(group: argparse._ArgumentGroup) -> None:
    """Add where the part lies and how it differs as a whole."""
    group.add_argument(
        "--orientation", type=int, default=0, help="0 to 23, on top of yaw and tilt; 0 is upright"
    )
    group.add_argument("--turned-over", action="store_true", help="light enters through the bottom")
    group.add_argument("--yaw", type=float, help="degrees; default within 12")
    group.add_argument("--tilt", type=numbers, metavar="X,Y", help="degrees; default within 2")
    group.add_argument(
        "--shrink", type=numbers, metavar="X,Y,Z", help="scale; default 0.965 to 1.005"
    )
    group.add_argument("--roughness-um", type=float, default=8)
    group.add_argument("--grain-um", type=float, default=110, help="size of the roughness's cells")


def add_defects(group: argparse._ArgumentGroup) -> None:
    """Add defects; VESSEL is a number, AT a share 0 to 1 of its length."""

    def many(name: str, metavar: str) -> None:
        group.add_argument(name, metavar=metavar, action="append", default=[], type=numbers)

    many("--bulge", "VESSEL,AT,SIGMA_MM,AMP_MM")
    many("--radius-change", "VESSEL,AMP_MM")
    many("--plug", "VESSEL,AT,LENGTH_MM")
    many("--leak", "VESSEL,AT,DIAMETER_MM[,OTHER]")
    group.add_argument("--missing", metavar="VESSEL", type=int, action="append", default=[])


def add_light(group: argparse._ArgumentGroup) -> None:
    """Add the instrument and the media."""
    group.add_argument("--contrast", type=float, help="gel over both bath and lumen (power)")
    group.add_argument("--bath", type=float, help="percent of the gel; default 0.5")
    group.add_argument("--lumen", type=float, help="percent of the gel; default 2")
    group.add_argument("--snr-db", type=float, default=32)
    group.add_argument("--rolloff-db-mm", type=float, default=0.5)
    group.add_argument(
        "--index", type=float, default=1.333, help="true group index; the file says 1.333"
    )
    group.add_argument("--attenuation-per-mm", type=float, default=0.25, help="of the gel, one way")
    group.add_argument(
        "--tail", type=float, default=0.05, help="multiply scattered over single scattered power"
    )
    group.add_argument(
        "--reflection-db", type=float, default=12, help="of a level wall over the gel"
    )
    group.add_argument("--looks", type=int, default=1)
    group.add_argument(
        "--per-cell", type=float, default=1.2, help="scatterers per 3 um of depth in the beam"
    )
    group.add_argument("--resolution-um", type=float, default=14)
    group.add_argument("--beam-um", type=float, default=22, help="1/e2 radius at the waist")
    group.add_argument("--focus-mm", type=float, default=1.3)
    group.add_argument("--rayleigh-mm", type=float, default=1.6)


def add_file(group: argparse._ArgumentGroup) -> None:
    """Add how the scan is stored."""
    group.add_argument("--voxel-um", type=numbers, default=[50.0, 50.0, 25.0], metavar="X,Y,Z")
    group.add_argument(
        "--mirror", choices=("x", "y", "z"), help="reverse this axis and don't say so"
    )
    group.add_argument("--half-field", action="store_true", help="lower half of x only")
