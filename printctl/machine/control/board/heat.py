"""Heater targets: read them (M105), compare with this print's own, take back what others raised."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from printctl.checks.gate import AllowedLine, LineOrigin, PrinterSituation, judge
from printctl.machine.control.board.channel import Channel
from printctl.machine.control.board.steps import Steps
from printctl.machine.errors import HandshakeError

WARM_ROOM_C: Final = 35.0
"""Up to it a reading may be the room's own: no heater that is switched off makes it colder."""
WITHIN_C: Final = 0.6
"""Between a target that was set and the one that is reported: some firmwares round it."""
_READING: Final = re.compile(
    rb"(?<![\w@])([TBC])(\d*): ?(-?\d+(?:\.\d+)?)(?: ?/ ?(-?\d+(?:\.\d+)?))?"
)
_TARGET_CODES: Final = {"nozzle": "M104", "bed": "M140", "chamber": "M141"}


@dataclass(frozen=True)
class Temperature:
    """One heater or sensor, °C.

    ``name``: nozzle (the ink's), nozzle 1 and so on of several heads, bed, chamber.
    """

    name: str
    now_c: float
    target_c: float | None = None  # None where the firmware tells none; 0 is off


def parse_temperatures(replies: Sequence[bytes]) -> tuple[Temperature, ...]:
    """Read a reply to M105; empty where none is in it.

    Marlin tells the nozzle in use as T, and of several each as T0, T1 too, which then count;
    Klipper tells T0 alone.
    """
    temperatures: dict[str, Temperature] = {}
    for text in replies:
        for letter, number, now, target in _READING.findall(text):
            name = {b"T": "nozzle", b"B": "bed", b"C": "chamber"}[letter]
            if letter == b"T" and number and int(number):
                name = f"nozzle {int(number)}"
            if number or name not in temperatures:
                target_c = float(target) if target else None
                temperatures[name] = Temperature(name, float(now), target_c)
    return tuple(temperatures.values())


def target_command(name: str, celsius: float) -> str:
    """Return the command that sets a heater's target without waiting for it."""
    kind, _, number = name.partition(" ")
    head = f" T{number}" if number else ""
    return f"{_TARGET_CODES[kind]}{head} S{celsius:g}"


class HeatCheck:
    """Finds targets that neither the job nor its operator has set.

    Of several nozzles none is looked at: a command without a number sets the one in use.
    """

    def __init__(self, channel: Channel) -> None:
        self._channel, self._logbook = channel, channel.logbook
        self._targets: dict[str, float] = {}
        self._read = 0

    def begin(self) -> Steps[None]:
        """Take the targets as they are before the job's first line.

        Raise `HandshakeError` for a heater that is, or is set, hotter than this print bears.
        """
        before = self._logbook.fault
        first = yield from self._ask_targets(journalled=False)
        on = {heater: celsius for heater, celsius in first.items() if celsius > 0}
        off = {heater: celsius for heater, celsius in first.items() if celsius == 0}
        self._targets = off | (yield from self._confirmed(on, journalled=False))
        yield from self._refuse_heat()
        self._logbook.excuse(before)  # a firmware without heaters may not know the question
        self._record()

    def _refuse_heat(self) -> Steps[None]:
        """Refuse what a second reading confirms; what the job itself heats to is preflight's."""
        hottest: dict[str, str] = {}
        own = self._job_targets(self._logbook.progress.job.lines)
        for _ in range(2):
            readings = parse_temperatures((yield from self._channel.ask(b"M105")))
            seen: dict[str, str] = {}
            for one in readings:
                limit = self._channel.wiring.limits().hottest(one.name)
                bears = max(limit.celsius, *own.get(one.name, [limit.celsius]))
                above = f", above {bears:g} °C ({limit.why})"
                if one.now_c > max(bears, WARM_ROOM_C) + WITHIN_C:
                    seen[one.name] = f"the {one.name} is at {one.now_c:g} °C{above}"
                elif one.target_c is not None and one.target_c > bears and one.name not in own:
                    seen[one.name] = f"the {one.name} is set to {one.target_c:g} °C{above}"
            hottest = {k: v for k, v in seen.items() if not hottest or k in hottest}
            if not hottest:
                return
        raise HandshakeError(
            f"{'; '.join(hottest.values())}: nothing was moved. Switch it off, let it cool down, "
            "and start again"
        )

    def restore(self, targets: Mapping[str, float], read: int) -> None:
        """Take the targets that this print had set after ``read`` lines, from its journal."""
        self._targets, self._read = dict(targets), read

    def targets(self) -> dict[str, float]:
        """Return what this print has set, °C by heater; the job's own lines included."""
        self._read_job()
        return dict(self._targets)

    def set_by_hand(self, allowed: AllowedLine) -> None:
        """Record a target that a person has set in the print."""
        if allowed.heater and self._targets:
            self._read_job()
            self._targets[allowed.heater] = allowed.celsius
            self._record()

    def take_back(self) -> Steps[None]:
        """Set anew what others have raised; report it, and heaters that went off."""
        if not self._targets:
            return
        self._read_job()
        targets = yield from self._ask_targets(journalled=True)
        others = {
            heater: celsius
            for heater, celsius in targets.items()
            if abs(celsius - self._targets.get(heater, celsius)) > WITHIN_C
        }
        for heater, celsius in (yield from self._confirmed(others, journalled=True)).items():
            wanted = self._targets[heater]
            self._targets[heater] = min(celsius, wanted)
            words = f"the {heater} is set to {celsius:g} °C, but this print had set {wanted:g} °C: "
            if celsius < wanted:
                self._logbook.alarm(
                    f"{words}changed by the firmware or another program; left as it is"
                )
                continue
            command = target_command(heater, wanted)
            self._logbook.alarm(f"{words}changed by another program; reverted ({command})")
            yield from self._channel.command(command.encode("ascii"))

    def _ask_targets(self, journalled: bool) -> Steps[dict[str, float]]:
        """Return targets by heater, °C; empty where the firmware tells none."""
        readings = parse_temperatures((yield from self._channel.command(b"M105", journalled)))
        targets = {one.name: one.target_c for one in readings if one.target_c is not None}
        several = self._channel.wiring.printer.tool_count > 1
        return {k: v for k, v in targets.items() if not (several and k.startswith("nozzle"))}

    def _confirmed(self, targets: Mapping[str, float], journalled: bool) -> Steps[dict[str, float]]:
        """Return those that a second answer agrees on: no checksum guards the first."""
        again = (yield from self._ask_targets(journalled)) if targets else {}
        return {
            heater: celsius for heater, celsius in targets.items() if again.get(heater) == celsius
        }

    def _record(self) -> None:
        self._logbook.record("heat", targets=dict(self._targets), line=self._read)

    def _read_job(self) -> None:
        """Take the targets that the job's own lines have set since they were last read."""
        taken = self._logbook.progress.taken
        for heater, targets in self._job_targets(taken[self._read :]).items():
            self._targets[heater] = targets[-1]
        self._read = len(taken)

    def _job_targets(self, lines: Sequence[bytes]) -> dict[str, list[float]]:
        """Return each target that lines of the job set, °C, by heater."""
        targets: dict[str, list[float]] = {}
        known = PrinterSituation.of_job(self._channel.wiring.printer)
        for line in lines:
            if not line.startswith((b"G0", b"G1")):
                verdict = judge(line.decode("ascii", "replace"), LineOrigin.JOB, known)
                if isinstance(verdict, AllowedLine) and verdict.heater:
                    targets.setdefault(verdict.heater, []).append(verdict.celsius)
        return targets
