"""`printctl scan`: simulate the scan of a print made on the simulated printer."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from printctl.cli.declare import json_command
from printctl.cli.kernels_ready import have_kernels
from printctl.cli.options import print_note, print_result
from printctl.errors import UsageError
from printctl.history.index import PrintHistory
from printctl.machine.prints.state import print_folder
from printctl.machine.records.record import JOURNAL
from printctl.pipeline.past.past_print import PrintEntry, entry_of
from printctl.recipe.sections.measuring import FileScan, SimulatedScan
from printctl.settings import arg, of, opt, settings, three_numbers, two_numbers
from registration.files import readers

if TYPE_CHECKING:
    from registration.files.readers import ScanOverrides


ScanFile = Annotated[Path, arg("A scan of any known format, or a mosaic's YAML (docs/scans.md).")]
HeldOption = Annotated[
    str | None, opt("Profile, or one of each head with commas between; as printed by default.")
]


@settings
class ScanOptions:
    """What the command line says of a scan and of its calibrations: a recipe's `FileScan`."""

    voxel_um: str | None = of(FileScan, "voxel_um", metavar="X,Y,Z")
    refractive_index: float | None = of(FileScan, "refractive_index")
    optical_depth: bool | None = of(FileScan, "optical_depth", "--optical-depth/--geometric-depth")
    modality: Literal["oct", "microct", "confocal"] | None = of(FileScan, "modality")
    scale: Literal["linear", "db"] | None = of(FileScan, "scale")
    axes: str | None = of(FileScan, "axes", metavar="ZYX")
    depth_down: bool | None = of(FileScan, "depth_down", "--depth-down/--depth-up")
    mirrored: bool | None = of(FileScan, "mirrored", "--mirrored/--not-mirrored")
    db_range: str | None = of(FileScan, "db_range", metavar="LOW,HIGH")
    count_range: str | None = of(FileScan, "count_range", metavar="LOW,HIGH")
    counts_per_db: float | None = of(FileScan, "counts_per_db")
    db_at_zero: float | None = of(FileScan, "db_at_zero")
    oct_calibration: Path | None = opt("File of `printctl calibrate oct`.")
    air_above: bool = of(FileScan, "air_above")
    walls: Path | None = of(FileScan, "walls")
    filled: bool = of(FileScan, "filled")

    def overrides(self) -> ScanOverrides:
        """What the scan's file doesn't say; raises `UsageError` for numbers that aren't."""
        db, counts = self.db_range, self.count_range
        stated = vars(self) | {
            "voxel_mm": voxel_mm(self.voxel_um),
            "db_range": None if db is None else two_numbers(db, "--db-range"),
            "count_range": None if counts is None else two_numbers(counts, "--count-range"),
        }
        names = readers.ScanOverrides.__dataclass_fields__
        return readers.ScanOverrides(**{name: stated[name] for name in names})


def voxel_mm(text: str | None) -> tuple[float, float, float] | None:
    """``X,Y,Z`` in µm to (dz, dy, dx) in mm."""
    if text is None:
        return None
    x, y, z = three_numbers(text, "--voxel-um")
    return (z * 1e-3, y * 1e-3, x * 1e-3)


@json_command
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
    voxel_um: str | None = opt("As fine as the thinnest vessel needs by default.", metavar="X,Y,Z"),
    shrink_percent: float = of(SimulatedScan, "shrink_percent"),
    seed: int = opt("Random seed of noise and pose.", 1, min=0),
    large: bool = of(SimulatedScan, "large"),
    syringe: HeldOption = None,
    ink: HeldOption = None,
    needle: HeldOption = None,
    embedded: bool | None = opt(
        "Filaments in a bath, or layers; as the recipe or FILE.map.npz says by default. Without "
        "either, level writing is taken as layers.",
        None,
        "--embedded/--layered",
    ),
    layer_um: float | None = opt("Layer height of a print with a single layer.", min=1, max=5000),
    faults: Path | None = opt("Fault file that the print was made with."),
    record: Path | None = opt(
        "What the motors did, where `printctl sim-printer --record` wrote it."
    ),
) -> None:
    """Simulate an OCT or micro-CT scan of any print made on the simulated printer.

    Writes the scan, its sidecar (NAME.json), and where the part really lay (NAME_truth.json). The
    part is tilted, turned and shifted at random. `printctl register` holds it against the model.
    """
    from printctl.pipeline.running.print_scan import (  # help waits for no kernel
        StatedPrint,
        scan_print,
    )

    have_kernels("run fresh")
    wanted = {
        "simulated": device,
        "voxel_um": None if voxel_um is None else three_numbers(voxel_um, "--voxel-um"),
        "shrink_percent": shrink_percent,
        "seed": seed,
        "large": large,
    }
    stated = StatedPrint(syringe, ink, needle, faults, record, embedded, layer_um)
    facts = scan_print(find_print(printed), stated, wanted, out, print_note)
    print_result(facts, (facts[name] for name in ("scan", "sidecar", "truth")))


def find_print(text: str) -> PrintEntry:
    """Return the print that a folder, a file or an id names; raise `UsageError`, `HistoryError`."""
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
