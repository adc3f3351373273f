"""Names of the pipeline stages in order, listed without importing the stages."""

from __future__ import annotations

from typing import Final

from printctl.errors import UsageError

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
