"""Declare a new syringe or needle to the station; purge bubbles in small, limited steps."""

from __future__ import annotations

import threading
from typing import Final

from firmware_profiles import Ink, Needle, Syringe
from printctl.machine.station import StationStatus
from printctl.web.controls import Principal
from printctl.web.errors import BadRequestError, ConflictError
from printctl.web.printer.printer_access import PrinterAccess
from printctl.web.printer.printer_commands import fastest_ul_s
from printctl.web.profile_store import ProfileStore

PURGE_STEP_UL: Final = 5.0
PURGE_UL: Final = 50.0
"""Of one change of syringe: what doesn't come by then won't come, and cells are dear."""
PURGE_UL_S: Final = 1.0


class Changing:
    """What the wizards of a change ask for.

    Parameters
    ----------
    access : PrinterAccess
    store : ProfileStore
    """

    def __init__(self, access: PrinterAccess, store: ProfileStore) -> None:
        self._access, self._store = access, store
        self._lock = threading.Lock()
        self._purged_ul = 0.0

    @property
    def purged_ul(self) -> float:
        """Pushed out by `purge` since the syringe was put in, µL."""
        return self._purged_ul

    def syringe(self, who: Principal, name: str, ink: str, filled_ul: float) -> StationStatus:
        """Say that a syringe was put in, filled with so much ink, its plunger touched.

        Raises
        ------
        BadRequestError
            For more than it holds, or nothing.
        """
        station = self._access.ask(who)
        syringe = self._store.load(Syringe, name)
        if not 0 < filled_ul <= syringe.volume_ul:
            raise BadRequestError(
                f"{filled_ul:g} µL in {syringe.name}: give above 0 and at most "
                f"{syringe.volume_ul:g} µL (volume_ul)"
            )
        area = syringe.area_mm2
        status = station.mount(
            syringe=self._store.given(Syringe, name),
            ink=self._store.given(Ink, ink) if ink else "",
            plunger_mm=(syringe.volume_ul - filled_ul) / area,
        )
        with self._lock:
            self._purged_ul = 0.0
        return self._access.heard(status)

    def purge(self, who: Principal, ul: float, ul_s: float | None = None) -> StationStatus:
        """Push bubbles out of the needle, a little at a time; as fast as a purge may be.

        Raises
        ------
        BadRequestError
            For more than a step, or faster than a purge is.
        ConflictError
            When no syringe is named, or enough was purged.
        """
        if not 0 < ul <= PURGE_STEP_UL:
            raise BadRequestError(f"{ul:g} µL in one purge: above 0, at most {PURGE_STEP_UL:g} µL")
        with self._access.moving(who) as station, self._lock:
            fastest = fastest_ul_s(station.status)
            if fastest is None:
                raise ConflictError("say which syringe is mounted first")
            most = min(PURGE_UL_S, fastest)
            if ul_s is not None and not 0 < ul_s <= most:
                raise BadRequestError(f"{ul_s:g} µL/s: a purge goes at most at {most:g} µL/s here")
            if self._purged_ul + ul > PURGE_UL + 1e-9:
                raise ConflictError(
                    f"{self._purged_ul:g} µL are purged, at most {PURGE_UL:g} µL after a change: "
                    "if ink doesn't come yet, look for a clog or a plunger that isn't touched"
                )
            status = station.plunger(ul, ul_s or most)
            self._purged_ul += ul
        return self._access.heard(status)

    def needle(self, who: Principal, name: str) -> StationStatus:
        """Say that another needle was put in; the floor must then be touched off anew."""
        station = self._access.ask(who)
        given = self._store.given(Needle, name)
        return self._access.heard(station.mount(needle=given, floor_mm=None, bath_level_mm=None))
