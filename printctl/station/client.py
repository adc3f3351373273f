"""The client's side of a station: connect, attach, hear of it, ask it for something.

A client may go away at any time; the station doesn't mind. Every call opens a connection of its
own, so that one client may be used by several threads and nothing stands in the way of `kill`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from printctl.link.client import PrintClient
from printctl.printing.find import Order
from printctl.station.status import StationStatus


class Station:
    """One client of a station; made by `connect` or `attach`.

    Every wish is done when its call returns, and gives the status after it. What can't be granted
    raises `printctl.link.errors.Refused`; a station that is gone, `NoLink`; a printer that fails
    meanwhile, `LinkError`.
    """

    folder: Path

    @property
    def status(self) -> StationStatus:
        """The station as it is now; of one that has gone, the last word, as closed or lost."""
        raise NotImplementedError

    def events(self) -> Iterator[StationStatus]:
        """Give each status as it comes, the present one first; ends when the station closes."""
        raise NotImplementedError

    def detach(self) -> None:
        """End `events` from any thread; the station goes on."""
        raise NotImplementedError

    def close(self) -> None:
        """Let go of the port and end the process; refused while printing. Heaters go off."""
        raise NotImplementedError

    def kill(self) -> None:
        """Halt the firmware at once (M112), from any state and thread; nothing can block it."""
        raise NotImplementedError

    def stop_motion(self) -> StationStatus:
        """Stop a manual move where the firmware can (M410); the position must be told anew."""
        raise NotImplementedError

    def reconnect(self) -> StationStatus:
        """Open the port again and check the printer, after ``halted`` or ``lost``."""
        raise NotImplementedError

    def jog(
        self, axis: str | Mapping[str, float], mm: float = 0.0, speed_mm_s: float | None = None
    ) -> StationStatus:
        """Move the tip by ``mm`` along an axis, or by several axes' ``{"x": 1.0, "y": -1.0}``."""
        raise NotImplementedError

    def move_to(
        self,
        x: float | None = None,
        y: float | None = None,
        z: float | None = None,
        *,
        speed_mm_s: float | None = None,
    ) -> StationStatus:
        """Move the tip to a place; refused unless the position is trusted."""
        raise NotImplementedError

    def home(
        self, axes: Sequence[str] = ("x", "y", "z"), *, needle_off: bool = False
    ) -> StationStatus:
        """Home axes; refused with a needle mounted above a dish, unless ``needle_off``."""
        raise NotImplementedError

    def heat(self, name: str, celsius: float) -> StationStatus:
        """Set a heater's target (``nozzle``, ``bed``), 0 for off; doesn't wait for it."""
        raise NotImplementedError

    def plunger(self, ul: float, ul_s: float | None = None) -> StationStatus:
        """Push (above 0) or draw back so many µL, measured by the syringe mounted."""
        raise NotImplementedError

    def command(self, text: str) -> list[str]:
        """Send a line by the console; while a print goes on, through its link. Give the reply."""
        raise NotImplementedError

    def mount(self, **said: Any) -> StationStatus:
        """Say what is mounted: the fields of `Mounted`, and ``plunger_mm`` of a syringe put in.

        Keys left out stay as they are; ``""`` (or None) takes away.
        """
        raise NotImplementedError

    def touch_off(self, z: float | None = None, *, foil_mm: float = 0.0) -> StationStatus:
        """Say that the tip touches the floor: here, or at ``z``, less the foil it stands on."""
        raise NotImplementedError

    def set_position(
        self, x: float | None = None, y: float | None = None, z: float | None = None
    ) -> StationStatus:
        """Tell the printer where its tip stands (G92); nothing moves."""
        raise NotImplementedError

    def print(self, order: Order) -> PrintClient:
        """Print on the open port; gives a client of the print, once its first lines go out."""
        raise NotImplementedError


def connect(
    profile: str,
    port: str,
    folder: Path,
    *,
    baud: int | str | None = None,
    sim_speed: float = 1.0,
    start_mm: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Station:
    """Start a station's process, and attach to it; returns once the printer has been checked.

    ``port`` may be ``simulated`` (with its speed, 0 for as fast as it can) or ``auto``.
    """
    raise NotImplementedError


def attach(folder: Path) -> Station:
    """Attach to the station of ``folder``; `NoLink` when none was ever started there."""
    raise NotImplementedError
