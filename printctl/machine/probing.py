"""Query a printer's settings; compare them with its profile: a table, and a corrected profile.

The port is opened as a link process opens it, alone: while a print holds it, it is in use. Nothing
is sent but the handshake and questions. On boards that reset when the port opens, it resets them.

Only `set_plunger_steps` sets anything; all else are questions. Answers are read as

- Marlin, Prusa: M115, M503 (M92, M201, M203, M204, M205 in it), M211;
- RepRapFirmware: M115, M92, M201, M203 (mm/min), M208, M302, as ``GCodes2.cpp`` (3.5) words them;
- by a family's own phrases (`Family.setting_phrases`).
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from firmware_profiles import Printer
from firmware_profiles.families import Family, family_of
from printctl.checks.gate.firmware import listed_axes
from printctl.machine.control.board.channel import Channel
from printctl.machine.control.board.connecting import connect, protocol_for
from printctl.machine.control.board.halting import Kill
from printctl.machine.control.board.logbook import Logbook
from printctl.machine.control.board.progress import JobProgress
from printctl.machine.control.board.shell import drive
from printctl.machine.control.board.steps import Steps
from printctl.machine.control.board.wiring import Wiring
from printctl.machine.control.events import PrintEvents
from printctl.machine.control.position.firmware import parse_firmware
from printctl.machine.control.requests import RequestQueue
from printctl.machine.errors import LinkError, Refused
from printctl.machine.families import refuse_unsent
from printctl.machine.job.job import Job
from printctl.machine.ports.clock import RealClock
from printctl.machine.ports.detection import named_port, rates_to_try
from printctl.machine.ports.serial_port import SerialTransport
from printctl.machine.ports.transport import ANSWER_S, open_port, sweep
from printctl.machine.records.journal import Journal
from printctl.machine.records.states import PrintEnded

_TRIES: Final = 3
RELATIVE: Final = 1e-4
ABSOLUTE: Final = 0.006
"""Firmwares print two decimals, some one in mm/min."""
_SETTING: Final = re.compile(r"\b(M\d+(?:\.\d+)?)((?: [A-Z]-?\d+(?:\.\d+)?)+)")
_PAIR: Final = re.compile(r"([A-Z])(-?\d+(?:\.\d+)?)")
_SPAN: Final = re.compile(r"\b([XYZ]) ?(-?\d+(?:\.\d+)?):(-?\d+(?:\.\d+)?)")
_ENDS: Final = re.compile(r"Min: (.*?)Max: (.*)")
_AXIS_CODES: Final = {
    "M92": "steps_per_mm",
    "M201": "max_acceleration_mm_s2",
    "M203": "max_speed_mm_s",
}
_SINGLE_CODES: Final = (
    ("M204", "PS", "acceleration_mm_s2", 1.0),
    ("M205", "J", "junction_deviation_mm", 1.0),
    ("M205", "B", "min_segment_time_s", 1e-6),
)


@dataclass(frozen=True)
class Settings:
    """A printer's own account of its settings.

    Attributes
    ----------
    firmware : str
        Its name for itself.
    values : dict of str to float or bool
        By the profile's key: ``steps_per_mm.x``, ``x_mm.low``, ``emergency_parser``.
    notes : tuple of str
        What it says that no profile has a key for.
    """

    firmware: str
    values: dict[str, float | bool] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def query_settings(port: str, printer: Printer, baud: int | None = None) -> Settings:
    """Open the port (or ``auto``), ask for the printer's settings, and close it.

    ``printer`` is a profile, for the firmware's family and the baud rate; ``baud`` replaces that.

    Raises
    ------
    LinkError
        `PortInUse` while a print or another program holds the port; `Refused` for a printer that
        takes no lines from a host; or no firmware answers.
    """
    with _wired(port, printer, baud) as wiring:
        return query_transport(wiring)


def set_plunger_steps(port: str, printer: Printer, steps_per_mm: float) -> Settings:
    """Send the plunger's steps/mm, store them, and return the settings read back.

    Only of a family that stores them (`Family.stores_steps`), as M92 and M500 do.

    Raises
    ------
    LinkError
        As `query_settings`; `Refused` for another family.
    """
    if not family_of(printer).stores_steps:
        raise Refused(
            f"{printer.firmware} takes its steps from its configuration and stores none that are "
            f"sent: {family_of(printer).steps_remedy}"
        )
    with _wired(port, printer) as wiring:
        return query_transport(wiring, (b"M92 E%.2f" % steps_per_mm, b"M500"))


def reported_firmware(port: str, printers: Sequence[Printer]) -> str:
    """Return the name by which the firmware at a port calls itself, before a profile is chosen.

    Asked in plain text (M115), at the rates of ``printers``; opening the port may reset the board.

    Raises
    ------
    LinkError
        When the port can't be opened, or nothing answers at any rate.
    """
    rates = tuple(dict.fromkeys(rate for one in printers for rate in rates_to_try(one)))
    with closing(open_port(port, printers[0], rates[0])) as wire:
        if isinstance(wire, SerialTransport):
            sweep(wire, rates, RealClock(), resets=True)
        wire.write(b"\nM115\n")
        heard = b""
        while b"FIRMWARE_NAME" not in heard or not heard.endswith(b"\n"):
            more = wire.read(ANSWER_S)
            if not more:
                break
            heard += more
    return parse_firmware(heard.splitlines()).name


@contextmanager
def _wired(port: str, printer: Printer, baud: int | None = None) -> Iterator[Wiring]:
    refuse_unsent(printer)
    with (
        closing(open_port(named_port(port, printer), printer, baud)) as transport,
        tempfile.TemporaryDirectory() as folder,
        closing(Journal(Path(folder) / "journal.log")) as journal,
    ):
        protocol = protocol_for(printer, transport.quiet_s)
        yield Wiring(transport, protocol, RealClock(), journal, printer)


def query_transport(wiring: Wiring, first: Sequence[bytes] = ()) -> Settings:
    """Ask over a wire that is open already, after commands that are sent ``first``.

    Raises
    ------
    LinkError
        When no firmware answers, or the printer halts.
    """
    family = family_of(wiring.printer)
    logbook = Logbook(wiring, JobProgress(wiring, Job([], [], "", "questions")))
    channel = Channel(wiring, logbook, Kill(wiring))
    channel.handler = PrintEvents(channel, RequestQueue())
    try:
        answers = drive(_answers(channel, first), wiring)
    except PrintEnded as ended:
        raise LinkError(f"the printer couldn't be asked: {ended.message}") from ended
    return read_settings(family, answers)


def _answers(channel: Channel, first: Sequence[bytes]) -> Steps[dict[bytes, Sequence[bytes]]]:
    """Ask what a family's settings are asked by."""
    yield from connect(channel)
    yield from channel.commands(first)
    answers: dict[bytes, Sequence[bytes]] = {}
    for question in family_of(channel.wiring.printer).setting_questions:
        for _ in range(_TRIES):
            answers[question] = yield from channel.ask(question)
            if answers[question]:
                break
    return answers


