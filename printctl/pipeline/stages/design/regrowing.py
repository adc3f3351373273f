"""Say of a tree that didn't fit what does: trees that were grown with one key changed."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

from rich.console import Console

from design.errors import DesignError, GrowthError, NoRoomError, RootError, ThinTissueError
from printctl.pipeline.context import RunContext
from printctl.progress import StageBars
from printctl.recipe import Recipe
from printctl.recipe.sections.growth import Growth

TRIAL_S: Final = 60.0
"""Time for all trials; one isn't begun that may end later, as the longest so far."""
NARROWEST: Final = 0.4
"""Of the smallest diameter that was asked for, the least that is tried."""
DIAMETERS: Final = 16
"""Steps of the smallest diameter down to that."""


class Change(NamedTuple):
    """A change of the recipe, as it is told to the user."""

    text: str
    recipe: Recipe


def grown(recipe: Recipe, text: str = "", **keys: object) -> Change:
    """The recipe with other keys of its vasculature."""
    text = text or ", ".join(f"vasculature.{key}: {value:g}" for key, value in keys.items())
    part = recipe.vasculature.model_copy(update=keys)
    return Change(text, recipe.model_copy(update={"vasculature": part}))


def with_what_fits(
    context: RunContext,
    error: DesignError,
    took_s: float,
    grow: Callable[[RunContext], object],
) -> DesignError:
    """The error with what was tried and fits in place of its remedy.

    Parameters
    ----------
    context : RunContext
        Whose tree didn't grow.
    error : DesignError
        Why not.
    took_s : float, s
        That it took to fail.
    grow : callable
        Grow the recipe's network; raises `DesignError`.
    """
    part = context.recipe.vasculature
    of_room = isinstance(error, NoRoomError | RootError | ThinTissueError)
    if context.trial or not of_room or not isinstance(part, Growth) or context.stand is not None:
        return error
    trials = _Trials(context, grow, time.monotonic(), took_s)
    fits = [one.text for one in (trials.most_terminals(), trials.widest()) if one is not None]
    what = error.what if isinstance(error, NoRoomError) else str(error).partition("; ")[0]
    if fits:
        return GrowthError(f"{what}; grown with one change, it fits: {' or '.join(fits)}")
    if not trials.failed:
        return error
    return GrowthError(
        f"{what}; also tried, and none fits: {', '.join(trials.failed)}. Take a larger part or "
        "print_scale"
    )


@dataclass
class _Trials:
    """Trees grown within a limited time."""

    context: RunContext
    grow: Callable[[RunContext], object]
    begin: float
    longest_s: float
    failed: list[str] = field(default_factory=list)

    def most_terminals(self) -> Change | None:
        """The most terminals that fit, fewer than were asked for."""
        recipe, part = self.context.recipe, self.context.recipe.vasculature
        asked = part.terminals if isinstance(part, Growth) else None
        if asked is None:
            return None
        return self._bisected(asked - 1, lambda n: grown(recipe, terminals=n))

    def widest(self) -> Change | None:
        """The largest smallest diameter that fits and that can be printed."""
        recipe, part = self.context.recipe, self.context.recipe.vasculature
        asked = part.smallest_diameter_mm if isinstance(part, Growth) else None
        if asked is None:
            return None
        least = max(NARROWEST * asked, self.context.printability(asked).lumen_mm)
        widths = [round(least + (asked - least) * n / DIAMETERS, 2) for n in range(DIAMETERS)]
        widths = [width for width in sorted(set(widths)) if least <= width < asked]
        return self._bisected(
            len(widths), lambda n: grown(recipe, smallest_diameter_mm=widths[n - 1])
        )

    def _bisected(self, most: int, change: Callable[[int], Change]) -> Change | None:
        """The change of the largest number that fits, of 1 to `most`."""
        low, high, best = 0, most + 1, None
        while high - low > 1 and self._has_time():
            middle = (low + high) // 2
            tried = change(middle)
            if self._fits(tried):
                low, best = middle, tried
            else:
                high = middle
                self.failed.append(tried.text)
        return best

    def _has_time(self) -> bool:
        return time.monotonic() - self.begin + self.longest_s < TRIAL_S

    def _fits(self, change: Change) -> bool:
        begin = time.monotonic()
        try:
            trial = replace(
                self.context,
                recipe=change.recipe,
                bars=StageBars(Console(quiet=True)),
                trial=True,
            )
            trial.tissue = self.context.tissue
            self.grow(trial)
        except DesignError:
            return False
        finally:
            self.longest_s = max(self.longest_s, time.monotonic() - begin)
        return True
