"""Data class and JSON file of an observer's orders: job, profiles, device, camera frame, limits."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from design.files import write_text
from printctl.observe.deciding import Limits
from printctl.observe.devices import DeviceSettings
from printctl.observe.records import ORDER_FILE


@dataclass(frozen=True)
class ObserverOrder:
    """Order of an observer process.

    Attributes
    ----------
    job : str
        Path of the G-code file.
    profile : str
        Printer, by name or path.
    syringe, ink, needle : str
        Profiles, by name or path.
    oct : bool
        Whether the device gives volumes; pictures, where it isn't a laser line either.
    embedded : bool
        Filaments in a bath; else layers.
    capacity_ul : float or None, µL
        Ink that the syringe holds as the print begins.
    network : str
        Path of the network's file, in the printer's frame after ``place_mm``; empty for none.
    place_mm : tuple, mm
    frame : str
        Path of the camera's frame; empty for the simulated camera's own geometry.
    device : DeviceSettings
    limits : Limits
    care : dict
        When the print is held for looks: fields of `printctl.machine.job.care.Care`, as JSON.
    laser : bool
        Whether the device is a laser line profiler, which gives height maps.
    """

    job: str
    profile: str
    syringe: str
    ink: str
    needle: str
    embedded: bool
    oct: bool
    frame: str
    device: DeviceSettings
    capacity_ul: float | None = None
    network: str = ""
    place_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    limits: Limits = field(default_factory=Limits)
    care: dict[str, Any] = field(default_factory=dict)
    laser: bool = False

    @property
    def tells_heights(self) -> bool:
        """Whether the device sees how high ink lies: an OCT or a laser line; a camera doesn't."""
        return self.oct or self.laser

    def save(self, folder: Path) -> None:
        """Write the order into a folder of a run or print."""
        write_text(folder / ORDER_FILE, json.dumps(asdict(self), indent=1) + "\n")

    @staticmethod
    def load(folder: Path) -> ObserverOrder:
        """Read the order that `save` has written.

        Raises
        ------
        OSError, ValueError
            When there is none that can be read.
        """
        text = (folder / ORDER_FILE).read_text(encoding="utf-8")
        try:
            return TypeAdapter(ObserverOrder).validate_json(text)
        except ValidationError as exc:
            raise ValueError(f"{folder / ORDER_FILE} isn't an observer's order: {exc}") from exc
