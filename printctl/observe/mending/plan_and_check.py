"""Plan a mend, dry-run it, and return it only if it passes the check."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from printctl.observe.mending.check import MendCheck, check_mend
from printctl.observe.mending.gap import Gap, NotMended
from printctl.observe.mending.held_print import HeldPrint
from printctl.observe.mending.mend import Mend
from printctl.observe.mending.options import MendOptions
from printctl.observe.mending.plan import plan_mend
from printctl.observe.mending.voids import Voids


def checked_mend(
    held: HeldPrint,
    gaps: Sequence[Gap],
    voids: Voids | None = None,
    options: MendOptions | None = None,
) -> tuple[Mend, MendCheck | None]:
    """Return a mend that may be inserted, and its check; no check where nothing is mended.

    A mend that fails its check has no lines: all of its patches are left, with the reason.

    Parameters
    ----------
    held, gaps, voids, options
        As for `plan_mend`.

    Raises
    ------
    MendError
        As `plan_mend`.
    """
    mend = plan_mend(held, gaps, voids, options)
    if not mend.lines:
        return mend, None
    check = check_mend(held, mend.lines, gaps, voids, options)
    if check.passed:
        return mend, check
    why = f"the check of its insert failed ({failures(check)}); mend by hand, and report this"
    own = [NotMended(one.path.number, one.gap.from_mm, one.gap.to_mm, why) for one in mend.patches]
    refused = replace(
        mend, lines=(), patches=(), spans=(), left=(*mend.left, *own), volume_ul=0.0, duration_s=0.0
    )
    return refused, check


def failures(check: MendCheck) -> str:
    """Return what an insert fails its check by, in words."""
    said = [
        f"{check.lumens_entered} pieces of ink in lumens" if check.lumens_entered else "",
        f"{check.ink_crossed} moves through written ink" if check.ink_crossed else "",
        "" if check.returns else f"it ends {check.off_mm:.4f} mm off, or at another feed",
        *check.refused,
        *check.beyond_limits,
    ]
    return "; ".join(one for one in said if one)
