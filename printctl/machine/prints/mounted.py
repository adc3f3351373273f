"""The parts that a command uses: those named, else those mounted; and what files were confirmed."""

from __future__ import annotations

import hashlib
from collections.abc import Container, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

from firmware_profiles import Printer, Syringe, load
from printctl.checks.kinds import Kind
from printctl.checks.made_for import (
    MadeFor,
    differences,
    header_lines,
    named,
    profile_hash,
    read_made_for,
)
from printctl.checks.set_up import NONE, Check, finding
from printctl.errors import SafetyError, UsageError
from printctl.machine.errors import Refused
from printctl.machine.job.job import Job
from printctl.machine.job.syringes import plunger_travel
from printctl.machine.ports.detection import SIMULATED
from printctl.machine.process.clients.client import attach_station
from printctl.machine.process.contact import STATION_LOCK, alive
from printctl.machine.records.actor import actor
from printctl.machine.records.journal import Journal
from printctl.machine.records.mounting import (
    PARTS,
    Mounting,
    load_mounting,
    mounted_folder,
    mounting_file,
    refuse_impossible,
    save_mounting,
)
from printctl.machine.records.record import load_record, reported_port

_CONFIRMED: Final = "confirmed.txt"
_OPENING_BYTES: Final = 1 << 16


@dataclass(frozen=True)
class There:
    """What was entered of a machine.

    Attributes
    ----------
    printer : str
        Profile, by name or path.
    parts : mapping of str to str
        Profiles of `PARTS`; empty for nothing there, or unknown.
    left_ul : float or None, µL
        What the syringe can still push.
    """

    printer: str
    parts: Mapping[str, str]
    left_ul: float | None = None

    @staticmethod
    def kept(printer: str) -> There:
        """Return what was entered with `printctl mount`, or is left by the last print."""
        kept, profile = load_mounting(printer), load(Printer, printer)
        parts = {part: getattr(kept.parts, part) for part in PARTS}
        return There(printer, parts, kept.left_ul(profile))


def part_checks(
    there: There, names: Mapping[str, str], assumed: Container[str] = (), key: str = "--{}"
) -> list[Check]:
    """Compare the parts that a print is checked for with those on the machine.

    A finding's ``check`` is the part.

    Parameters
    ----------
    there : There
    names : mapping of str to str
        Profile of each part that the print is checked for; `NONE` for none.
    assumed : container of str
        Parts whose names nobody has given: each must be on the machine.
    key : str
        Where a part is named, for remedies.
    """
    checks = []
    for part, name in names.items():
        mounted, where = there.parts.get(part, ""), key.format(part)
        if mounted and not _same(part, name, mounted):
            text = f"{where} is {name or NONE!r}, and {mounted!r} is mounted on {there.printer}"
            how = "use what is mounted, or change it and enter that"
            command = f"printctl mount --printer {there.printer} --{part} {name or NONE}"
            checks.append(finding(Kind.OTHER_PART, part, "", f"{text}; {how}: {command}"))
        elif not mounted and part in assumed:
            checks.append(finding(Kind.UNKNOWN_PART, part, "", _unknown([part], there, key)))
    return checks


def _unknown(parts: Iterable[str], there: There, key: str) -> str:
    options = " ".join(f"--{part} PROFILE" for part in parts)
    return (
        f"neither named nor mounted on {there.printer}; name it "
        f"({', '.join(map(key.format, parts))}), or enter it once: printctl mount --printer "
        f"{there.printer} {options}"
    )


def with_mounted(
    printer: str, named: Mapping[str, str | None], *, refuse: bool = True
) -> dict[str, str | None]:
    """Return what is named, and what is mounted on the printer for parts that aren't.

    Raises
    ------
    SafetyError
        When another profile is mounted than the one named, unless ``refuse`` is unset.
    """
    there = There.kept(printer)
    given = {part: name for part, name in named.items() if name is not None}
    refused = part_checks(there, given) if refuse else []
    if refused:
        raise SafetyError(
            "\n".join(one.remedy for one in refused), dict.fromkeys(one.kind for one in refused)
        )
    return {part: name or there.parts[part] or None for part, name in named.items()}


def _same(part: str, name: str, other: str) -> bool:
    if name == other or not {NONE, ""}.isdisjoint((name, other)):
        return name == other
    first, second = (profile_hash(load(PARTS[part], one)) for one in (name, other))
    return first == second


