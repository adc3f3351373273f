"""Timed events of a simulated board: heater faults, busy messages, reports, idle timeout."""

from __future__ import annotations

from sim.devices.board.controller import Controller


class Alarms:
    """Heaters' faults, busy messages, reports and the idle limit.

    Parameters
    ----------
    board : Controller
    """

    def __init__(self, board: Controller) -> None:
        self._board = board

    def next_s(self) -> float:
        """When the main loop next has something to say or do of its own, s."""
        machine, work = self._board.machine, self._board.work
        reports = machine.reports
        soon = min(reports.temperature_at, reports.position_at, machine.heat.alarm().at)
        soon = min(soon, self._board.plan.next_s)
        if work.tasks:
            soon = min(soon, work.busy_at)
        if machine.idle_limit_s > 0:
            soon = min(soon, self._idle_deadline())
        return soon

    def _idle_deadline(self) -> float:
        machine, motion = self._board.machine, self._board.machine.motion
        # It watches over the host, whose signs of life come by a clock that nothing speeds up.
        limit_s = machine.idle_limit_s * (1.0 if self._board.work.tasks else machine.host_pace)
        if motion.blocks:
            return max(motion.next_event(), machine.now) + limit_s
        return max(machine.idle_since, float(motion.planner["run_end"][0])) + limit_s

    def sound(self) -> None:
        """Say and do all that is due now."""
        board, machine, work = self._board, self._board.machine, self._board.work
        firmware, reports = board.firmware, machine.reports
        now = machine.now
        heat = machine.heat.alarm()
        if now >= heat.at:
            firmware.fail_heat(heat.fault)
            return
        if work.tasks and now >= work.busy_at:
            firmware.say_busy(work.tasks[-1][1])
            work.busy_at = now + reports.keepalive_s
        if now >= reports.temperature_at:
            firmware.report_temperatures()
            reports.temperature_at += reports.temperature_s
        if now >= reports.position_at:
            firmware.report_position()
            reports.position_at += reports.position_s
        if machine.idle_limit_s > 0 and now >= self._idle_deadline():
            firmware.idle_is_over()
