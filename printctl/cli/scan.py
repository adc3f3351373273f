"""`printctl scan`: simulate the scan of a print made on the simulated printer."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from printctl.cli.declare import command
from printctl.cli.kernels_ready import have_kernels
from printctl.cli.options import (
    JsonFlag,
    print_json,
    print_lines,
    print_note,
    three_numbers,
    two_numbers,
)
from printctl.cli.running_print import print_folder
from printctl.errors import UsageError
from printctl.machine.link.history import PrintHistory
from printctl.machine.link.history_entry import PrintEntry, entry_of
from printctl.machine.link.record import JOURNAL
from printctl.settings import arg, opt, settings
from registration.files import readers

if TYPE_CHECKING:
    from registration.files.readers import ScanOverrides


# Command-line options of a scan: metadata that its file lacks, calibrations, filled lumens.
#
# Commands take them all as `ScanOptions` (`printctl.cli.section_options`).

ScanFile = Annotated[Path, arg("A scan of any known format, or a mosaic's YAML (docs/scans.md).")]


@settings
class ScanOptions:
    """What the command line says of a scan and of its calibrations, as typer reads it."""

    voxel_um: str | None = opt("Where the scan's file doesn't say.", metavar="X,Y,Z")
    refractive_index: float | None = opt("Group index of gel and liquid.")
    optical_depth: bool | None = opt(
        "What the depth voxel counts.", None, "--optical-depth/--geometric-depth"
    )
    modality: Literal["oct", "microct", "confocal"] | None = opt("What measured.")
    scale: Literal["linear", "db"] | None = opt("Of the intensity.")
    axes: str | None = opt("Order of the file's axes, slowest first.", metavar="ZYX")
    depth_down: bool | None = opt(
        "Which way growing depth index goes.", None, "--depth-down/--depth-up"
    )
    mirrored: bool | None = opt(
        "The file's x, y, z are left-handed.", None, "--mirrored/--not-mirrored"
    )
    db_range: str | None = opt("dB of the lowest and highest count.", metavar="LOW,HIGH")
    count_range: str | None = opt(
        "Counts that mean --db-range; else the type's.", metavar="LOW,HIGH"
    )
    counts_per_db: float | None = opt("In place of --db-range.")
    db_at_zero: float | None = opt("dB of count 0, with --counts-per-db.")
    oct_calibration: Path | None = opt("File of `printctl calibrate oct`.")
    air_above: bool = opt("Air lies above the sample: undo refraction at its surface.", False)
    walls: Path | None = opt("Old name for a file of walls; give it as --oct-calibration.")
    filled: bool = opt("Lumens are brighter than the gel: filled with contrast agent.", False)

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


HeldOption = Annotated[
    str | None, opt("Profile, or one of each head with commas between; as printed by default.")
]


@command
def scan(
    printed: str = arg(
        "The print: its folder, its run folder, its G-code file, its journal, or its id "
        "(`printctl history`).",
        metavar="PRINT",
    ),
    out: Path | None = opt("Scan file, .tif or .oct; scan.tif in the print's folder if not given."),
    device: Literal["oct", "microct"] | None = opt(
        "What scans; if not given, oct for layers that light gets through, else microct."
    ),
    voxel_um: str | None = opt("25,25,15 of oct, 80,80,80 of microct by default.", metavar="X,Y,Z"),
    shrink_percent: float = opt("By how much the part shrank.", 1.0, min=-10, max=20),
    seed: int = opt("Of noise and pose.", 1, min=0),
    large: bool = opt("Allow more than 1 GB.", False),
    syringe: HeldOption = None,
    ink: HeldOption = None,
    needle: HeldOption = None,
    faults: Path | None = opt("Fault file that the print was made with."),
    record: Path | None = opt(
        "What the motors did, where `printctl sim-printer --record` wrote it."
    ),
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
