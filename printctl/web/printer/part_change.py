"""Change a mounted part; touch off."""

from __future__ import annotations

import statistics
import threading
from typing import Annotated, Final, Literal

from pydantic import ConfigDict, Field, computed_field

from firmware_profiles import Ink, Needle, Syringe
from printctl.web.errors import BadRequestError, ConflictError
from printctl.web.printer.service import PrinterService
from printctl.web.printer.status import PrinterStatus, described
from printctl.web.rest import Asking, Body

Name = Annotated[str, Field(min_length=1, max_length=64)]
NameOrNone = Annotated[str, Field(max_length=64)]
PURGE_STEP_UL: Final = 5.0
PURGE_UL: Final = 50.0
"""Of one change of syringe: what doesn't come by then won't come, and cells are dear."""
PURGE_UL_S: Final = 1.0


class NewSyringe(Body):
    """A syringe that was put in, with so much ink, µL."""

    syringe: Name
    ink: NameOrNone = ""
    filled_ul: Annotated[float, Field(gt=0, le=100_000)]


class NewNeedle(Body):
    """A needle that was put in."""

    needle: Name


class Push(Body):
    """Ink to push (above 0) or draw back, µL, and how fast, µL/s."""

    ul: Annotated[float, Field(ge=-100_000, le=100_000)]
    ul_s: Annotated[float, Field(gt=0, le=10_000)] | None = None


class Changing:
    """Changes of syringe and needle; its methods are routes."""

    def __init__(self, service: PrinterService) -> None:
        self._service = service
        self._lock = threading.Lock()
        self._purged_ul = 0.0

    def syringe(self, body: NewSyringe, who: Asking) -> PrinterStatus:
        """Mount a syringe that was put in, filled with so much ink, its plunger touched."""
        station, store = self._service.ask(who), self._service.store
        facts = store.load(Syringe, body.syringe)
        if body.filled_ul > facts.volume_ul:
            raise BadRequestError(
                f"{body.filled_ul:g} µL in {facts.name}: give above 0 and at most "
                f"{facts.volume_ul:g} µL (volume_ul)"
            )
        status = station.mount(
            syringe=store.given(Syringe, body.syringe),
            ink=store.given(Ink, body.ink) if body.ink else "",
            plunger_mm=(facts.volume_ul - body.filled_ul) / facts.area_mm2,
        )
        with self._lock:
            self._purged_ul = 0.0
        return self._service.heard(status)

    def purge(self, body: Push, who: Asking) -> PrinterStatus:
        """Push bubbles out of the needle, a little at a time; as fast as a purge may be."""
        ul, ul_s = body.ul, body.ul_s
        if not 0 < ul <= PURGE_STEP_UL:
            raise BadRequestError(f"{ul:g} µL in one purge: above 0, at most {PURGE_STEP_UL:g} µL")
        with self._service.moving(who) as station, self._lock:
            fastest = described(station.status).fastest_ul_s
            if fastest is None:
                raise ConflictError("say which syringe is mounted first")
            most = min(PURGE_UL_S, fastest)
            if ul_s is not None and ul_s > most:
                raise BadRequestError(f"{ul_s:g} µL/s: a purge goes at most at {most:g} µL/s here")
            if self._purged_ul + ul > PURGE_UL + 1e-9:
                raise ConflictError(
                    f"{self._purged_ul:g} µL are purged, at most {PURGE_UL:g} µL after a change: "
                    "if ink doesn't come yet, look for a clog or a plunger that isn't touched"
                )
            status = station.plunger(ul, ul_s or most)
            self._purged_ul += ul
        return self._service.heard(status)

    def needle(self, body: NewNeedle, who: Asking) -> PrinterStatus:
        """Mount a needle that was put in; the floor must then be touched off anew."""
        station, given = self._service.ask(who), self._service.store.given(Needle, body.needle)
        return self._service.heard(station.mount(needle=given, floor_mm=None, bath_level_mm=None))


READINGS: Final = 3
SPREAD_MM: Final = 0.05
THICKEST_FOIL_MM: Final = 2.0


class StartTouching(Body):
    """Which surface, and the foil's thickness, mm."""

    surface: Literal["floor", "bath"] = Field(
        description="`floor` of the dish, or the `bath`'s level."
    )
    foil_mm: Annotated[float, Field(ge=0, le=THICKEST_FOIL_MM)] = Field(
        default=0.0, description="Thickness of the foil that the tip stands on."
    )


class Touching(StartTouching):
    """What was read of a surface so far."""

    model_config = ConfigDict(frozen=True)

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


TouchingNow = dict[Literal["touching"], Touching | None]


class Guide:
    """One touching at a time, the same for all browsers; its methods are routes."""

    def __init__(self, service: PrinterService) -> None:
        self._service = service
        self._lock = threading.Lock()
        self._touching: Touching | None = None

    def state(self) -> TouchingNow:
        """Return the touching that goes on."""
        return {"touching": self._touching}

    def start(self, body: StartTouching, who: Asking) -> TouchingNow:
        """Begin anew; what was known of the surface is forgotten, for the tip must pass it."""
        station = self._service.ask(who)
        mounted, floor = station.status.mounted, body.surface == "floor"
        if not mounted.needle or (floor and not mounted.dish):
            raise ConflictError(
                "say which needle and dish are mounted first (What is mounted): without them no "
                "soft limit can be kept"
            )
        forgotten = "floor_mm" if floor else "bath_level_mm"
        self._service.heard(station.mount(**{forgotten: None}))
        with self._lock:
            self._touching = Touching(**dict(body))
            return self.state()

    def read(self, who: Asking) -> TouchingNow:
        """Take the tip's height as one reading."""
        station = self._service.ask(who)
        with self._lock:
            now, place = self._started(), station.status.position_mm
            if place is None:
                raise ConflictError("the printer hasn't told its position; home it first")
            readings = (*now.readings_mm, place[2])
            self._touching = now.model_copy(update={"readings_mm": readings})
            return self.state()

    def use(self, who: Asking) -> PrinterStatus:
        """Give the station the middle one of the readings that agree, less the foil."""
        station = self._service.ask(who)
        with self._lock:
            now = self._started()
            if not now.agrees:
                raise ConflictError(f"{now.said}; touch again")
            height = statistics.median(now.last)
            if now.surface == "floor":
                status = station.touch_off(height, foil_mm=now.foil_mm)
            else:
                status = station.mount(bath_level_mm=round(height - now.foil_mm, 4))
            self._touching = None
        return self._service.heard(status)

    def give_up(self, who: Asking) -> TouchingNow:
        """Forget the readings."""
        self._service.core.controls.require(who)
        with self._lock:
            self._touching = None
            return self.state()

    def _started(self) -> Touching:
        if self._touching is None:
            raise ConflictError("nothing is being touched off; start it first")
        return self._touching
