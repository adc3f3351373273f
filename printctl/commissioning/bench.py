"""Printer of a commissioning: its station, its settings, prints on its open port."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from firmware_profiles import Dish, Ink, Printer, Syringe, load
from printctl.checks.set_up import ABOVE_WALL_MM, refuse_failed
from printctl.errors import PrinterFailedError, SafetyError
from printctl.machine.control.idle.station_status import Place, StationState
from printctl.machine.errors import NoLink
from printctl.machine.job.care import Care
from printctl.machine.job.coordinates import declared_start
from printctl.machine.job.job import load_job
from printctl.machine.job.retreat import Retreat
from printctl.machine.job.syringes import usable_mm
from printctl.machine.ports.detection import SIMULATED
from printctl.machine.prints.follow import retreat_for
from printctl.machine.prints.mounted import first_syringe_ul, left_check
from printctl.machine.probing import Settings, query_settings, set_plunger_steps
from printctl.machine.process.clients.client import Station, attach_station
from printctl.machine.process.clients.starting import connect
from printctl.machine.process.contact import STATION_LOCK, alive
from printctl.machine.process.orders import Order
from printctl.machine.process.simulated import simulated_printer
from printctl.machine.records.states import LinkState, state_words
from printctl.pipeline.checked_order import MIN_LIFT_MM


@dataclass
class Bench:
    """The printer on its port.

    Attributes
    ----------
    printer : str
        Profile's file.
    port : str
    folder : Path
        The station's.
    sim_speed : float
        Of a simulated printer, times real time; 0 for as fast as it can.
    """

    printer: str
    port: str
    folder: Path
    sim_speed: float = 0.0

    @property
    def simulated(self) -> bool:
        """Whether nothing can move."""
        return self.port == SIMULATED

    @property
    def profile(self) -> Printer:
        """The profile as its file is now."""
        return load(Printer, self.printer)

    def middle_mm(self) -> Place:
        """Return a place clear of all ends, where a weighing says that the tip stands."""
        x, y, z = self.profile.x_mm, self.profile.y_mm, self.profile.z_mm
        height = z.low + min(50.0, (z.high - z.low) / 2)
        return (x.low + x.high) / 2, (y.low + y.high) / 2, height

    # --- the station -----------------------------------------------------------------------------

    def station(self) -> Station:
        """Return the printer's station, connected now if it wasn't.

        Raises
        ------
        SafetyError
            When another printer is connected in the folder.
        LinkError
        """
        if alive(self.folder, STATION_LOCK):
            station = attach_station(self.folder)
            status = station.status
            if Path(status.profile) == Path(self.printer) and status.port == self.port:
                if not status.open:
                    station.reconnect()
                return station
            if status.open or Path(status.profile) != Path(self.printer):
                raise SafetyError(
                    f"{status.profile} at {status.port} is connected, not {self.printer} at "
                    f"{self.port}; disconnect it first (`printctl station disconnect`, or page "
                    "Printer)"
                )
            station.close()  # Its cable is in another socket now.
        return connect(
            self.printer,
            self.port,
            self.folder,
            sim_speed=self.sim_speed,
            start_mm=self.middle_mm(),
        )

    def close(self) -> None:
        """Disconnect the station if it is this printer's; heaters go off."""
        if alive(self.folder, STATION_LOCK):
            with suppress(NoLink):
                self.station().close()

    def move_above(self, station: Station, place: Place) -> None:
        """Move the tip up, across and down to a place, within the station's soft limits."""
        status = station.status
        mounted = status.mounted
        if status.position_mm is None or not status.position_trusted or mounted.touch_off_due:
            raise SafetyError(
                "where the tip stands above the dish isn't known any more (the printer was "
                "disconnected or reset), so it can't be moved to the start of the print; touch off "
                "again: printctl commission --from touch-off, or Begin again on the page"
            )
        heights = [status.position_mm[2], place[2]]
        if mounted.dish and mounted.floor_mm is not None:
            heights.append(mounted.floor_mm + load(Dish, mounted.dish).wall_mm + ABOVE_WALL_MM)
        station.move_to(z=max(heights))
        station.move_to(place[0], place[1])
        station.move_to(*place)

    def print(self, job: Path, folder: Path, syringe: str, ink: str = "") -> dict[str, Any]:
        """Print a checked file on the station's port and wait for its end.

        The tip must stand where the job begins, but where nobody knows where it stands.

        Raises
        ------
        SafetyError
            When it takes more ink than the syringe holds.
        PrinterFailedError
            When the print didn't end well.
        LinkError
        """
        profile, held, station = self.profile, load(Syringe, syringe), self.station()
        lines, left_ul = load_job(job, profile), station.status.ul_left
        if left_ul is not None:
            refuse_failed([left_check(first_syringe_ul(lines, (), held.area_mm2), left_ul)])
        retreat = retreat_for(held, load(Ink, ink), MIN_LIFT_MM) if ink else Retreat()
        start = declared_start(lines)
        care = Care(syringe=syringe, capacity_mm=usable_mm(held, profile), start_mm=start)
        order = Order(job, self.printer, self.port, folder, retreat, care=care)
        client = station.print(order)
        done = client.wait()
        for status in station.events():  # it writes down what the print has left, and stands by
            if status.state not in (StationState.PRINTING, StationState.CONNECTING):
                break
        if done.state is not LinkState.DONE:
            raise PrinterFailedError(
                f"the print of {job.name} ended as {state_words(done.state)}: {done.message} "
                f"(journal: {folder}); look at the machine, then run the commissioning again"
            )
        return {"lines": done.lines_done, "folder": str(folder)}

    # --- its settings ----------------------------------------------------------------------------

    @contextmanager
    def _free_port(self) -> Iterator[str]:
        """Give the port's name once no station holds it; of a simulated printer a new one's."""
        self.close()
        if not self.simulated:
            yield self.port
            return
        with tempfile.TemporaryDirectory() as scratch:
            yield simulated_printer(self.printer, self.middle_mm(), None, None, Path(scratch))

    def query(self) -> Settings:
        """Ask the printer for its settings; changes nothing."""
        with self._free_port() as port:
            return query_settings(port, self.profile)

    def set_plunger_steps(self, steps_per_mm: float) -> Settings:
        """Send and store the plunger's steps/mm; return the settings read back."""
        with self._free_port() as port:
            return set_plunger_steps(port, self.profile, steps_per_mm)
