"""The parts that a command uses: those named, else those mounted; and what files were confirmed."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from typing import Final

from firmware_profiles import load
from printctl.checks.made_for import MadeFor, header_lines, profile_hash
from printctl.checks.set_up import NONE, Check
from printctl.errors import SafetyError, UsageError
from printctl.machine.job.job import Job
from printctl.machine.job.syringes import plunger_travel
from printctl.machine.records.mounting import PARTS, load_mounting, mounted_folder

ASSUMED: Final = {"syringe": "hamilton_1ml", "ink": "collagen_fresh"}
"""Parts of a dry run, a simulated print or a sliced file that names none."""
_CONFIRMED: Final = "confirmed.txt"


def with_mounted(
    printer: str, named: Mapping[str, str | None], *, refuse: bool = True, keys: str = "--{}"
) -> dict[str, str | None]:
    """Return what is named, and what is mounted on the printer for parts that aren't.

    ``keys`` says where a part is named, for messages.

    Raises
    ------
    SafetyError
        When another profile is mounted than the one named.
    """
    kept = load_mounting(printer).parts
    there = {part: getattr(kept, part) or None for part in named}
    refused = [
        f"{keys.format(part)} is {name!r}, and {there[part]!r} is mounted on {printer}; use what "
        f"is mounted, or change it and enter that: printctl mount --printer {printer} --{part} "
        f"{name}"
        for part, name in named.items()
        if refuse and name is not None and there[part] and not _same(part, name, str(there[part]))
    ]
    if refused:
        raise SafetyError("\n".join(refused))
    return {part: name or there[part] for part, name in named.items()}


def _same(part: str, name: str, other: str) -> bool:
    if name == other or NONE in (name, other):
        return name == other
    first, second = (profile_hash(load(PARTS[part], one)) for one in (name, other))
    return first == second


def refuse_unknown(
    printer: str, parts: Mapping[str, str | None], needed: Iterable[str], *, keys: str = "--{}"
) -> None:
    """Raise `UsageError` for parts that are neither named nor mounted."""
    missing = [part for part in needed if not parts[part]]
    if missing:
        options = " ".join(f"--{part} PROFILE" for part in missing)
        raise UsageError(
            f"{' and '.join(missing)} unknown: neither named nor mounted on {printer}; name it "
            f"({', '.join(map(keys.format, missing))}), or enter it once: printctl mount --printer "
            f"{printer} {options}"
        )


def or_assumed(
    parts: Mapping[str, str | None], usual: Mapping[str, str] = ASSUMED
) -> tuple[dict[str, str], list[str]]:
    """Fill in the usual parts where none is known; return a note that says which, or none."""
    taken = {part: name for part, name in usual.items() if not parts[part]}
    said = ", ".join(f"{part} {name}" for part, name in taken.items())
    notes = [f"assumed {said}, as no other was named"] if taken else []
    return {part: name or "" for part, name in parts.items()} | taken, notes


def left_check(job: Job, reload_at: tuple[int, ...], left_ul: float, area_mm2: float) -> Check:
    """Compare the ink pushed before the first change of syringe with what the syringe holds."""
    travel = plunger_travel(job.lines[: reload_at[0]] if reload_at else job.lines)
    needed = max(travel) * area_mm2
    return Check(
        "ink that the job takes, of what is in the syringe",
        needed,
        left_ul,
        "µL",
        needed <= left_ul,
        "",
        "the syringe would run dry; put in a full one and enter it (printctl mount --fill-ul), or "
        "print a smaller part",
    )


def is_confirmed(sha256: str, mounted: MadeFor) -> bool:
    """Whether a person has confirmed a file without a record for this set-up."""
    try:
        return _line(sha256, mounted) in (mounted_folder() / _CONFIRMED).read_text().splitlines()
    except FileNotFoundError:
        return False


def keep_confirmed(sha256: str, mounted: MadeFor) -> None:
    """Remember that a person has confirmed a file for this set-up."""
    mounted_folder().mkdir(0o700, parents=True, exist_ok=True)
    with (mounted_folder() / _CONFIRMED).open("a", encoding="utf-8") as handle:
        handle.write(_line(sha256, mounted) + "\n")


def _line(sha256: str, mounted: MadeFor) -> str:
    set_up = hashlib.sha256("\n".join(header_lines(mounted)).encode()).hexdigest()[:16]
    return f"{sha256} {set_up}"


def unconfirmed(name: str, mounted: MadeFor) -> str:
    """Return what a person has to confirm of a file without a record."""
    parts = (f"{part} {', '.join(one.name for one in those)}" for part, those in mounted.items())
    return f"{name} doesn't record the set-up it was made for. Mounted: {'; '.join(parts)}"
