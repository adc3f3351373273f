"""Read checklists; warm the bath slowly; compute the safe flushing pressure."""

from __future__ import annotations

import csv
import threading
import time
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import yaml

from firmware_profiles import Bath
from printctl.machine.link.errors import LinkError
from printctl.web.errors import ConflictError
from printctl.web.job.machine import Printing

_EVERY_S: Final = 2.0
_FILE: Final = Path(__file__).with_name("checklist.yaml")


@lru_cache(maxsize=1)
def checklist() -> dict[str, Any]:
    """The lists before and after a print, and starting values."""
    steps: dict[str, Any] = yaml.safe_load(_FILE.read_text(encoding="utf-8"))
    return steps


def steps_for(bath: Bath | None) -> list[dict[str, str]]:
    """Steps after a print; those that the bath has no use for are left out."""
    return [
        {"id": step["id"], "text": step["text"]}
        for step in checklist()["after"]
        if bath is None or "needs" not in step or getattr(bath, step["needs"]) is not None
    ]


@dataclass(frozen=True)
class FlushLimit:
    """How hard the channels may be flushed.

    Attributes
    ----------
    pressure_pa : float, Pa
        Between inlet and outlet.
    wall_shear_pa : float, Pa
        That is allowed at the wall of the vessel that is sheared most.
    vessel : str
        That vessel.
    """

    pressure_pa: float
    wall_shear_pa: float
    vessel: str

    def to_dict(self) -> dict[str, Any]:
        """As a JSON object."""
        return asdict(self)


def flush_limit(flow_csv: Path, wall_shear_pa: float) -> FlushLimit | None:
    """Pressure at which the run's steady flow shears no wall more than allowed.

    Flow, pressure and wall shear of a Newtonian fluid in open, round channels grow together
    (Poiseuille), so the solved ones are scaled. None where the run solved no flow.

    Parameters
    ----------
    flow_csv : Path
        Table of the stage ``flow``.
    wall_shear_pa : float, Pa
    """
    try:
        with flow_csv.open(encoding="utf-8", newline="") as handle:
            rows = list(csv.DictReader(handle))
        shear = [abs(float(row["wall_shear_pa"])) for row in rows]
        pressures = [float(row[k]) for row in rows for k in ("pressure_in_pa", "pressure_out_pa")]
    except (OSError, KeyError, ValueError):
        return None
    if not shear or max(shear) <= 0:
        return None
    worst = max(range(len(rows)), key=shear.__getitem__)
    drop = max(pressures) - min(pressures)
    name = rows[worst].get("vessel", "")
    return FlushLimit(drop * wall_shear_pa / shear[worst], wall_shear_pa, str(name))


class Ramp:
    """Warms one heater at a rate; at its end, or let go of, the heater keeps its target.

    Parameters
    ----------
    printing : Printing
    heater : str
    target_c : float, °C
    rate_c_min : float, °C/min

    Raises
    ------
    ConflictError
        When the printer has no such heater.
    """

    def __init__(self, printing: Printing, heater: str, target_c: float, rate_c_min: float) -> None:
        there = printing.temperatures()
        if heater not in there:
            raise ConflictError(
                f"there is no heater {heater!r} (there is {', '.join(there) or 'none'}); connect "
                "the printer, or warm the bath by hand"
            )
        self.heater, self.target_c, self.rate_c_min = heater, target_c, rate_c_min
        self._printing = printing
        self._from_c, self._since = there[heater][0], time.monotonic()
        self._ended = threading.Event()
        self.message = "warming"
        self._thread = threading.Thread(target=self._work, name="ramp", daemon=True)
        self._thread.start()

    def end(self) -> None:
        """Stop raising the target."""
        self._ended.set()
        self._thread.join(5.0)

    @property
    def going_on(self) -> bool:
        """Whether the target is still being raised."""
        return self._thread.is_alive()

    def to_dict(self) -> dict[str, Any]:
        """As a JSON object, with what the heater has now."""
        now_c, set_c = self._printing.temperatures().get(self.heater, (None, None))
        return {
            "heater": self.heater,
            "target_c": self.target_c,
            "rate_c_min": self.rate_c_min,
            "now_c": now_c,
            "set_c": set_c,
            "going_on": self.going_on,
            "message": self.message,
        }

    def _work(self) -> None:
        while not self._ended.is_set():
            wanted = ramped_c(
                self._from_c, self.target_c, self.rate_c_min, time.monotonic() - self._since
            )
            try:
                self._printing.heat(self.heater, round(wanted, 1))
            except (LinkError, ConflictError) as exc:
                self.message = f"given up: {exc}"
                return
            if wanted == self.target_c:
                self.message = "the target is set"
                return
            self._ended.wait(_EVERY_S)
        self.message = "let go of; the heater keeps its target"


def ramped_c(from_c: float, target_c: float, rate_c_min: float, seconds: float) -> float:
    """Where a ramp stands after so many seconds, °C; it never goes beyond its target."""
    way = rate_c_min * seconds / 60.0
    if target_c >= from_c:
        return min(from_c + way, target_c)
    return max(from_c - way, target_c)
