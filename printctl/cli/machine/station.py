"""`printctl station`, `ports`, `sim-printer`: a printer's connection between prints."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from firmware_profiles import Printer, load, shipped
from printctl.checks.set_up import read_dish_centre
from printctl.cli.declare import command, group, json_command, wants_json
from printctl.cli.options import PrinterOption, print_lines, print_note, print_result
from printctl.errors import PrintctlError, UsageError
from printctl.machine.control.idle.station_status import StationStatus, unknown_values
from printctl.machine.ports.detection import AUTO, list_ports, matches, read_baud
from printctl.machine.ports.transport import locate
from printctl.machine.process.clients.client import Station, attach_station
from printctl.machine.process.clients.starting import connect as open_station
from printctl.machine.process.contact import usual_folder
from printctl.settings import arg, opt, three_numbers
from printctl.sources import python_command

FolderOption = Annotated[Path | None, opt("Folder of the station.", show_default="the user's data")]
ByOption = Annotated[float | None, opt("Distance, mm.")]
PlaceOption = Annotated[float | None, opt("Position in printer coordinates, mm.")]
_OF_A_PROFILE = "a shipped profile or a .yaml file; '' for none."
_SHOWN = frozenset({"needle", "syringe", "ink", "dish", "bath"})


def the_station(folder: Path | None) -> Station:
    """A client of the station of a folder, or of the usual one."""
    return attach_station(folder or usual_folder())


def print_status(status: StationStatus) -> None:
    """Say how the station stands."""
    print_result(status.to_dict(), _lines(status))


def _lines(status: StationStatus) -> Iterator[str]:
    yield from (f"{status.state.value}: {status.message}", f"{status.profile} at {status.port}")
    unknown = unknown_values(status)
    count = ""
    if status.position_mm is not None:
        x, y, z = status.position_mm
        count = f"X{x:.2f} Y{y:.2f} Z{z:.2f}"
    if reason := unknown.get("position"):
        yield f"tip unknown: {reason}" + (f" (last count: {count})" if count else "")
    else:
        yield f"tip at {count}"
    if reason := unknown.get("temperatures"):
        yield f"temperatures unknown: {reason}"
    else:
        for one in status.temperatures:
            target = f", target {one.target_c:g} °C" if one.target_c else ""
            yield f"{one.name} {one.now_c:g} °C{target}"
    yield from (f"reads {reading}" for reading in status.readings)
    mounted = vars(status.mounted).items()
    if there := [f"{what} {name}" for what, name in mounted if name and what in _SHOWN]:
        yield "mounted: " + ", ".join(there)
    if status.mounted.floor_mm is not None:
        yield f"floor of the dish at Z {status.mounted.floor_mm:.2f} mm"
    if reason := unknown.get("ink"):
        yield f"ink left unknown: {reason}"
    elif status.ul_left is not None:
        yield f"{status.ul_left:.1f} µL left"
    if status.print_folder:
        yield f"print: {status.print_folder}"


@json_command
def connect(
    *,
    printer: PrinterOption,
    port: str = opt("Serial port, tcp:HOST:PORT, auto, or simulated.", ...),
    baud: str | None = opt("Baud rate; default: the profile's; auto tries its list."),
    speed: float = opt("Speed of a simulated printer relative to real time; 0: maximum.", 1.0),
    start: str = opt("Tip position of a simulated printer.", "0,0,0", metavar="X,Y,Z"),
    discard: bool = opt("Connect although the last print was interrupted; it is given up.", False),
    folder: FolderOption = None,
) -> None:
    """Connect a printer and stand by, in a process that goes on when this command ends.

    Nothing moves, but opening the port resets many boards: their position and heaters' targets
    are gone then.
    """
    station = open_station(
        printer,
        port,
        folder or usual_folder(),
        baud=read_baud(baud),
        sim_speed=speed,
        start_mm=three_numbers(start, "--start"),
        discard_interrupted=discard,
    )
    print_status(station.status)


@json_command
def status(folder: FolderOption = None) -> None:
    """Say where the tip is, how warm it is, what is mounted, and what goes on.

    Only looks. Exit code 0 whatever the state is, so that a script can read it with --json.
    """
    print_status(the_station(folder).status)


@json_command
def mount(
    needle: str | None = opt(f"Needle: {_OF_A_PROFILE}"),
    syringe: str | None = opt(f"Syringe, full: {_OF_A_PROFILE}"),
    ink: str | None = opt(f"Ink: {_OF_A_PROFILE}"),
    dish: str | None = opt(f"Dish: {_OF_A_PROFILE}"),
    bath: str | None = opt(f"Bath: {_OF_A_PROFILE}"),
    dish_centre: str | None = opt("Dish centre, mm.", metavar="X,Y"),
    bath_level: float | None = opt("Z of the bath surface, mm."),
    plunger: float | None = opt("Plunger travel already used.", None, "--plunger-mm"),
    folder: FolderOption = None,
) -> None:
    """Say what is mounted; the soft limits go by it.

    Another needle or dish must be touched off anew.
    """
    centre = None if dish_centre is None else read_dish_centre(dish_centre)
    named: dict[str, Any] = {
        **{"needle": needle, "syringe": syringe, "ink": ink, "dish": dish, "bath": bath},
        **{"dish_centre_mm": centre, "bath_level_mm": bath_level, "plunger_mm": plunger},
    }
    named = {key: value for key, value in named.items() if value is not None}
    if not named:
        raise UsageError("nothing is named; give --needle, --dish or the like")
    print_status(the_station(folder).mount(**named))


@json_command
def jog(
    x: ByOption = None,
    y: ByOption = None,
    z: ByOption = None,
    to: bool = opt("Coordinates are absolute positions, not steps.", False),
    speed: float | None = opt("Speed, mm/s; default 5, or the Z maximum."),
    folder: FolderOption = None,
) -> None:
    """Move the tip in a straight line, by steps or to a place, and wait until it is there.

    What might run into the dish, its floor or the end of an axis is refused.
    """
    given = {axis: mm for axis, mm in (("x", x), ("y", y), ("z", z)) if mm is not None}
    if not given:
        raise UsageError("no axis is named; give --x, --y or --z in mm")
    if to:
        print_status(the_station(folder).move_to(**given, speed_mm_s=speed))
    else:
        print_status(the_station(folder).jog(given, speed_mm_s=speed))


@json_command
def home(
    axes: str = arg("Axes to home, e.g. xy.", "xyz"),
    needle_off: bool = opt("Confirm that the needle is dismounted.", False),
    folder: FolderOption = None,
) -> None:
    """Home axes; refused as long as a needle is mounted: it would be driven into what is below.

    Axes that are homed are trusted from then on; what the needle may do follows from that.
    """
    print_status(the_station(folder).home(list(axes), needle_off=needle_off))


@json_command
def where(
    x: PlaceOption = None,
    y: PlaceOption = None,
    z: PlaceOption = None,
    folder: FolderOption = None,
) -> None:
    """Tell the printer where its tip stands; nothing moves. Nobody can check it for you.

    Said by a person who looked: nothing moves, and the soft limits go by it from then on.
    """
    print_status(the_station(folder).set_position(x, y, z))


@json_command
def touch_off(
    foil: float = opt("Thickness of the foil between tip and floor, mm.", 0.0),
    folder: FolderOption = None,
) -> None:
    """Take the tip's height for the dish's floor, below which it isn't let from now on.

    Another needle or another dish forgets the floor; touch off again.
    """
    print_status(the_station(folder).touch_off(foil_mm=foil))


@json_command
def push(
    ul: float = opt("Volume, µL; negative retracts.", ...),
    speed: float | None = opt("Flow rate, µL/s; default: the ink's."),
    folder: FolderOption = None,
) -> None:
    """Push ink, or draw the plunger back, within what the syringe mounted has left.

    The station counts what is left; a full syringe is told it by `printctl station mount`.
    """
    print_status(the_station(folder).plunger(ul, speed))


@json_command
def heat(
    name: str = arg("Heater: nozzle, bed or chamber."),
    celsius: float = arg("Target temperature, °C; 0: off."),
    folder: FolderOption = None,
) -> None:
    """Set a heater's target, within what ink and bath bear; doesn't wait until it is warm.

    Heaters keep their target when this command ends, until it is set to 0 or the station is
    disconnected.
    """
    print_status(the_station(folder).heat(name, celsius))


@json_command
def send(command: str = arg("Command, e.g. M503."), folder: FolderOption = None) -> None:
    """Send a command and print the reply; moves and heat go by the same limits as jog and heat.

    While a print goes on it is sent between two of its lines.
    """
    lines = the_station(folder).command(command)
    if wants_json() or lines:
        print_result({"command": command, "lines": lines}, lines)


@json_command
def stop(folder: FolderOption = None) -> None:
    """End the move that goes on, after at most half a second of it; the position stays known.

    Sending it twice does no harm. Homing can't be ended by it. To halt the printer at once use
    `printctl station emergency-stop`.
    """
    print_status(the_station(folder).stop_motion())


def emergency_stop(folder: FolderOption = None) -> None:
    """Halt the firmware at once, past all queues; its position is lost.

    A Marlin with emergency parser gets M410 first and M112 after 2.8 s, or 3.8 s where the profile
    has two lines in flight; others M112 at once.
    `printctl station reconnect` comes back from it, once the machine was looked at. Where the
    station's own process has died, its port is opened and the halt written to it; then connect
    anew.
    """
    the_station(folder).kill()
    print_lines(
        "emergency stop sent; `printctl station status` reports whether the printer has halted"
    )


@json_command
def reconnect(folder: FolderOption = None) -> None:
    """Open the port again and check the printer; see first what its needle stands in.

    After an emergency stop or a lost port. The position isn't trusted until it is homed or set.
    """
    print_status(the_station(folder).reconnect())


def disconnect(folder: FolderOption = None) -> None:
    """Switch the heaters off and let go of the port; refused while something moves or prints.

    A heater that the profile keeps on (safe_state_on) stays on, and is named.
    """
    station = the_station(folder)
    station.close()
    print_lines(station.status.message)


class _StationGroup(TyperGroup):
    """Commands of a station; ``kill`` is the earlier name of ``emergency-stop``."""

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return the command of that name, or None."""
        return super().get_command(ctx, "emergency-stop" if cmd_name == "kill" else cmd_name)