def read_settings(family: Family, answers: dict[bytes, Sequence[bytes]]) -> Settings:
    """Read the answers to a family's questions (`Family.setting_questions`)."""
    firmware = parse_firmware(answers.get(b"M115", ()))
    values: dict[str, float | bool] = {}
    notes: list[str] = []
    for name in ("EMERGENCY_PARSER", "ADVANCED_OK"):
        if name in firmware.capabilities:
            values[name.lower()] = firmware.capabilities[name]
    for replies in answers.values():
        for reply in replies:
            text = reply.decode("ascii", "replace")
            values.update(_read_values(family, text))
            notes += _read_notes(text)
    return Settings(firmware.name, values, tuple(notes))


def _read_values(family: Family, text: str) -> Iterator[tuple[str, float | bool]]:
    for words, key in family.setting_phrases.items():
        match = re.search(rf"{re.escape(words)}:? (\d+(?:\.\d+)?)", text)
        if match:
            yield key, float(match[1])
    if family.setting_phrases:
        return
    for code, values in listed_axes(text).items():
        for axis, number in values.items():
            of_all = axis == "I"
            yield "min_speed_mm_s" if of_all else f"{_AXIS_CODES[code]}.{axis.lower()}", number
    if text.startswith("Axis limits"):
        for axis, low, high in _SPAN.findall(text.partition(")s ")[2] or text):
            yield f"{axis.lower()}_mm.low", float(low)
            yield f"{axis.lower()}_mm.high", float(high)
    ends = _ENDS.search(text)
    for end, words in (("low", ends[1]), ("high", ends[2])) if ends else ():
        for axis, value in _PAIR.findall(words):
            yield f"{axis.lower()}_mm.{end}", float(value)
    for code, words in _SETTING.findall(text):  # commands that would set it, as M503 lists them
        given = dict(_PAIR.findall(words))
        for axis in given.keys() & set("XYZE") if code in _AXIS_CODES else ():
            yield f"{_AXIS_CODES[code]}.{axis.lower()}", float(given[axis])
        for one, letters, key, factor in _SINGLE_CODES:
            value = next((given[letter] for letter in letters if letter in given), None)
            if code == one and value is not None:
                yield key, float(value) * factor


