"""Plan an exact repeat of a print, list differences from the original, copy its job file.

A job is made ready; nothing is ever started here.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final

from design.files import atomic_replacement, write_text
from firmware_profiles import Bath, Ink, Needle, Printer, ProfileError, Syringe, load
from firmware_profiles.strict_model import Facts
from printctl.history.plain_zip import blocks_of, read_members
from printctl.history.signing import MANIFEST
from printctl.history.verify import verify_bundle
from printctl.machine.ports.detection import list_ports
from printctl.machine.records.journal import digest_of, profile_digest
from printctl.machine.records.lab_key import RecordsError
from printctl.pipeline.past.evidence import Evidence, evidence
from printctl.pipeline.past.past_print import PrintEntry
from printctl.run_folder.manifest import digest_file
from printctl.version import version

MAP: Final = ".map.npz"
_RECIPE: Final = "recipe.json"
_PROFILES: Final = "profiles/"
_SORTS: Final[dict[str, type[Facts]]] = {
    "printer": Printer,
    "needle": Needle,
    "syringe": Syringe,
    "ink": Ink,
    "bath": Bath,
}
_SERIAL: Final = ("/dev/tty", "/dev/cu.", "COM")


@dataclass(frozen=True)
class Difference:
    """Difference from the original print.

    Attributes
    ----------
    what, then, now : str
    """

    what: str
    then: str
    now: str

    def line(self) -> str:
        """For people."""
        return f"{self.what}: was {self.then}, is {self.now}"


@dataclass(frozen=True)
class RepeatPlan:
    """A print that can be done again.

    Attributes
    ----------
    entry : PrintEntry
    gcode : Path
        File of the same bytes; where `bundle` is set, the bundle that holds them.
    bundle : bool
    differences : tuple of Difference
    unknown : tuple of str
        What the journal doesn't say, so that nobody can tell whether it differs.
    set_up : dict
        Names of profiles as the run's recipe has them: profile, needle, syringe, ink, bath ...
    """

    entry: PrintEntry
    gcode: Path
    bundle: bool
    differences: tuple[Difference, ...]
    unknown: tuple[str, ...]
    set_up: dict[str, Any]


def plan_repeat(entry: PrintEntry, bundle: Path | None = None) -> RepeatPlan:
    """Find the same bytes, and hold today against then.

    Parameters
    ----------
    entry : PrintEntry
    bundle : Path, optional
        Where to take the G-code, recipe and profiles from when they aren't here.

    Raises
    ------
    RecordsError
        When the bytes that were printed aren't there any more.
    """
    record = evidence(entry)
    filed = None if record.gcode else _in_bundle(entry, bundle)
    gcode = record.gcode or filed
    if gcode is None:
        raise RecordsError(
            f"print {entry.id} can't be repeated exactly: {record.missing[0]}; give its bundle "
            "(--bundle FILE.zip), or make the job anew from its recipe"
        )
    if filed is not None:
        record = _with_filed(record, filed)
    differences, unknown = list(_differences(record)), list(_unknown(record))
    return RepeatPlan(
        entry, gcode, record.gcode is None, tuple(differences), tuple(unknown), _set_up(record)
    )


def make_job(plan: RepeatPlan, folder: Path) -> Path:
    """Lay the job into a folder of jobs under a name of its own; give its file.

    What differs stands beside it in ``NAME.gcode.repeat.json``.

    Raises
    ------
    RecordsError
        When what was copied isn't what was printed.
    """
    path = _free(folder, plan.entry)
    with atomic_replacement(path) as draft:
        _copy(plan, draft)
        if digest_file(draft) != plan.entry.sha256:
            raise RecordsError(f"{plan.gcode} has changed meanwhile; nothing was made of it")
    beside = plan.gcode.with_suffix(MAP)
    if not plan.bundle and beside.is_file():
        shutil.copyfile(beside, path.with_suffix(MAP))
    facts = {
        "repeats": plan.entry.id,
        "sha256": plan.entry.sha256,
        "differences": [asdict(one) for one in plan.differences],
        "unknown": list(plan.unknown),
        "set_up": plan.set_up,
    }
    write_text(path.with_name(f"{path.name}.repeat.json"), json.dumps(facts, indent=1) + "\n")
    return path


def _in_bundle(entry: PrintEntry, bundle: Path | None) -> Path | None:
    if bundle is None:
        return None
    verified = verify_bundle(bundle, ())
    if not verified.whole or verified.manifest is None:
        raise RecordsError(f"{bundle} isn't whole: {'; '.join(verified.changed)}")
    if verified.manifest.print.sha256 != entry.sha256:
        raise RecordsError(f"{bundle} is of another G-code than print {entry.id}")
    return bundle if any(f.path == "job.gcode" for f in verified.manifest.files) else None


def _with_filed(record: Evidence, bundle: Path) -> Evidence:
    """Add the recipe and profiles of a whole bundle to what this machine knows of the print."""
    files: dict[str, Any] = {}
    with bundle.open("rb") as stream:
        for member in read_members(stream):
            if member.name in (_RECIPE, MANIFEST) or member.name.startswith(_PROFILES):
                files[member.name] = json.loads(b"".join(blocks_of(stream, member)))
    profiles = {
        name.removeprefix(_PROFILES).removesuffix(".json"): values
        for name, values in files.items()
        if name.startswith(_PROFILES)
    }
    by = files[MANIFEST]["versions"].get("printed by")
    facts = {"recipe": files.get(_RECIPE, {}), "profiles": profiles}
    job = {"printer": profiles.get("printer"), "printctl": by}
    return replace(record, facts=record.facts or facts, job=record.job or job)


def entry_of_bundle(bundle: Path) -> PrintEntry:
    """The print that a whole bundle is of, for one that this machine doesn't know.

    Raises
    ------
    RecordsError
        When the bundle isn't whole.
    """
    verified = verify_bundle(bundle, ())
    if not verified.whole or verified.manifest is None:
        raise RecordsError(f"{bundle} isn't whole: {'; '.join(verified.changed)}")
    fields = verified.manifest.print.model_dump(exclude={"alarms"})
    return PrintEntry(journal=bundle.parent / "journal.log", **fields)


def _copy(plan: RepeatPlan, to: Path) -> None:
    if not plan.bundle:
        shutil.copyfile(plan.gcode, to)
        return
    with plan.gcode.open("rb") as stream, to.open("wb") as out:
        (member,) = [one for one in read_members(stream) if one.name == "job.gcode"]
        for block in blocks_of(stream, member):
            out.write(block)


def _free(folder: Path, entry: PrintEntry) -> Path:
    stem = Path(entry.file).stem or "job"
    kept = "".join(c if c.isascii() and (c.isalnum() or c in "-_") else "_" for c in stem)
    kept = kept.lstrip("_-")[:40] or "job"
    for k in range(1, 10_000):
        path = folder / f"{kept}_again_{k}.gcode"
        if not path.exists():
            return path
    raise RecordsError(f"{folder} has ten thousand repeats of {kept}; tidy it up")


def _differences(record: Evidence) -> Iterator[Difference]:
    then = record.job
    if then.get("printctl") and then["printctl"] != version():
        yield Difference("printctl", str(then["printctl"]), version())
    names = {**_set_up(record), "printer": record.entry.profile}
    for sort, model in _SORTS.items():
        values = record.profiles.get(sort)
        if values and names.get(sort):
            yield from _changed(f"{sort}'s profile", str(names[sort]), model, values)
    port = record.entry.port
    if port.startswith(_SERIAL) and port not in [one.device for one in list_ports()]:
        yield Difference("port", port, "not there")


def _changed(
    what: str, name: str, model: type[Facts], then: dict[str, Any]
) -> Iterator[Difference]:
    try:
        now = load(model, name)
    except (ProfileError, OSError) as exc:
        yield Difference(what, name, f"not to be read ({exc})")
        return
    if profile_digest(now) == digest_of(then):
        return
    new = now.model_dump(mode="json")
    for key in sorted({*then, *new}):
        if then.get(key) != new.get(key):
            yield Difference(f"{what} {name}, {key}", str(then.get(key)), str(new.get(key)))


def _unknown(record: Evidence) -> Iterator[str]:
    if "printer" not in record.profiles:
        yield "which values the printer's profile had (its journal or bundle doesn't say)"
    if not record.profiles.keys() & {"needle", "syringe", "ink", "bath"}:
        yield "which needle, syringe, ink and bath were used (the job wasn't made by a run here)"


def _set_up(record: Evidence) -> dict[str, Any]:
    recipe = record.facts.get("recipe", {})
    part = recipe.get("printer", {})
    names = {k: part.get(k) for k in ("syringe", "ink", "bath", "dish", "bath_depth_mm", "heads")}
    names["needle"] = recipe.get("toolpath", {}).get("needle")
    return {"profile": record.entry.profile, **{k: v for k, v in names.items() if v}}
