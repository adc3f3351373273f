"""Exception classes raised for bad design input: tissue, network, growth, flow, solid, toolpath.

::

    DesignError                 anything a user can mend on the design side
    ├── TissueError             mesh empty, open, of absurd size, too thin
    ├── NetworkError            NaN, self-intersection, zero length or radius, bad file
    ├── GrowthError             a tree that can't be grown as asked
    │   ├── RootError           a root where no trunk fits
    │   │   └── TrunkWallError  a trunk that opens the surface beyond its mouth
    │   ├── NoRoomError         vessels find no room: narrower ones may
    │   │   └── WideTrunkError  a template's trunk too wide for the wall it runs in
    │   └── CrowdedError        fewer terminals fit than were asked for
    ├── FlowError               no inlet, no outlet, isolated part
    │   └── FlowInputError      a waveform, or losses, that the user gave wrongly
    ├── SolidError              a surface that isn't watertight
    └── ToolpathError           vessel thinner than the needle, empty path
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Self


class DesignError(ValueError):
    """Bad input to the design side; the message says what, value, limit, unit and remedy."""

    def around(self, before: str = "", after: str = "") -> Self:
        """The same with words before and after it."""
        return type(self)(f"{before}{self}{after}")


class TissueError(DesignError):
    """A tissue that can't be used."""


class ThinTissueError(TissueError):
    """A tissue too thin for the vessels that are asked for."""


class NetworkError(DesignError):
    """A vessel network that can't be used."""


class GrowthError(DesignError):
    """A tree that can't be grown as asked."""


class RootError(GrowthError):
    """A root where no trunk fits: another one may do."""

    placed: Final = 0
    """Terminals that found a place, as in `NoRoomError`."""


class TrunkWallError(RootError):
    """A trunk that opens the surface beyond its mouth.

    Attributes
    ----------
    radius_mm : float
        Of the trunk.
    """

    def __init__(self, message: str, radius_mm: float) -> None:
        self.radius_mm = radius_mm
        super().__init__(message)

    def around(self, before: str = "", after: str = "") -> Self:
        """The same with words before and after it."""
        return type(self)(f"{before}{self}{after}", self.radius_mm)


_NARROWER: Final = (
    "give a higher pressure_drop_mmhg or, where smallest_diameter_mm is given, a smaller one"
)


class NoRoomError(GrowthError):
    """Vessels find no room as wide as they are.

    Attributes
    ----------
    what, remedy : str
        Of the message.
    drop_factor : float
        On the pressure drop, with which they may have room.
    placed : int
        Terminals that found a place beside the trunk.
    """

    def __init__(
        self, what: str, remedy: str = _NARROWER, drop_factor: float = 2.0, placed: int = 1
    ) -> None:
        self.what, self.remedy = what, remedy
        self.drop_factor, self.placed = drop_factor, placed
        super().__init__(f"{what}; {remedy}")

    def around(self, before: str = "", after: str = "") -> Self:
        """The same with words before and after what it is, before the remedy."""
        what = f"{before}{self.what}{after}"
        return type(self)(what, self.remedy, self.drop_factor, self.placed)

    def with_remedy(self, remedy: str) -> Self:
        """The same with another remedy."""
        return type(self)(self.what, remedy, self.drop_factor, self.placed)

    def nearer_than(self, wider: NoRoomError | None) -> bool:
        """Whether narrower vessels came nearer to having room than what they were before did."""
        if wider is None or isinstance(self, WideTrunkError) or isinstance(wider, WideTrunkError):
            return True
        return self.placed > wider.placed or not wider.placed

    def beyond(self, raised: float) -> Self:
        """The same, met with a pressure drop that was ``raised`` so many times before."""
        return type(self)(self.what, self.remedy, raised * self.drop_factor, self.placed)


class WideTrunkError(NoRoomError):
    """A template's trunk is wider than the wall that it runs in."""


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

    def __init__(self, fit: int, asked: int, more: str = "", fewer: str = "") -> None:
        self.fit, self.asked, self.more = fit, asked, more
        super().__init__(
            f"only {fit} of {asked} terminals fit beside the trunks{more}; {fewer}"
            "take a lower clearance_mm, a smaller smallest_diameter_mm or, where that isn't given, "
            "a higher pressure_drop_mmhg (radii fall by its fourth root)"
        )

    def with_fewer(
        self, tried: Sequence[int], least: int, grown: bool = False, narrower: str = ""
    ) -> CrowdedError:
        """The same, with what came of growing as many as were ``tried``, the last one ``grown``.

        Parameters
        ----------
        least : int
            That the template takes.
        narrower : str
            Key and value of a recipe with which all were grown.
        """
        if grown:
            fewer = f"ask for {tried[-1]} terminals, which were tried and fit, or "
        elif tried:
            fewer = f"fewer don't fit either ({' and '.join(map(str, tried))} were tried): "
        else:
            fewer = f"the template takes {least} at least: take a larger part, "
        if narrower:
            fewer += f"give a {narrower}, which was tried and fits, or "
        return CrowdedError(self.fit, self.asked, self.more, fewer)


class FlowError(DesignError):
    """A flow problem without a solution."""


class FlowInputError(FlowError):
    """A waveform, stenosis or loss that was given wrongly, or not for this network."""


class SolidError(DesignError):
    """A surface that isn't a closed, oriented solid."""


class ToolpathError(DesignError):
    """A path that can't be written."""
