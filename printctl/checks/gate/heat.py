"""Allow or refuse a G-code line that sets a heater, by the mounted materials' limits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from firmware_profiles.families.family import CheckNamedHeater
from gcode.reading import GcodeLine
from printctl.checks.gate.inputs import AllowedLine, LineAction, NotAllowed, PrinterSituation

HEATERS: Final = {
    "M104": "nozzle",
    "M109": "nozzle",
    "M140": "bed",
    "M190": "bed",
    "M141": "chamber",
    "M191": "chamber",
}
_KINDS: Final = frozenset({"nozzle", "bed", "chamber"})


def check_heat(known: PrinterSituation, heater: str, celsius: float) -> None:
    """Refuse a heater that the printer hasn't, and a target too hot for what is mounted.

    Raises
    ------
    NotAllowed
    """
    if celsius == 0 and heater.partition(" ")[0] in _KINDS:
        return  # off is always right
    if known.heaters is not None and heater not in known.heaters:
        names = ", ".join(known.heaters) or "none"
        raise NotAllowed(f"this printer tells of no {heater!r}, only of {names}")
    limit = known.hottest(heater)
    if not 0 <= celsius <= limit.celsius:
        raise NotAllowed(
            f"{celsius:g} °C for the {heater} is outside 0 to {limit.celsius:g} °C ({limit.why})"
        )


def set_target(line: GcodeLine, known: PrinterSituation) -> AllowedLine:
    """Judge a line that sets a target by S and doesn't wait.

    Raises
    ------
    NotAllowed
    """
    celsius = line.number("S")
    if celsius is None or set(line.words) - {"S", "T"}:
        raise NotAllowed("say the target as S and a number of °C")
    heater = _heater(line, known)
    check_heat(known, heater, celsius)
    return AllowedLine(line.text.decode("ascii"), LineAction.HEAT, heater=heater, celsius=celsius)


def wait_for(line: GcodeLine, known: PrinterSituation) -> AllowedLine:
    """Judge a line of a job that sets a target, by S or R, and may wait for it.

    Raises
    ------
    NotAllowed
    """
    if set(line.words) - {"S", "R", "T"}:
        raise NotAllowed("only S or R (°C) and T (head) are looked at; take the rest out")
    targets = [line.number(letter) for letter in "SR" if letter in line.words]
    if not targets or None in targets:
        raise NotAllowed("it names no target, and firmwares differ then; say S or R and °C")
    heater = _heater(line, known)
    for celsius in targets:
        check_heat(known, heater, celsius or 0.0)
    return AllowedLine(line.text.decode("ascii"), heater=heater, celsius=targets[0] or 0.0)


@dataclass(frozen=True, eq=False)
class NamedTarget:
    """Judge of commands that set, or wait for, the target of a heater told by its name."""

    facts: CheckNamedHeater

    def __call__(self, line: GcodeLine, known: PrinterSituation) -> AllowedLine:
        """Judge a line.

        Raises
        ------
        NotAllowed
        """
        facts, given = self.facts, line.parameters
        if unknown := set(given) - {facts.key, *facts.targets}:
            raise NotAllowed(f"it takes no {', '.join(sorted(unknown))}; {self._form}")
        heater = self._heater(line, known)
        targets = [_number(given[key], key) for key in facts.targets if key in given]
        if not targets:
            raise NotAllowed(f"it names no temperature; {self._form}")
        if targets != sorted(targets):
            raise NotAllowed(f"{' to '.join(f'{one:g}' for one in targets)} °C is no range")
        for celsius in targets:
            check_heat(known, heater, celsius)
        text = line.text.decode("ascii")
        if len(facts.targets) > 1:  # a range, which is waited for and not set
            return AllowedLine(text)
        return AllowedLine(text, heater=heater, celsius=targets[0])

    @property
    def _form(self) -> str:
        facts = self.facts
        return f"say {facts.key}=NAME and {' or '.join(f'{key}=°C' for key in facts.targets)}"

    def _heater(self, line: GcodeLine, known: PrinterSituation) -> str:
        facts = self.facts
        name = line.parameters.get(facts.key, "")
        number = name.removeprefix(facts.numbered)
        if name in facts.heaters:
            return facts.heaters[name]
        if name.startswith(facts.numbered) and number.isdigit():
            if not 0 < int(number) < known.printer.tool_count:
                raise _no_head(name, known)
            return f"nozzle {int(number)}"
        raise NotAllowed(f"{name or 'no heater'} is neither {' nor '.join(facts.heaters)}")


def _number(text: str, key: str) -> float:
    try:
        value = float(text)
    except ValueError as exc:
        raise NotAllowed(f"{key}={text} is no number of °C") from exc
    if not math.isfinite(value):
        raise NotAllowed(f"{key}={text} is no number of °C")
    return value


def _heater(line: GcodeLine, known: PrinterSituation) -> str:
    kind, head = HEATERS[line.code], line.words.get("T", 0.0)
    if "T" in line.words and kind != "nozzle":
        raise NotAllowed(f"T names a head, and {line.code} heats the {kind}; take T out")
    if head not in range(known.printer.tool_count):
        raise _no_head("T" if head is None else f"T{head:g}", known)
    return kind + (f" {head:.0f}" if head else "")


def _no_head(name: str, known: PrinterSituation) -> NotAllowed:
    """Say which heads the machine has."""
    printer = known.printer
    heads = "one head, T0" if printer.tool_count == 1 else f"T0 to T{printer.tool_count - 1}"
    return NotAllowed(f"{name} is no head of {printer.name}, which has {heads} (profile: heads)")
