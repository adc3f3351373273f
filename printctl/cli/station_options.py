"""Options shared by `printctl station` subcommands; find the station, print its status."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from printctl.cli.options import print_json, print_lines
from printctl.machine.station import Station, StationStatus, attach
from printctl.machine.station.record import usual_folder

FolderOption = Annotated[
    Path | None,
    typer.Option(
        "--folder", help="The station's, if not the usual one.", show_default="the user's data"
    ),
]


def folder_of(folder: Path | None) -> Path:
    """The folder named, or the usual one."""
    return folder if folder is not None else usual_folder()


def the_station(folder: Path | None) -> Station:
    """A client of the station of a folder.

    Raises
    ------
    NoLink
        When none was ever opened there.
    """
    return attach(folder_of(folder))


def print_status(status: StationStatus, as_json: bool) -> None:
    """Say how the station stands."""
    if as_json:
        print_json(status.to_dict())
    else:
        print_lines(*status_text(status))


def status_text(status: StationStatus) -> list[str]:
    """A status for people."""
    lines = [f"{status.state.value}: {status.message}", f"{status.profile} at {status.port}"]
    if status.position_mm is not None:
        place = " ".join(
            f"{axis}{mm:.2f}" for axis, mm in zip("XYZ", status.position_mm, strict=True)
        )
        trust = "" if status.position_trusted else " (not trusted: home, or tell where it is)"
        lines.append(f"tip at {place}{trust}")
    for one in status.temperatures:
        target = f", target {one.target_c:g} °C" if one.target_c else ""
        lines.append(f"{one.name} {one.now_c:g} °C{target}")
    lines += [f"reads {reading}" for reading in status.readings]
    mounted = status.mounted
    there = [f"{what} {name}" for what, name in vars(mounted).items() if name and what in _SHOWN]
    if there:
        lines.append("mounted: " + ", ".join(there))
    if mounted.floor_mm is not None:
        lines.append(f"floor of the dish at Z {mounted.floor_mm:.2f} mm")
    if status.ul_left is not None:
        lines.append(f"{status.ul_left:.1f} µL left")
    if status.print_folder:
        lines.append(f"print: {status.print_folder}")
    return lines


_SHOWN = frozenset({"needle", "syringe", "ink", "dish", "bath"})
