"""Make tab of the Design page: start or cancel a run, follow it, continue after the print."""

from __future__ import annotations

from nicegui import ui

from printctl.pipeline.run_options import TOOLPATH_NAMES
from printctl.web.design.run_processes import RunProgress
from printctl.web.design.run_processes.runs import LAST_STAGE
from printctl.web.design.service import DesignService
from printctl.web.design.widgets.editor import Editor
from printctl.web.design.widgets.in_thread import run_in_thread
from printctl.web.shell.run_or_notify import run_or_notify

_WORDS = {
    "never": "not made yet",
    "starting": "starting",
    "running": "being made",
    "done": "made",
    "failed": "failed",
    "interrupted": "broken off",
}
_MARKS = {"waiting": "·", "running": "▸", "done": "✓", "failed": "✕"}


class MakeTab:
    """Starts, follows and cancels the run of the recipe that is edited."""

    def __init__(self, service: DesignService, editor: Editor) -> None:
        self._service, self._editor = service, editor
        self._shown: RunProgress | None = None
        with ui.row().classes("w-full items-center gap-2"):
            self._make = ui.button("Make the design", on_click=self._start)
            names = {name: name for name in TOOLPATH_NAMES}
            self._until = ui.select(names, label="As far as", value=LAST_STAGE)
            self._until.props("outlined dense").classes("pc-until")
            self._cancel = ui.button("Cancel", on_click=self._stop).props("outline")
            ui.space()
            self._continue = ui.button(
                "Continue after the print: scan, register, report", on_click=self._go_on
            ).props("outline")
        self._state = ui.label().classes("pc-state-line").props("role=status")
        self._message = ui.label().classes("pc-message")
        self._stages = ui.column().classes("w-full gap-1")
        with ui.row().classes("gap-4"):
            self._to_job = ui.link("Print it in the Job room", "/job")
            self._to_look = ui.link("See the files of this run", "/design")
        ui.timer(1.0, self._refresh)

    async def _start(self) -> None:
        await run_or_notify(self._service.runs.start, self._editor.name, self._until.value)
        await self._refresh()

    async def _go_on(self) -> None:
        await run_or_notify(self._service.runs.go_on, self._editor.name)
        await self._refresh()

    async def _stop(self) -> None:
        await run_or_notify(self._service.runs.cancel, self._editor.name)
        await self._refresh()

    async def _refresh(self) -> None:
        name = self._editor.name
        if not name:
            return
        now, printed = await run_in_thread(self._look, name)
        self._make.set_enabled(not now.going_on and not self._editor.problems)
        self._cancel.set_enabled(now.going_on)
        self._continue.set_enabled(not now.going_on and printed == "done")
        if now != self._shown:
            self._shown = now
            self._show(now)

    def _look(self, name: str) -> tuple[RunProgress, str]:
        progress = self._service.runs.progress(name)
        return progress, "" if progress.going_on else self._service.runs.print_state(name)

    def _show(self, now: RunProgress) -> None:
        far = f" as far as {now.until}" if now.until and now.state == "done" else ""
        self._state.text = f"{now.name}: {_WORDS[now.state]}{far}"
        self._message.text = now.message
        has_job = now.state == "done" and now.until in (LAST_STAGE, "dry run", "toolpath")
        self._to_job.visible = has_job
        self._to_job.props(f'href="/job?job=run~{now.name}"')
        self._to_look.props(f'href="/design?recipe={now.name}&tab=look"')
        self._to_look.visible = now.state == "done"
        self._stages.clear()
        with self._stages:
            for stage in now.stages:
                with ui.row().classes("w-full items-center no-wrap pc-stage"):
                    ui.label(f"{_MARKS[stage.state]} {stage.name}").classes("pc-stage-name")
                    bar = ui.linear_progress(stage.fraction, show_value=False)
                    bar.props(f'aria-label="{stage.name}"').classes("pc-stage-bar")
                    ui.label(f"{stage.state}: {stage.note}" if stage.note else stage.state).classes(
                        "pc-stage-note"
                    )
                for remark in stage.remarks:
                    ui.label(remark).classes("pc-quiet pc-remark")
