"""`printctl scan`: simulate the scan of a print made on the simulated printer."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from printctl.cli.kernels_ready import have_kernels
from printctl.cli.options import (
    JsonFlag,
    print_json,
    print_lines,
    print_note,
    three_numbers,
    two_numbers,
)
from printctl.cli.run_folder import print_folder
from printctl.errors import UsageError
from printctl.machine.link.history import PrintHistory
from printctl.machine.link.history_entry import PrintEntry, entry_of
from printctl.machine.link.record import JOURNAL
from registration.files import readers

if TYPE_CHECKING:
    from registration.files.readers import ScanOverrides


# Command-line options of a scan: metadata that its file lacks, calibrations, filled lumens.
#
# Commands take them all as `ScanOptions` (`printctl.cli.section_options`).

ScanFile = Annotated[
    Path,
    typer.Argument(
        help="A scan of any known format, or a mosaic's YAML (docs/scans.md).", show_default=False
    ),
]
VoxelUm = Annotated[
    str | None,
    typer.Option("--voxel-um", metavar="X,Y,Z", help="Where the scan's file doesn't say."),
]
RefractiveIndex = Annotated[
    float | None, typer.Option("--refractive-index", help="Group index of gel and liquid.")
]
OpticalDepth = Annotated[
    bool | None,
    typer.Option("--optical-depth/--geometric-depth", help="What the depth voxel counts."),
]
Modality = Annotated[
    Literal["oct", "microct", "confocal"] | None, typer.Option("--modality", help="What measured.")
]
Scale = Annotated[Literal["linear", "db"] | None, typer.Option("--scale", help="Of the intensity.")]
Axes = Annotated[
    str | None,
    typer.Option("--axes", metavar="ZYX", help="Order of the file's axes, slowest first."),
]
DepthDown = Annotated[
    bool | None,
    typer.Option("--depth-down/--depth-up", help="Which way growing depth index goes."),
]
Mirrored = Annotated[
    bool | None,
    typer.Option("--mirrored/--not-mirrored", help="The file's x, y, z are left-handed."),
]
DbRange = Annotated[
    str | None,
    typer.Option("--db-range", metavar="LOW,HIGH", help="dB of the lowest and highest count."),
]
CountRange = Annotated[
    str | None,
    typer.Option(
        "--count-range", metavar="LOW,HIGH", help="Counts that mean --db-range; else the type's."
    ),
]
CountsPerDb = Annotated[
    float | None, typer.Option("--counts-per-db", help="In place of --db-range.")
]
DbAtZero = Annotated[
    float | None, typer.Option("--db-at-zero", help="dB of count 0, with --counts-per-db.")
]
OctCalibrationFile = Annotated[
    Path | None, typer.Option("--oct-calibration", help="File of `printctl calibrate oct`.")
]
AirAbove = Annotated[
    bool,
    typer.Option("--air-above", help="Air lies above the sample: undo refraction at its surface."),
]
WallsFile = Annotated[
    Path | None,
    typer.Option("--walls", help="Old name for a file of walls; give it as --oct-calibration."),
]
Filled = Annotated[
    bool,
    typer.Option("--filled", help="Lumens are brighter than the gel: filled with contrast agent."),
]


@dataclass(frozen=True)
class ScanOptions:
    """What the command line says of a scan and of its calibrations, as typer reads it."""

    voxel_um: VoxelUm = None
    refractive_index: RefractiveIndex = None
    optical_depth: OpticalDepth = None
    modality: Modality = None
    scale: Scale = None
    axes: Axes = None
    depth_down: DepthDown = None
    mirrored: Mirrored = None
    db_range: DbRange = None
    count_range: CountRange = None
    counts_per_db: CountsPerDb = None
    db_at_zero: DbAtZero = None
    oct_calibration: OctCalibrationFile = None
    air_above: AirAbove = False
    walls: WallsFile = None
    filled: Filled = False

    def overrides(self) -> ScanOverrides:
        """What the scan's file doesn't say; raises `UsageError` for numbers that aren't."""
        db, counts = self.db_range, self.count_range
        return readers.ScanOverrides(
            voxel_mm=voxel_mm(self.voxel_um),
            refractive_index=self.refractive_index,
            optical_depth=self.optical_depth,
            scale=self.scale,
            modality=self.modality,
            depth_down=self.depth_down,
            axes=self.axes,
            mirrored=self.mirrored,
            db_range=None if db is None else two_numbers(db, "--db-range"),
            count_range=None if counts is None else two_numbers(counts, "--count-range"),
            counts_per_db=self.counts_per_db,
            db_at_zero=self.db_at_zero,
        )


