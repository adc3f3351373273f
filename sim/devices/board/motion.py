"""Motors of the simulated board, their planner, and the G-code modal state.

No clock here: functions that depend on the time get it as a parameter, s.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from firmware_profiles import Printer, Span
from firmware_profiles.families import family_of
from gcode.motion.block import to_steps
from gcode.motion.executed import ExecutedMotion, executed_motion
from gcode.motion.planner import (
    add_move,
    command_time,
    count_steps,
    next_event,
    run_until,
    set_axis,
    stop_now,
    take_head,
)
from gcode.motion.state import LOG, new_planner, new_ring
from gcode.program.modal import new_modal

_FIRST_LOG: Final = 4096
_OUTLASTS_POWER: Final = ("physical", "plungers", "first_pulse", "logged", "merged", "run_end")


class Motion:
    """Modal state, planner, stepper and the log of what moved.

    Parameters
    ----------
    start_mm : tuple, mm
        Where the tip stands, and where the firmware believes it at power-up.
    costs : (5,) float64
        Of the processor, see `gcode.motion.planner.command_time`.

    Attributes
    ----------
    modal, planner, ring, log : records
        See `gcode.program.modal` and `gcode.motion.state`.
    tool_offset : (heads, 3) float64, mm
        As commanded (M218, G10).
    closed_until : float, s
        Before it the planner takes no moves.
    slope : float
        By how much bed levelling lifts Z along X, mm for each mm; 0 where it is off.
    """

    def __init__(
        self, printer: Printer, start_mm: tuple[float, float, float], costs: np.ndarray[Any, Any]
    ) -> None:
        self._printer, self._start_mm = printer, start_mm
        self.costs = costs
        self.ring = new_ring(printer)
        self.log = np.zeros(_FIRST_LOG, LOG)
        self.planner = new_planner(printer, start_mm)
        self._steps = np.zeros(4, np.int64)
        self.power_up()

    def power_up(self) -> None:
        """Forget all but the motors' true places and the log."""
        printer = self._printer
        fresh = new_planner(printer, self._start_mm)
        for name in _OUTLASTS_POWER:
            fresh[name] = self.planner[name]
        fresh["plungers"][0, self.tool] = self.planner["physical"][0, 3]
        fresh["physical"][0, 3] = fresh["plungers"][0, 0]
        fresh["shift"] = fresh["physical"] - fresh["position"]
        self.planner[:] = fresh
        rule = family_of(printer).grammar.e_rule
        self.modal = new_modal(self._start_mm, printer.tool_count, rule)
        self.tool_offset = np.zeros((printer.tool_count, 3))
        self.slope = 0.0
        spans: tuple[Span, ...] = (printer.x_mm, printer.y_mm, printer.z_mm)
        self.modal["low"] = [span.low for span in spans]
        self.modal["high"] = [span.high for span in spans]
        self.closed_until = 0.0

    @property
    def state(self) -> Any:
        """The planner's record."""
        return self.planner[0]

    @property
    def blocks(self) -> int:
        """Blocks in the ring, the running one too."""
        return int(self.planner["count"][0])

    @property
    def tool(self) -> int:
        """The head that E moves."""
        return int(self.planner["tool"][0])

    def run_until(self, now: float) -> None:
        """Let the motors run until ``now``, s."""
        self._make_room()
        run_until(self.planner, self.ring, self.log, now)

    def _make_room(self) -> None:
        """Lengthen the log where it might not hold all blocks of the ring."""
        if int(self.planner["logged"][0]) + 2 * len(self.ring) > len(self.log):
            self.log = np.concatenate([self.log, np.zeros_like(self.log)])

    def next_event(self) -> float:
        """When the stepper next ends or takes a block, s."""
        return float(next_event(self.planner))

    def command_s(self, now: float) -> float:
        """Processor's time for a command at ``now``, s."""
        return float(command_time(self.planner, self.ring, now, self.costs))

    def writes(self, target_mm: Any) -> bool:
        """Whether a move to ``target_mm`` turns the plunger's motor."""
        end = to_steps(target_mm[3], self.state["steps_per_mm"][3])
        return bool(end != self.state["position"][3])

    def add_move(self, target_mm: Any, feed: float, line: int, now: float) -> None:
        """Put a straight move into the ring, which must have a place; none while it is closed."""
        if self.slope:
            target_mm = target_mm + np.array([0.0, 0.0, self.slope * target_mm[0], 0.0])
        if now >= self.closed_until:
            add_move(self.planner, self.ring, target_mm, feed, line, now)

    def steps_at(self, now: float) -> list[int]:
        """Stepper counts at ``now``, s, as the firmware numbers them."""
        self.run_until(now)
        count_steps(self.planner, self.ring, now, self._steps)
        return [int(v) for v in self._steps - self.planner["shift"][0]]

    def events(self, now: float) -> int:
        """Step events up to ``now``, s: of each block the steps of its quickest motor."""
        self.run_until(now)
        log = self.log[: int(self.planner["logged"][0])]
        ended = np.abs(log["end"] - log["start"]).max(axis=1).sum() if len(log) else 0
        return int(ended) + int(count_steps(self.planner, self.ring, now, self._steps))

    def stop(self, now: float) -> None:
        """Drop all moves; the firmware's position becomes where the motors stand."""
        self._make_room()
        stop_now(self.planner, self.ring, self.log, now)
        native = self.planner["position"][0] / self.planner["steps_per_mm"][0].astype(float)
        native[2] -= self.slope * native[0]
        self.modal["plunger_shift"] += self.modal["position"][0, 3] - native[3]
        self.modal["position"] = native

    def stand_at(self, axis: int, position_mm: float) -> None:
        """Call where an axis stands ``position_mm``, as homing does that finds its switch."""
        set_axis(self.planner, axis, position_mm)
        self.modal["position"][0, axis] = position_mm

    def level(self, slope: float) -> None:
        """Have Z rise along X by ``slope`` from now on; the place's name changes with it."""
        place = self.modal["position"][0]
        place[2] += (self.slope - slope) * place[0]
        self.slope = slope

    def count_anew(self) -> None:
        """Count where the last block ends in the steps/mm as they are now; no motor moves."""
        state = self.state
        state["mm_per_step"] = np.float32(1) / state["steps_per_mm"]
        for axis in range(4):
            set_axis(self.planner, axis, float(self.modal["position"][0, axis]))

    def set_plunger(self, position_mm: float) -> None:
        """Call the plunger's planned position ``position_mm``."""
        set_axis(self.planner, 3, position_mm)

    def set_flow(self, area_mm2: float) -> None:
        """Give the planner what the flow's percentage and E's area make of a length of E."""
        self.planner["flow"] = float(self.modal["flow_percent"][0]) * 0.01 / area_mm2

    def use_head(self, number: int, now: float) -> None:
        """Have E move that head's plunger from ``now`` on, s; the motors stand."""
        self.run_until(now)
        take_head(self.planner, number, float(self.modal["position"][0, 3]))

    def executed(self, now: float) -> ExecutedMotion:
        """Blocks that ran up to ``now``, s."""
        self.run_until(now)
        return executed_motion(self.log[: int(self.planner["logged"][0])], self._printer)
