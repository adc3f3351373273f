"""REST routes for calibrations: list, write a test, fit readings, save a measured profile."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from fastapi import APIRouter, Request

from printctl.web.controls import Principal
from printctl.web.printer import models as m
from printctl.web.printer.calibration_requests import CalibrationFiles, CalibrationRequest, Read
from printctl.web.printer.service import PrinterService


def add_calibration(
    routes: APIRouter, service: PrinterService, who: Callable[[Request], Principal]
) -> None:
    """Add them."""
    calibrating = service.calibrating

    @routes.get("/calibrations", summary="Calibrations, and what each needs")
    def listed() -> list[dict[str, Any]]:
        return [asdict(wizard) for wizard in calibrating.wizards]

    @routes.post("/calibrations/{name}/job", summary="Write a test into the workspace's jobs")
    def make(name: str, body: CalibrationRequest, request: Request) -> CalibrationFiles:
        return calibrating.make(who(request), name, body)

    @routes.post("/calibrations/{name}/fit", summary="What readings say")
    def fit(name: str, body: Read) -> m.FittedConstants:
        result = calibrating.fit(name, body)
        estimates = {key: asdict(one) for key, one in result.lines.items()}
        return m.FittedConstants(estimates=estimates, notes=result.notes)

    @routes.post("/calibrations/weigh/profile", summary="Write a measured copy of a profile")
    def save(body: m.Save, request: Request) -> m.ActionResult:
        message = calibrating.save(who(request), body.read, body.mend, body.copy_name)
        return m.ActionResult(message=message)
