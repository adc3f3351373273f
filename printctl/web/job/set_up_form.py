"""Form of a job's print set-up: printer, mounted parts, start position, supervision."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from nicegui import ui

from firmware_profiles import Bath, Dish, Facts, Ink, Needle, Printer, Syringe
from printctl.web.job.layout import small
from printctl.web.job.set_up import JobSetUp
from printctl.web.job.to_start import Place
from printctl.web.profile_store import ProfileStore

Said = Callable[[], JobSetUp]
_THINGS: Final[tuple[tuple[str, str, type[Facts]], ...]] = (
    ("printer", "Printer", Printer),
    ("needle", "Needle", Needle),
    ("syringe", "Syringe", Syringe),
    ("ink", "Ink", Ink),
    ("bath", "Bath", Bath),
    ("dish", "Dish", Dish),
)


class SetUpForm:
    """Machine, what is mounted on it, where the job starts; then how the print is watched over.

    Parameters
    ----------
    store : ProfileStore
        Profiles that can be chosen.
    first : JobSetUp
        What the form says at first.
    declared : (x, y, z) or None, mm
        Where the job itself says that it starts, which the form can't change.
    """

    def __init__(self, store: ProfileStore, first: JobSetUp, declared: Place | None) -> None:
        self._first = first
        with ui.element("div").classes("job-form"):
            self._profiles = {
                key: _choice(store, name, kind, getattr(first, key)) for key, name, kind in _THINGS
            }
            self._depth = _number("Bath depth", first.bath_depth_mm, "mm", least=0.1)
            self._start = [
                _number(f"Start {axis}", mm, "mm", step=0.1)
                for axis, mm in zip("XYZ", first.start_mm, strict=True)
            ]
            care = first.care
            self._deadman = _number("Pause unless confirmed within", care.deadman_min, "min", 0.0)
            self._prime = _number("Extra ink after a pause", care.prime_ul, "µL", 0.0)
        if declared is not None:
            for field in self._start:
                field.disable()
            small("The job itself says where it starts; the tip must come there.")

    def add_answers(self) -> None:
        """What is answered by yes or no."""
        first = self._first
        self._reload = ui.checkbox(
            "Pause for a new syringe where one doesn't last", value=first.care.reload
        )
        self._stops = ui.checkbox(
            "Stop instead of pausing when nobody confirms", value=first.care.deadman_stops
        )
        self._accept = ui.checkbox(
            "Print although the needle's shaft passes through written vessels (goes into the "
            "journal)",
            value=first.accept_crossings,
        )

    def start(self) -> Place:
        """Where the job starts."""
        x, y, z = (float(one.value or 0.0) for one in self._start)
        return x, y, z

    def said(self) -> JobSetUp:
        """All that the form says now.

        Raises
        ------
        pydantic.ValidationError
        """
        first, depth = self._first, self._depth.value
        profiles = {key: str(field.value or "") for key, field in self._profiles.items()}
        dish = bool(profiles["dish"])
        care = first.care.model_dump() | {
            "deadman_min": float(self._deadman.value or 0.0),
            "deadman_stops": bool(self._stops.value and self._deadman.value),
            "prime_ul": float(self._prime.value or 0.0),
            "reload": bool(self._reload.value),
        }
        return JobSetUp.model_validate(
            first.model_dump()
            | profiles
            | {
                "care": care,
                "bath_depth_mm": float(depth) if depth and dish else None,
                "dish_centre_mm": first.dish_centre_mm if dish else None,
                "start_mm": self.start(),
                "accept_crossings": bool(self._accept.value),
            }
        )


def _choice(store: ProfileStore, name: str, kind: type[Facts], value: str) -> ui.select:
    options = store.choices(kind)
    if value and value not in options:
        options[value] = store.name(value)
    options[""] = "none named"
    return ui.select(options, label=name, value=value, with_input=False).props("outlined")


def _number(
    name: str,
    value: float | None,
    unit: str,
    least: float | None = None,
    step: float | None = None,
) -> ui.number:
    made = ui.number(name, value=value, min=least, step=step, suffix=unit, precision=3)
    return made.props("outlined")
