"""`printctl scan`: simulate the scan of a print made on the simulated printer."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from printctl.cli.kernels_ready import have_kernels
from printctl.cli.options import JsonFlag, print_json, print_lines, print_note, three_numbers
from printctl.cli.run_folder import print_folder
from printctl.errors import UsageError
from printctl.machine.link.history import PrintHistory
from printctl.machine.link.history_entry import PrintEntry, entry_of
from printctl.machine.link.record import JOURNAL

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
