"""Heaters' targets: which heater a line sets, and whether what is mounted bears it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from firmware_profiles.families.gate_facts import HeatNamed
from printctl.gate.known import Known
from printctl.gate.verdict import Act, Allowed, NotAllowed
from sim.reading import GcodeLine

HEATERS: Final = {
    "M104": "nozzle",
    "M109": "nozzle",
    "M140": "bed",
    "M190": "bed",
    "M141": "chamber",
    "M191": "chamber",
}
_KINDS: Final = frozenset({"nozzle", "bed", "chamber"})


def check_heat(known: Known, heater: str, celsius: float) -> None:
    """Refuse a heater that the printer hasn't, and a target too hot for what is mounted.

    Raises
    ------
    NotAllowed
    """
    if celsius == 0 and heater.partition(" ")[0] in _KINDS:
        return  # off is always right
    if known.heaters is not None and heater not in known.heaters:
        told = ", ".join(known.heaters) or "none"
        raise NotAllowed(f"this printer tells of no {heater!r}, only of {told}")
    limit = known.hottest(heater)
    if not 0 <= celsius <= limit.celsius:
        raise NotAllowed(
            f"{celsius:g} °C for the {heater} is outside 0 to {limit.celsius:g} °C ({limit.why})"
        )


def set_target(line: GcodeLine, known: Known) -> Allowed:
    """Judge a line that sets a target by S and doesn't wait.

    Raises
    ------
    NotAllowed
    """
    celsius = line.number("S")
    if celsius is None or set(line.words) - {"S", "T"}:
        raise NotAllowed("say the target as S and a number of °C")
    heater = _heater(line)
    check_heat(known, heater, celsius)
    return Allowed(line.text.decode("ascii"), Act.HEAT, heater=heater, celsius=celsius)


def wait_for(line: GcodeLine, known: Known) -> Allowed:
    """Judge a line of a job that sets a target, by S or R, and may wait for it.

    Raises
    ------
    NotAllowed
    """
    for letter in "SR":
        celsius = line.number(letter)
        if celsius is not None:
            check_heat(known, _heater(line), celsius)
    if set(line.words) - {"S", "R", "T"}:
        raise NotAllowed("only S or R (°C) and T (head) are looked at; take the rest out")
    return Allowed(line.text.decode("ascii"))


@dataclass(frozen=True, eq=False)
class NamedTarget:
    """Judge of commands that set, or wait for, the target of a heater told by its name."""

    facts: HeatNamed

    def __call__(self, line: GcodeLine, known: Known) -> Allowed:
        """Judge a line.

        Raises
        ------
        NotAllowed
        """
        heater = self._heater(line)
        for key in self.facts.targets:
            if key in line.parameters:
                check_heat(known, heater, _number(line.parameters[key], key))
        return Allowed(line.text.decode("ascii"))

    def _heater(self, line: GcodeLine) -> str:
        facts = self.facts
        name = next((line.parameters[key] for key in facts.keys if key in line.parameters), "")
        number = name.removeprefix(facts.numbered)
        if name in facts.heaters:
            return facts.heaters[name]
        if name.startswith(facts.numbered) and number.isdigit():
            return f"nozzle {int(number)}"
        raise NotAllowed(f"{name or 'no heater'} is neither {' nor '.join(facts.heaters)}")


def _number(text: str, key: str) -> float:
    try:
        value = float(text)
    except ValueError as exc:
        raise NotAllowed(f"{key}={text} is no number of °C") from exc
    return value


def _heater(line: GcodeLine) -> str:
    head = line.number("T")
    return HEATERS[line.code] + (f" {head:.0f}" if head else "")