station = group(
    typer.Typer(
        cls=_StationGroup,
        help="Connect a printer, move it by hand within soft limits, and have it ready to print.",
        no_args_is_help=True,
    ),
    *(connect, status, mount, jog, home, where, touch_off, push, heat, send, stop, emergency_stop),
    *(reconnect, disconnect),
)


@json_command
def ports(
    printer: str | None = opt("Profile to search for, in addition to the shipped ones."),
    find: bool = opt("Open the port of --printer, and try baud rates until it replies.", False),
) -> None:
    """List serial ports with their USB ids and the profiles that these match.

    Nothing is opened but with --find: that may reset the board, and moves nothing.
    """
    if find:
        if printer is None:
            raise typer.BadParameter(
                "--find needs --printer: only a port with its USB id is opened"
            )
        place = locate(AUTO, AUTO, load(Printer, printer))
        print_result(vars(place), [f"{place.port}\t{place.baud} Bd"])
        return
    known = {name: load(Printer, name) for name in [*shipped(Printer), *filter(None, [printer])]}
    rows = [(p, [n for n, facts in known.items() if matches(facts, p)]) for p in list_ports()]
    facts = {"ports": [vars(port) | {"profiles": names} for port, names in rows]}
    lines: list[str] = []
    if not (rows or wants_json()):
        print_note(
            "no serial port found; plug the printer in, or use port: simulated in the recipe"
        )
        return
    for p, names in rows:
        cells = (p.device, p.usb_id or "-", p.serial_number or "-", p.description)
        lines.append("\t".join((*cells, ", ".join(names) or "no profile's")))
    print_result(facts, lines)


@command
def sim_printer(
    context: typer.Context,
    printer: PrinterOption = "generic_marlin",
    link: Path | None = opt("Name for the pseudo-terminal."),
    tcp: int | None = opt("Listen on this TCP port."),
    speed: float = opt("Speed relative to real time; 0: maximum.", 1.0, min=0),
) -> None:
    """Run a simulated printer until interrupted; further options are those of `python -m sim`.

    Any host program can print on it: it answers as the profile's firmware does, on a
    pseudo-terminal or a TCP port.
    """
    words = [*python_command("sim"), "--printer", printer, "--speed", str(speed)]
    words += ["--link", str(link)] if link else []
    words += ["--tcp", str(tcp)] if tcp is not None else []
    # On Windows a process's parent may be the launcher of a virtual environment.
    words += [] if sys.platform == "win32" else ["--parent-pid", str(os.getpid())]
    with subprocess.Popen([*words, *context.args]) as serving:
        signal.signal(signal.SIGTERM, lambda number, frame: serving.terminate())
        try:
            code = serving.wait()
        except KeyboardInterrupt:
            return
    if code:
        raise PrintctlError("the simulated printer ended with an error; see above")
