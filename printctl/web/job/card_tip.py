"""Tip line of the Job page: tip position against the job's start, with a button to move there."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from printctl.web.controls import Principal
from printctl.web.job.layout import live, quiet_button, run_or_explain
from printctl.web.job.machine import AGREES_MM, Machine
from printctl.web.job.service import JobService
from printctl.web.job.to_start import Place


def add_tip(
    service: JobService,
    who: Principal,
    job: str,
    machine: Machine,
    start: Callable[[], Place],
    on_its_way: Callable[[bool], object],
) -> None:
    """A line that says where the tip stands, and the button beside it.

    ``on_its_way`` is told when the tip sets out, and when it has arrived or was refused.
    """
    with ui.row().classes("items-center gap-2 w-full"):
        tip_line = live().classes("text-sm")
        tip_line.set_text(standing(machine, start()))

        async def go() -> None:
            tip_line.set_text("The tip is on its way: up, over, down …")
            move.disable()
            on_its_way(True)
            tip, problem = await run_or_explain(service.to_start, who, job, start())
            move.enable()
            on_its_way(False)
            tip_line.set_text(problem or standing(tip, start()))

        move = quiet_button("Move the tip to the start", go)


def standing(machine: Machine, start: Place) -> str:
    """Where the tip stands, in words."""
    if machine.tip_mm is None:
        return "Nobody knows where the tip stands; see the page Printer."
    if max(abs(a - b) for a, b in zip(machine.tip_mm, start, strict=True)) <= AGREES_MM:
        return "The tip stands at the start."
    there = ", ".join(f"{axis} {mm:.2f}" for axis, mm in zip("XYZ", machine.tip_mm, strict=True))
    return f"The tip stands at {there} mm, not at the start."