def _read_notes(text: str) -> Iterator[str]:
    if text.startswith(("Cold extrusion is", "echo:Cold extrudes are")):
        yield text.removeprefix("echo:")
    if "M211 S0" in text:
        yield "its software endstops are off (M211 S0): only the host's own checks hold it back"
    if "pressure_advance:" in text and float(text.split(":")[-1]) != 0:
        yield f"{text.removeprefix('// ')}: it changes the plunger's flow by itself"


@dataclass(frozen=True)
class Row:
    """Comparison of one profile key.

    Attributes
    ----------
    key : str
    profile, printer : float or bool
    same : bool
        Within what the firmware prints.
    starting : bool
        Whether the profile says that its number was never measured.
    """

    key: str
    profile: float | bool
    printer: float | bool
    same: bool
    starting: bool


def compare(settings: Settings, profile: Printer) -> list[Row]:
    """Return a row for each key that the printer tells, those that differ first."""
    rows = []
    for key, reported in settings.values.items():
        name, _, part = key.partition(".")
        mine = getattr(profile, name)
        mine = getattr(mine, part) if part else mine
        near = max(ABSOLUTE, RELATIVE * abs(float(mine)))
        exact = isinstance(reported, bool)
        same = reported == mine if exact else abs(float(mine) - float(reported)) <= near
        starting = key in profile.starting_values or name in profile.starting_values
        rows.append(Row(key, mine, reported, same, starting))
    return sorted(rows, key=lambda row: (row.same, row.key))


def corrected_profile(profile: Printer, rows: list[Row], port: str, day: str) -> dict[str, Any]:
    """Return the profile with the printer's own values, as a mapping to write as YAML.

    What the printer reported is no starting value any more, whether it differed or not.

    Raises
    ------
    ValueError
        When the values make no profile (a span without width, say).
    """
    data = profile.model_dump(mode="json", exclude_unset=True)
    for row in rows:
        if row.same:
            continue
        name, _, part = row.key.partition(".")
        if part:
            whole = getattr(profile, name).model_dump(mode="json")
            data[name] = {**whole, **data.get(name, {}), part: row.printer}
        else:
            data[name] = row.printer
    data["starting_values"] = _still_starting(profile, {row.key for row in rows})
    if not data["starting_values"]:
        del data["starting_values"]
    changed = ", ".join(row.key for row in rows if not row.same) or "no value differed"
    data["source"] = f"{profile.source} Read from the printer on {port}, {day}: {changed}."
    Printer.model_validate(data)
    return data


def _still_starting(profile: Printer, reported: set[str]) -> list[str]:
    """Return starting values that the printer hasn't reported, whole or in part."""
    left = []
    for name in profile.starting_values:
        value = getattr(profile, name.partition(".")[0])
        parts = [] if "." in name else list(getattr(type(value), "model_fields", {}))
        missing = [f"{name}.{part}" for part in parts if f"{name}.{part}" not in reported]
        if parts and len(missing) < len(parts):
            left += missing
        elif name not in reported and (missing or not parts):
            left.append(name)
    return left
