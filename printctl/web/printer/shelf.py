"""Profiles that can be chosen: the shipped ones, and the workspace's own."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from firmware_profiles import Facts, Printer, ProfileError, load, shipped
from firmware_profiles.load import FOLDERS, Profile
from printctl.link.finding import matches
from printctl.link.ports import PortInfo, list_ports
from printctl.web.errors import ConflictError, NotFoundError
from printctl.web.workspace import checked_name

SIMULATED: Final = "simulated"


@dataclass(frozen=True)
class Shelf:
    """Profiles by name; the workspace's own are files in ``profiles/SORT/NAME.yaml``.

    Attributes
    ----------
    root : Path
        The workspace.
    """

    root: Path

    def folder(self, model: type[Facts]) -> Path:
        """Where the workspace's own profiles of a sort are."""
        return self.root / "profiles" / FOLDERS[model]

    def names(self, model: type[Facts]) -> list[str]:
        """The workspace's own first, then those shipped."""
        own = sorted(path.stem for path in self.folder(model).glob("*.yaml"))
        return [*own, *(name for name in shipped(model) if name not in own)]

    def given(self, model: type[Facts], name: str) -> str:
        """What `firmware_profiles.load` takes: a shipped name, or the path of one's own.

        Raises
        ------
        NotFoundError
        """
        own = self.folder(model) / f"{checked_name(name)}.yaml"
        if own.is_file():
            return str(own.resolve())
        if name not in shipped(model):
            raise NotFoundError(
                f"there is no {FOLDERS[model][:-1]} profile {name!r}; there are "
                f"{', '.join(self.names(model))}"
            )
        return name

    def load(self, model: type[Profile], name: str) -> Profile:
        """Load a profile by its name on the shelf.

        Raises
        ------
        NotFoundError, ProfileError
        """
        return load(model, self.given(model, name))

    def name(self, given: str) -> str:
        """The name on the shelf of what `given` gave."""
        return Path(given).stem if given.endswith((".yaml", ".yml")) else given

    def new_file(self, model: type[Facts], name: str) -> Path:
        """Where a measured copy goes.

        Raises
        ------
        ConflictError
            When a shipped profile has that name.
        """
        if checked_name(name) in shipped(model):
            raise ConflictError(
                f"{name!r} is a shipped profile's name; give the measured copy another one"
            )
        return self.folder(model) / f"{name}.yaml"

    def printers(self) -> list[str]:
        """Names of printers that a host can stream to."""
        kept = []
        for name in self.names(Printer):
            try:
                streamed = self.load(Printer, name).streamed
            except (ProfileError, OSError):  # a file of the user's own that can't be used
                continue
            if streamed:
                kept.append(name)
        return kept


@dataclass(frozen=True)
class FoundPort:
    """A port, and the profiles whose USB id it has."""

    device: str
    description: str
    usb_id: str
    serial_number: str
    profiles: tuple[str, ...]


def ports_with_profiles(shelf: Shelf, ports: list[PortInfo] | None = None) -> list[FoundPort]:
    """List this machine's serial ports; nothing is opened."""
    printers = {name: shelf.load(Printer, name) for name in shelf.printers()}
    return [
        FoundPort(
            port.device,
            port.description,
            port.usb_id,
            port.serial_number,
            tuple(name for name, printer in printers.items() if matches(printer, port)),
        )
        for port in (list_ports() if ports is None else ports)
    ]


def summary(printer: Printer) -> str:
    """What a printer is, on one line."""
    x, y, z = (f"{s.low:g} to {s.high:g}" for s in (printer.x_mm, printer.y_mm, printer.z_mm))
    pushes = (
        f"pneumatic, {printer.pneumatic.pressure_kpa:g} kPa"
        if printer.pneumatic
        else f"plunger, {printer.plunger_travel_mm:g} mm of travel"
    )
    heads = f", {printer.head_count} heads" if printer.heads else ""
    return (
        f"{printer.name}: {printer.firmware}, {printer.baud} Bd, X {x}, Y {y}, Z {z} mm; "
        f"{pushes}{heads}"
    )


def unmeasured(printer: Printer) -> str:
    """Which of its numbers are starting values; empty for none."""
    if not printer.starting_values:
        return ""
    return (
        f"Starting values, to be measured or compared with the machine: "
        f"{', '.join(printer.starting_values)}"
    )
