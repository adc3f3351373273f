"""List the five pages (printer, job, design, scan, history): services, routers, registration."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from typing import Final

from fastapi import APIRouter

from printctl.web.core import Core
from printctl.web.design.routes import routers as design_routers
from printctl.web.design.service import DesignService
from printctl.web.history.routes import router as history_router
from printctl.web.history.service import HistoryService
from printctl.web.job.routes import routers as job_routers
from printctl.web.job.service import JobService
from printctl.web.printer.routes import router as printer_router
from printctl.web.printer.service import PrinterService
from printctl.web.scan.routes import router as scan_router
from printctl.web.scan.service import ScanService

ROOMS: Final = ("printer", "job", "design", "scan", "history")


@dataclass(frozen=True)
class Services:
    """Services of all pages."""

    printer: PrinterService
    job: JobService
    design: DesignService
    scan: ScanService
    history: HistoryService

    def close(self) -> None:
        """Follow no printer any more; prints and stations go on."""
        self.printer.close()
        self.job.close()


def make_services(core: Core) -> Services:
    """Make the service of each room."""
    return Services(
        printer=PrinterService(core),
        job=JobService(core),
        design=DesignService(core),
        scan=ScanService(core),
        history=HistoryService(core),
    )


def routers(services: Services) -> list[APIRouter]:
    """The rooms' parts of the API."""
    return [
        printer_router(services.printer),
        *job_routers(services.job),
        *design_routers(services.design),
        scan_router(services.scan),
        history_router(services.history),
    ]


def register_pages(services: Services) -> None:
    """Define the rooms' pages; their modules load NiceGUI, so they are imported here."""
    for room in ROOMS:
        if find_spec(f"printctl.web.{room}.page"):
            import_module(f"printctl.web.{room}.page").register(getattr(services, room))
