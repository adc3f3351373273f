"""Change a mounted part; touch off."""

from __future__ import annotations

import statistics
import threading
from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, computed_field

from firmware_profiles import Ink, Needle, Syringe
from printctl.web.controls import Principal
from printctl.web.errors import BadRequestError, ConflictError
from printctl.web.printer.printer_commands import PrinterAccess
from printctl.web.printer.status import PrinterStatus, fastest_ul_s
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

    def syringe(self, who: Principal, syringe: str, ink: str, filled_ul: float) -> PrinterStatus:
        """Say that a syringe was put in, filled with so much ink, its plunger touched.

        Raises
        ------
        BadRequestError
            For more than it holds, or nothing.
        """
        station = self._access.ask(who)
        facts = self._store.load(Syringe, syringe)
        if not 0 < filled_ul <= facts.volume_ul:
            raise BadRequestError(
                f"{filled_ul:g} µL in {facts.name}: give above 0 and at most "
                f"{facts.volume_ul:g} µL (volume_ul)"
            )
        status = station.mount(
            syringe=self._store.given(Syringe, syringe),
            ink=self._store.given(Ink, ink) if ink else "",
            plunger_mm=(facts.volume_ul - filled_ul) / facts.area_mm2,
        )
        with self._lock:
            self._purged_ul = 0.0
        return self._access.heard(status)

    def purge(self, who: Principal, ul: float, ul_s: float | None = None) -> PrinterStatus:
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
            fastest = fastest_ul_s(station.status.profile, station.status.mounted)
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

    def needle(self, who: Principal, needle: str) -> PrinterStatus:
        """Say that another needle was put in; the floor must then be touched off anew."""
        station = self._access.ask(who)
        given = self._store.given(Needle, needle)
        return self._access.heard(station.mount(needle=given, floor_mm=None, bath_level_mm=None))


# Touch-off guide: height of dish floor or bath surface from three tip readings that agree.

Surface = Literal["floor", "bath"]
READINGS: Final = 3
SPREAD_MM: Final = 0.05
THICKEST_FOIL_MM: Final = 2.0


class Touching(BaseModel):
    """What was read of a surface so far."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    surface: Surface = Field(description="`floor` of the dish, or the `bath`'s level.")
    foil_mm: Annotated[float, Field(ge=0, le=THICKEST_FOIL_MM)] = Field(
        default=0.0, description="Thickness of the foil that the tip stands on."
    )
    readings_mm: tuple[float, ...] = Field(
        default=(), description="Heights of the tip, printer's frame."
    )

    @property
    def last(self) -> tuple[float, ...]:
        """The readings that count."""
        return self.readings_mm[-READINGS:]

    @computed_field  # type: ignore[prop-decorator]
    @property
    def spread_mm(self) -> float | None:
        """Highest less lowest of those; None before there are enough."""
        return max(self.last) - min(self.last) if len(self.last) == READINGS else None

    @computed_field  # type: ignore[prop-decorator]
    @property
    def agrees(self) -> bool:
        """Whether there are enough, close enough together."""
        # Heights have two or three decimals; 0.05 apart must pass whatever the floats say.
        return self.spread_mm is not None and self.spread_mm <= SPREAD_MM + 1e-9

    @property
    def height_mm(self) -> float | None:
        """Middle one of the readings that count, with the foil under the tip."""
        return statistics.median(self.last) if self.agrees else None

    @computed_field  # type: ignore[prop-decorator]
    @property
    def said(self) -> str:
        """How far it is, in words."""
        count = len(self.readings_mm)
        if self.spread_mm is None:
            return f"{count} of {READINGS} readings"
        verdict = "agree" if self.agrees else "don't agree: take another, the last three count"
        return (
            f"the last {READINGS} of {count} readings are within {self.spread_mm:.3f} mm (at most "
            f"{SPREAD_MM:g} mm): they {verdict}"
        )


class Guide:
    """One touching at a time, the same for all browsers.

    Parameters
    ----------
    access : PrinterAccess
    """

    def __init__(self, access: PrinterAccess) -> None:
        self._access = access
        self._lock = threading.Lock()
        self._now: Touching | None = None

    @property
    def touching(self) -> Touching | None:
        """What goes on; None when nothing does."""
        return self._now

    def start(self, who: Principal, surface: Surface, foil_mm: float = 0.0) -> Touching:
        """Begin anew; what was known of the surface is forgotten, for the tip must pass it.

        Raises
        ------
        ConflictError
            When no needle is named, or for the floor no dish.
        """
        station = self._access.ask(who)
        mounted = station.status.mounted
        if not mounted.needle or (surface == "floor" and not mounted.dish):
            raise ConflictError(
                "say which needle and dish are mounted first (What is mounted): without them no "
                "soft limit can be kept"
            )
        forgotten = "floor_mm" if surface == "floor" else "bath_level_mm"
        self._access.heard(station.mount(**{forgotten: None}))
        return self._keep(Touching(surface=surface, foil_mm=foil_mm))

    def read(self, who: Principal) -> Touching:
        """Take the tip's height as one reading.

        Raises
        ------
        ConflictError
            When nothing was started, or the printer doesn't tell where it stands.
        """
        station = self._access.ask(who)
        with self._lock:
            now = self._started()
            place = station.status.position_mm
            if place is None:
                raise ConflictError("the printer hasn't told its position; home it first")
            self._now = now.model_copy(update={"readings_mm": (*now.readings_mm, place[2])})
            return self._now

    def use(self, who: Principal) -> PrinterStatus:
        """Tell the station the height that the readings agree on.

        Raises
        ------
        ConflictError
            When they don't agree.
        """
        station = self._access.ask(who)
        with self._lock:
            now = self._started()
            if now.height_mm is None:
                raise ConflictError(f"{now.said}; touch again")
            if now.surface == "floor":
                status = station.touch_off(now.height_mm, foil_mm=now.foil_mm)
            else:
                status = station.mount(bath_level_mm=round(now.height_mm - now.foil_mm, 4))
            self._now = None
        return self._access.heard(status)

    def give_up(self, who: Principal) -> None:
        """Forget the readings."""
        self._access.core.controls.require(who)
        with self._lock:
            self._now = None

    def _keep(self, touching: Touching) -> Touching:
        with self._lock:
            self._now = touching
        return touching

    def _started(self) -> Touching:
        if self._now is None:
            raise ConflictError("nothing is being touched off; start it first")
        return self._now
