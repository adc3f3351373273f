"""Options of a recipe's run, and the names of its stages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from printctl.errors import UsageError
from printctl.progress import Listener

SIMULATED_PORT: Final = "simulated"
"""Port of the simulated printer."""
DESIGN_NAMES: Final = (
    "tissue",
    "vasculature",
    "flow",
    "fidelities",
    "measures",
    "oxygen",
    "solid",
)
JOB_NAMES: Final = ("toolpath", "dry run", "lumens")
TOOLPATH_NAMES: Final = (*DESIGN_NAMES, *JOB_NAMES)
WHOLE_NAMES: Final = (*TOOLPATH_NAMES, "print", "scan", "registration")


def names_until(name: str) -> tuple[str, ...]:
    """The stages of a run up to one of them.

    Parameters
    ----------
    name : str
        As the run shows it; ``-`` or ``_`` may stand for the space in ``dry run``.

    Raises
    ------
    UsageError
        When there is no such stage.
    """
    wanted = name.strip().lower().replace("-", " ").replace("_", " ")
    if wanted not in WHOLE_NAMES:
        raise UsageError(f"there is no stage {name!r}; a run has: {', '.join(WHOLE_NAMES)}")
    return WHOLE_NAMES[: WHOLE_NAMES.index(wanted) + 1]


@dataclass(frozen=True)
class RunOptions:
    """RunOptions a recipe is run.

    Attributes
    ----------
    assume_yes : bool
        Don't ask before a print on a real printer.
    pdf : bool
        Write the report as a PDF too.
    until : str or None
        The last stage, by its name; all of them and the report without.
    printed : bool
        Take the print that is done in the run's folder; nothing is printed.
    listener : Listener or None
        Told of progress.
    rehearse : float or None, 1
        Print on the simulated printer, whatever the recipe names, so many times as fast as a real
        one; 0 for as fast as it can.
    gcode_alone : bool
        Leave out the solid of a part whose path needs the network alone.
    """

    assume_yes: bool = False
    pdf: bool = False
    until: str | None = None
    printed: bool = False
    listener: Listener | None = None
    rehearse: float | None = None
    gcode_alone: bool = False
