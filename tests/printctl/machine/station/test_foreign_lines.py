"""Another program's lines to an idle printer: its position becomes unknown."""

from __future__ import annotations

import os

from printctl.machine.link import LinkState
from printctl.machine.link.retreat import Retreat
from printctl.machine.printing.find import Order
from printctl.machine.station import StationState, connect
from tests.printctl.machine.link.fake_marlin import FakeMarlin, PtyPrinter, pty_printer, write_job
from tests.printctl.machine.station.test_kill import until, wait_for


def write_as_another(served: PtyPrinter, data: bytes) -> None:
    port = os.open(served.name, os.O_RDWR | os.O_NOCTTY)
    os.write(port, data)
    os.close(port)


def test_line_of_another_program_takes_a_standing_printers_place(folder, profile):
    with pty_printer(FakeMarlin()) as served:
        station = connect(profile, served.name, folder)
        station.set_position(100, 100, 50)
        assert station.status.position_trusted
        write_as_another(served, b"G92 X0 Y0\n")
        assert "another program or noise wrote to it" in until(station, StationState.HALTED)
        assert not station.status.position_trusted
        assert station.reconnect().state is StationState.READY
        assert not station.status.position_trusted
        station.close()


def test_line_of_another_program_pauses_a_print_above_the_dish_and_takes_its_place(
    folder, profile, tmp_path
):
    with pty_printer(FakeMarlin(), hold_at=40) as served:
        station = connect(profile, served.name, folder)
        station.set_position(0, 0, 0)
        job = tmp_path / "job.gcode"
        write_job(job, 120)
        order = Order(job, profile, "", tmp_path / "run", Retreat())
        client = station.print(order)
        assert served.held.wait(20)
        write_as_another(served, b"G1 X90\n")
        served.gate.set()
        wait_for(lambda: client.status.state is LinkState.PAUSED)
        assert served.printer.at["Z"] >= 0.5 + Retreat().lift_mm
        client.resume()
        assert client.wait(300).state is LinkState.DONE
        assert "another program" in until(station, StationState.HALTED)
        assert not station.status.position_trusted
        station.close()