def refuse_remounted(folder: Path) -> None:
    """Raise `SafetyError` where other parts are mounted now than a print's file was made for.

    A syringe may be another: `resume` is told which. Heads of several aren't compared.
    """
    record = load_record(folder)
    if reported_port(folder, record.port) == SIMULATED:
        return
    names = asdict(load_mounting(record.profile).parts)
    mounted = {
        part: (named(load(PARTS[part], names[part])),)
        for part in ("needle", "ink", "bath", "dish")
        if names.get(part) and names[part] != NONE
    }
    recorded = read_made_for(Path(record.job).read_bytes()[:_OPENING_BYTES])
    alone = {part: profiles for part, profiles in recorded.items() if len(profiles) == 1}
    failed = [check.sentence() for check in differences(alone, mounted)]
    if failed:
        raise SafetyError("\n".join(["nothing was moved:", *failed]))


def refuse_unknown(printer: str, parts: Mapping[str, str | None], needed: Iterable[str]) -> None:
    """Raise `UsageError` for parts that are neither named nor mounted."""
    missing = [part for part in needed if not parts[part]]
    if missing:
        text = _unknown(missing, There(printer, {}), "--{}")
        raise UsageError(f"{' and '.join(missing)} unknown: {text}")


def first_syringe_ul(job: Job, reload_at: Sequence[int], area_mm2: float) -> float:
    """Return the ink that a job pushes before its first change of syringe, µL."""
    return area_mm2 * max(plunger_travel(job.lines[: reload_at[0]] if reload_at else job.lines))


def left_check(needed_ul: float, left_ul: float) -> Check:
    """Compare the ink pushed before the first change of syringe with what the syringe holds."""
    return Check(
        Kind.INK_LEFT,
        "ink that the job takes, of what is in the syringe",
        needed_ul,
        left_ul,
        "µL",
        needed_ul <= left_ul,
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


def mount_parts(
    kept: Mounting, printer: Printer, given: dict[str, Any], fill_ul: float | None
) -> Mounting:
    """Change what is kept, by the station where the printer is connected; return it.

    Parameters
    ----------
    given : dict
        Fields of `MountedParts` to change.
    fill_ul : float or None, µL
        Ink in the syringe; unknown after a change of syringe without it.

    Raises
    ------
    UsageError
        For a printer with several heads, more ink than the syringe holds, or values that the
        machine or its dish can't have.
    Refused
        While a print is running.
    """
    if printer.heads:
        raise UsageError(
            f"{printer.name} has several heads; name what each of them holds for the print itself"
        )
    for part, model in PARTS.items():
        if given.get(part):
            load(model, given[part])
    syringe = given.get("syringe", kept.parts.syringe)
    if fill_ul is not None:
        given["plunger_mm"] = _used_mm(syringe, fill_ul)
    elif "syringe" in given:
        given["plunger_mm"] = None
    folder = Path(kept.holder)
    if kept.holder and alive(folder, STATION_LOCK):
        attach_station(folder).mount(**given)
        return load_mounting(kept.printer)
    if kept.holder and alive(folder):
        raise Refused(
            f"a print is running in {folder}; wait for its end, or change the syringe with "
            f"`printctl reload {folder}`"
        )
    plunger_mm = given.pop("plunger_mm", kept.plunger_mm)
    emptied = {"dish", "bath"} & set(given)
    parts = replace(kept.parts, **({"bath_depth_mm": None} if emptied else {}) | given)
    in_dish = kept.part_in_dish and "dish" not in given
    refuse_impossible(printer, parts, plunger_mm, given)
    kept = replace(kept, parts=parts, plunger_mm=plunger_mm, part_in_dish=in_dish)
    save_mounting(kept)
    # no station's journal is open: what was mounted, and by whom, is written beside it
    with closing(Journal(mounting_file(kept.printer).with_suffix(".log"))) as journal:
        journal.add("asked", do="mount", values={**given, "fill_ul": fill_ul}, **actor())
    return kept


def _used_mm(syringe: str, fill_ul: float) -> float:
    if not syringe:
        raise UsageError("--fill-ul needs the syringe that was filled; add --syringe")
    facts = load(Syringe, syringe)
    if fill_ul > facts.volume_ul:
        raise UsageError(
            f"--fill-ul {fill_ul:g}: {facts.name} holds {facts.volume_ul:g} µL (volume_ul)"
        )
    return (facts.volume_ul - fill_ul) / facts.area_mm2