def voxel_mm(text: str | None) -> tuple[float, float, float] | None:
    """``X,Y,Z`` in µm to (dz, dy, dx) in mm."""
    if text is None:
        return None
    x, y, z = three_numbers(text, "--voxel-um")
    return (z * 1e-3, y * 1e-3, x * 1e-3)


PrintArg = Annotated[
    str,
    typer.Argument(
        metavar="PRINT",
        help="The print: its folder, its run folder, its G-code file, its journal, or its id "
        "(`printctl history`).",
        show_default=False,
    ),
]
OutOption = Annotated[
    Path | None,
    typer.Option("--out", help="Scan file, .tif or .oct; scan.tif in the print's folder if not "
                 "given.", show_default=False),
]  # fmt: skip
DeviceOption = Annotated[
    Literal["oct", "microct"] | None,
    typer.Option(
        "--device",
        help="What scans; if not given, oct for layers that light gets through, else microct.",
        show_default=False,
    ),
]
VoxelOption = Annotated[
    str | None,
    typer.Option(
        "--voxel-um", metavar="X,Y,Z", help="25,25,15 of oct, 80,80,80 of microct by default."
    ),
]
HeldOption = Annotated[
    str | None,
    typer.Option(help="Profile, or one of each head with commas between; as printed by default."),
]


def scan(
    printed: PrintArg,
    out: OutOption = None,
    device: DeviceOption = None,
    voxel_um: VoxelOption = None,
    shrink_percent: Annotated[
        float,
        typer.Option("--shrink-percent", help="By how much the part shrank.", min=-10, max=20),
    ] = 1.0,
    seed: Annotated[int, typer.Option("--seed", help="Of noise and pose.", min=0)] = 1,
    large: Annotated[bool, typer.Option("--large", help="Allow more than 1 GB.")] = False,
    syringe: HeldOption = None,
    ink: HeldOption = None,
    needle: HeldOption = None,
    faults: Annotated[
        Path | None, typer.Option("--faults", help="Fault file that the print was made with.")
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option(
            "--record", help="What the motors did, where `printctl sim-printer --record` wrote it."
        ),
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Simulate an OCT or micro-CT scan of any print made on the simulated printer.

    Writes the scan, its sidecar (NAME.json), and where the part really lay (NAME_truth.json). The
    part is tilted, turned and shifted at random. `printctl register` holds it against the model.
    """
    from printctl.pipeline.print_scan import StatedPrint, scan_print  # help waits for no kernel

    have_kernels("run fresh")
    wanted = {
        "simulated": device,
        "voxel_um": None if voxel_um is None else three_numbers(voxel_um, "--voxel-um"),
        "shrink_percent": shrink_percent,
        "seed": seed,
        "large": large,
    }
    stated = StatedPrint(syringe, ink, needle, faults, record)
    facts = scan_print(find_print(printed), stated, wanted, out, print_note)
    if as_json:
        print_json(facts)
    else:
        print_lines(facts["scan"], facts["sidecar"], facts["truth"])


def find_print(text: str) -> PrintEntry:
    """Return the print that a folder, a file or an id names.

    Raises
    ------
    UsageError
        When none is there, or its journal says nothing of a job.
    HistoryError
        When no print has such an id.
    """
    path = Path(text)
    if not path.exists():
        return PrintHistory().one(text)
    journal = path if path.suffix == ".log" and path.is_file() else print_folder(path) / JOURNAL
    entry = entry_of(journal) if journal.is_file() else None
    if entry is None:
        raise UsageError(
            f"{text} holds no print's journal; give the print's folder, its run folder, its G-code "
            "file, or its id (`printctl history`)"
        )
    return entry
