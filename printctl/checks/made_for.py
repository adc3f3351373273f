"""Record of the set-up that a job was made for, in comment lines at the top of its G-code.

One line for each part, such as ``; printctl syringe: Hamilton 1 mL gastight #1f2e3d4c5b6a``: the
name of its profile and a hash of the profile's facts. Firmwares ignore comments; every command that
prints or simulates the file compares them with what is mounted.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

from firmware_profiles import Bath, Dish, Facts, Ink, Needle, Printer, Syringe
from printctl.checks.kinds import Kind
from printctl.checks.set_up import Check, SetUp, finding
from printctl.errors import SafetyError

PARTS: Final[dict[str, type[Facts]]] = {
    "printer": Printer,
    "syringe": Syringe,
    "needle": Needle,
    "ink": Ink,
    "bath": Bath,
    "dish": Dish,
}
_LINE: Final = re.compile(rb"[#;(/' \t]*printctl (\w+): (.*) #([0-9a-f]{12})[) \t\r]*\Z")
_PROVENANCE: Final = frozenset({"name", "source", "licence", "starting_values", "calibrated"})
"""Keys that change nothing of what a job does."""


@dataclass(frozen=True)
class NamedProfile:
    """Name and hash of a profile as a job's record has them."""

    name: str
    hash: str


MadeFor = Mapping[str, tuple[NamedProfile, ...]]
"""Part (a key of `PARTS`) to its profiles, one for each head; unnamed parts are absent."""


class Loading(Protocol):
    """What a head holds; a needle that nobody named is None."""

    @property
    def syringe(self) -> Syringe:
        """The syringe in it."""

    @property
    def ink(self) -> Ink:
        """The ink in that."""

    @property
    def needle(self) -> Needle | None:
        """The needle on it."""


def profile_hash(facts: Facts) -> str:
    """Return 12 hexadecimal digits of the SHA-256 of a profile's facts, without its provenance."""
    data = facts.model_dump(mode="json", exclude=set(_PROVENANCE))
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()[:12]


def named(facts: Facts) -> NamedProfile:
    """Return a profile's name and hash."""
    return NamedProfile(facts.name, profile_hash(facts))


def made_for(
    printer: Printer,
    loads: Sequence[Loading],
    bath: Bath | None = None,
    dish: Dish | None = None,
) -> MadeFor:
    """Return the record of a set-up; ``loads`` has what each head holds."""
    facts: dict[str, Sequence[Facts | None]] = {
        "printer": [printer],
        "syringe": [] if printer.airs else [one.syringe for one in loads],
        "needle": [one.needle for one in loads],
        "ink": [one.ink for one in loads],
        "bath": [bath],
        "dish": [dish],
    }
    return {
        part: tuple(named(one) for one in those if one is not None)
        for part, those in facts.items()
        if those and None not in those
    }


def header_lines(recorded: MadeFor) -> tuple[str, ...]:
    """Return the record's text, a line a profile, without the comment character."""
    return tuple(
        f"printctl {part}: {' '.join(one.name.split())} #{one.hash}"
        for part, those in recorded.items()
        for one in those
    )


def read_made_for(opening: bytes) -> MadeFor:
    """Return the record in a file's lines before its first command; empty where it has none."""
    found: dict[str, tuple[NamedProfile, ...]] = {}
    for line in opening.split(b"\n"):
        match = _LINE.match(line)
        if match is None or (part := match[1].decode()) not in PARTS:
            continue
        name = match[2].decode("utf-8", "replace")
        found[part] = (*found.get(part, ()), NamedProfile(name, match[3].decode()))
    return found


def is_recorded(recorded: MadeFor, printer: Printer) -> bool:
    """Return whether a record names what every dose depends on; a header that was cut doesn't."""
    needed = {"printer"} if printer.airs else {"printer", "syringe"}
    return needed <= set(recorded)


def set_up_checks(recorded: MadeFor, setup: SetUp) -> list[Check]:
    """Compare what a job was made for with what is mounted: a refusal for each difference.

    A part that either side doesn't name isn't compared.
    """
    return differences(recorded, record_of(setup))


def record_of(setup: SetUp) -> MadeFor:
    """Return the record of a job that is made for a set-up."""
    dish = None if setup.standing is None else setup.standing.dish
    heads = [setup.load_of(number) for number in range(setup.printer.head_count)]
    return made_for(setup.printer, heads, setup.bath, dish)


def refuse_other(recorded: MadeFor, mounted: MadeFor) -> None:
    """Raise `SafetyError` where a measurement was made with another set-up."""
    failed = [check.sentence() for check in differences(recorded, mounted)]
    if failed:
        raise SafetyError("\n".join(["the measurement is of another set-up:", *failed]))


def differences(recorded: MadeFor, mounted: MadeFor) -> list[Check]:
    """Return a refusal for each part that both records name differently."""
    return [
        _difference(part, of_job, of_mount)
        for part, of_job in recorded.items()
        if (of_mount := mounted.get(part)) is not None and _hashes(of_job) != _hashes(of_mount)
    ]


def _hashes(profiles: Iterable[NamedProfile]) -> list[str]:
    return [one.hash for one in profiles]


def _difference(
    part: str, of_job: tuple[NamedProfile, ...], of_mount: tuple[NamedProfile, ...]
) -> Check:
    wanted, there = (", ".join(one.name for one in those) for those in (of_job, of_mount))
    if wanted == there:
        text = (
            f"the profile of {there!r} was changed after the job was made; make the job again with "
            "the changed profile"
        )
    else:
        text = (
            f"the job was made for {wanted!r}, and {there!r} is mounted; mount {wanted!r}, or make "
            f"the job again for {there!r}"
        )
    return finding(Kind.MADE_FOR, f"{part} that the job was made for", "", text)
