"""Exception classes raised for bad design input: tissue, network, growth, flow, solid, toolpath.

::

    DesignError                 anything a user can mend on the design side
    ├── TissueError             mesh empty, open, of absurd size, too thin
    ├── NetworkError            NaN, self-intersection, zero length or radius, bad file
    ├── GrowthError             a tree that can't be grown as asked
    │   ├── RootError           a root where no trunk fits
    │   └── CrowdedError        fewer terminals fit than were asked for
    ├── FlowError               no inlet, no outlet, isolated part
    ├── SolidError              a surface that isn't watertight
    └── ToolpathError           vessel thinner than the needle, empty path
"""

from __future__ import annotations

from typing import Final


class DesignError(ValueError):
    """Bad input to the design side; the message says what, value, limit, unit and remedy."""


class TissueError(DesignError):
    """A tissue that can't be used."""


class NetworkError(DesignError):
    """A vessel network that can't be used."""


class GrowthError(DesignError):
    """A tree that can't be grown as asked."""


class RootError(GrowthError):
    """A root where no trunk fits: another one may do."""


LEAST_TERMINALS: Final = 24
"""Of an organ's template, which has six trunks' ends with four terminals each at least."""
LEAST_IN_CORTEX: Final = 48
"""The same with eight each."""


class CrowdedError(GrowthError):
    """Fewer terminals fit beside a template's trunks than were asked for.

    Attributes
    ----------
    fit, asked : int
    """

    def __init__(self, fit: int, asked: int, more: str = "") -> None:
        self.fit, self.asked = fit, asked
        least = f"{LEAST_TERMINALS} at least, a cortex {LEAST_IN_CORTEX}"
        fewer = f"ask for {fit} or fewer, "
        if fit < LEAST_TERMINALS:
            fewer = f"too few for a template ({least}), so take a larger part, "
        elif fit < LEAST_IN_CORTEX:
            fewer = f"ask for {fit} or fewer where the template takes so few ({least}), "
        super().__init__(
            f"only {fit} of {asked} terminals fit beside the trunks{more}; {fewer}"
            "a lower clearance_mm, a smaller smallest_diameter_mm or, where that isn't given, a "
            "higher pressure_drop_mmhg (radii fall by its fourth root)"
        )


class FlowError(DesignError):
    """A flow problem without a solution."""


class SolidError(DesignError):
    """A surface that isn't a closed, oriented solid."""


class ToolpathError(DesignError):
    """A path that can't be written."""
