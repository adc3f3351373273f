"""Check a job for a print, and make its order: the one way for every command and the page.

Goes in: a G-code file, what is mounted (`SetUp`), and how it is to be printed (`OrderCare`). Comes
out: a `CheckedOrder`, its findings of `printctl.checks.kinds`. What differs between the command
line, the page, a recipe and a plate differs in these arguments alone.

Functions import the dry run and its checks themselves: both load kernels, and the page and each
command import this module when they start.
"""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from pydantic import ValidationError

from firmware_profiles import Printer
from firmware_profiles.errors import wording
from gcode.user_files import read_gcode_path
from printctl.checks.kinds import Kind
from printctl.checks.set_up import (
    Check,
    Point,
    SetUp,
    finding,
    of_each,
    refusal_of,
    refuse_failed,
    shortest_budget,
)
from printctl.errors import SafetyError, UsageError
from printctl.machine.errors import JobError, LinkError
from printctl.machine.job.care import Care
from printctl.machine.job.coordinates import declared_start
from printctl.machine.job.job import Job, parse_job
from printctl.machine.job.syringes import Reloads, usable_mm, with_reloads
from printctl.machine.prints.follow import retreat_for
from printctl.machine.prints.mounted import There, first_syringe_ul, left_check, part_checks
from printctl.machine.process.orders import ASIDE_MM, Order
from printctl.recipe.sections.making import CarePart

if TYPE_CHECKING:
    from gcode.dry_run.run import DryRun
    from printctl.checks.preflight.set_up import Designed
    from printctl.checks.preflight.shaft import FileShaft

MIN_LIFT_MM: Final = 20.0
"""Of a stop or pause: room for a hand between needle and dish."""
ABOVE_MM: Final = 5.0
"""Between what the needle leaves (part, bath) and the tip."""


def care_part(**values: Any) -> CarePart:
    """Return what a user says of a print's care.

    Raises
    ------
    UsageError
        For values that contradict each other.
    """
    try:
        return CarePart(**values)
    except ValidationError as exc:
        raise UsageError("; ".join(map(wording, exc.errors()))) from exc


@dataclass(frozen=True)
class OrderCare:
    """How a job is to be printed, as far as its checks and its order depend on it.

    Attributes
    ----------
    part : CarePart
    real : bool
        Whether a machine moves, so that parts which nobody named refuse the print.
    allowed_crossings : int
        Pairs of vessels that the needle's shaft may cross.
    accept_crossings : bool
        Whether it may cross any; the journal keeps which.
    designed : Designed or None
        What a recipe knows of the part.
    there : There or None
        What was entered of the machine; None where none is compared.
    assumed : container of str
        Parts that nobody named.
    """

    part: CarePart = field(default_factory=CarePart)
    real: bool = False
    allowed_crossings: int = 0
    accept_crossings: bool = False
    designed: Designed | None = None
    there: There | None = None
    assumed: Container[str] = ()


@dataclass(frozen=True)
class Plan:
    """What a print's order needs of its checks; also as a JSON object.

    Attributes
    ----------
    lift_mm : float, mm
        Of the needle in a stop or pause, from wherever in the part.
    first_ul : float, µL
        Ink pushed before the first change of syringe.
    reload_at, reload_heads : tuple of int
        As in `Care`.
    accepted : tuple of str
        What failed and was accepted, for the journal.
    """

    lift_mm: float
    first_ul: float = 0.0
    reload_at: tuple[int, ...] = ()
    reload_heads: tuple[int, ...] = ()
    accepted: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """As a JSON object."""
        return {name: list(v) if isinstance(v, tuple) else v for name, v in asdict(self).items()}

    @staticmethod
    def from_dict(data: dict[str, Any]) -> Plan:
        """Read `to_dict`; other keys are ignored."""
        own: dict[str, Any] = {name: data[name] for name in Plan.__dataclass_fields__}
        lists = {name: tuple(v) for name, v in own.items() if isinstance(v, list)}
        return Plan(**own | lists)


@dataclass(frozen=True)
class CheckedOrder:
    """A job's findings, and the order that they allow.

    Attributes
    ----------
    set_up : SetUp
    care : OrderCare
    data : bytes
        The job's file.
    run : DryRun
    job : Job or None
        None for a file with lines that can't be sent, which `checks` refuse.
    shaft : FileShaft
    checks : tuple of Check
        Passed or not.
    plan : Plan
    offers_reload : bool
        Whether changes of syringe that weren't asked for would do.
    facts : dict
        Print time and what the cells have, JSON-ready.
    """

    set_up: SetUp
    care: OrderCare
    data: bytes
    run: DryRun
    job: Job | None
    shaft: FileShaft
    checks: tuple[Check, ...]
    plan: Plan
    offers_reload: bool
    facts: dict[str, Any]

    @property
    def refusal(self) -> SafetyError | None:
        """The error that names all that refuses the print; None where nothing does."""
        return refusal_of(self.checks)

    def complete(self, order: Order) -> Order:
        """Return an order with the retreat and the care that were checked.

        Raises
        ------
        SafetyError
            Where a check refuses the print.
        """
        refuse_failed(self.checks)
        return completed(order, self.set_up, self.care.part, self.plan)


def checked_order(job: Path, set_up: SetUp, care: OrderCare) -> CheckedOrder:
    """Check a job as it is set up, plan its changes of syringe and the lift of a stop.

    Raises
    ------
    OSError, GcodeError
        For a file that can't be read.
    UsageError
        For a map beside it that is of another file or can't be read.
    """
    from gcode.dry_run.run import dry_run
    from printctl.checks.preflight.ink import PrintTime, viability_checks, viability_facts
    from printctl.checks.preflight.set_up import file_checks
    from printctl.checks.preflight.shaft import file_shaft

    data = read_gcode_path(job)
    run = dry_run(data, set_up.printer, set_up.start_mm or (0.0, 0.0, 0.0))
    line_map = job.with_suffix(".map.npz")
    shaft = file_shaft(
        job, run, set_up, allowed=care.allowed_crossings, accepted=care.accept_crossings
    )
    checks = file_checks(run, set_up, line_map, real=care.real, designed=care.designed)
    parsed: Job | None = None
    try:
        parsed = parse_job(data, job.name, set_up.printer)
    except JobError as exc:
        if not any(one.refuses for one in checks):
            checks.append(finding(Kind.BAD_LINE, "lines that can't be sent", "", str(exc)))
        reloads = Reloads(checks)
    else:
        checks += start_checks(parsed, set_up)
        reloads = with_reloads(
            checks, parsed, usable_of(set_up), wanted=care.part.reload, by=set_up.keys.reload
        )
    budget = shortest_budget(set_up.inks, care.part.viability_min, care.part.viability_source)
    time = PrintTime(run.duration_s, len(reloads.at), care.part.reload_min)
    area = set_up.syringe.area_mm2
    plan = Plan(
        lift_of(run, set_up, care.designed, line_map),
        0.0 if parsed is None else first_syringe_ul(parsed, reloads.at, area),
        reloads.at,
        reloads.heads,
        shaft.accepted,
    )
    every = [*reloads.checks, *viability_checks(time, budget), *shaft.checks]
    if care.there is not None:
        every += machine_checks(set_up, care.there, plan, care.assumed)
    facts = {"duration_s": run.duration_s, **viability_facts(time, budget)}
    return CheckedOrder(
        set_up, care, data, run, parsed, shaft, tuple(every), plan, reloads.offered, facts
    )


def told_start(gcode: bytes, name: str, printer: Printer) -> Point | None:
    """Return where a job's first lines say that the tip stands, mm; None where they don't.

    `start_checks` refuses a job that tells a part of it alone.
    """
    from gcode.program.read_program import declared_start as declared_in_text

    try:
        return declared_start(parse_job(gcode, name, printer))
    except JobError:  # so that its other checks begin where it does
        return declared_in_text(gcode, printer)
    except LinkError:
        return None


def start_checks(job: Job, set_up: SetUp) -> list[Check]:
    """Refuse a start of which the job tells a part alone, or another than the tip's."""
    what, where = "start of the job", set_up.keys.part.format("start")
    try:
        declared = declared_start(job)
    except LinkError as exc:
        if set_up.start_mm is not None:
            return []
        return [finding(Kind.START, what, where, f"{exc}, or specify --start X,Y,Z")]
    if declared is None or set_up.start_mm is None:
        return []
    away = math.dist(set_up.start_mm, declared)
    remedy = (
        f"the first lines of {job.name} set the tip position to "
        f"{','.join(f'{mm:g}' for mm in declared)}; omit --start, or correct the file"
    )
    return [Check(Kind.START, what, away, ASIDE_MM, "mm", away <= ASIDE_MM, where, remedy)]


def machine_checks(
    set_up: SetUp, there: There, plan: Plan, assumed: Container[str] = ()
) -> list[Check]:
    """Compare what a print needs with what was entered of the machine.

    Of several heads nothing can be entered, so each part must be named.
    """
    if set_up.printer.heads:
        there = replace(there, parts={}, left_ul=None)
    checks = part_checks(there, set_up.names, assumed, set_up.keys.part)
    return checks if there.left_ul is None else [*checks, left_check(plan.first_ul, there.left_ul)]


def usable_of(set_up: SetUp) -> list[float]:
    """Return the plunger travel of a full syringe of each head, mm."""
    return [usable_mm(one.syringe, set_up.printer.of_head(k)) for k, one in enumerate(set_up.loads)]


def lift_of(run: DryRun, set_up: SetUp, designed: Designed | None, line_map: Path) -> float:
    """Return by how much a needle is raised to leave part, bath and well, from wherever in it, mm.

    At least `MIN_LIFT_MM`; the top of the axis ends it.
    """
    from gcode.program.modal import MOVE
    from printctl.checks.preflight.set_up import read_map_wells

    program = run.program
    writes = run.doses & (program.kind == MOVE)
    heights = np.concatenate([program.before[writes, 2], program.target[writes, 2]])
    lowest = float(heights.min(initial=np.inf))
    lifts = [MIN_LIFT_MM]
    if len(heights):
        tops = [float(heights.max())]
        standing = set_up.standing
        if standing is not None and standing.bath_mm is not None:
            tops.append(standing.floor_mm + standing.bath_mm)
        lifts += [top - lowest + ABOVE_MM for top in tops]
    if designed is not None:
        lifts.append(designed.depth_mm + ABOVE_MM)
    if (wells := read_map_wells(run, set_up, line_map)) is not None:
        lifts.append(wells.safe_z_mm - wells.floor_mm)
    return max(lifts)


def completed(order: Order, set_up: SetUp, part: CarePart, plan: Plan) -> Order:
    """Return an order with the retreat of each head and with how it is watched over."""
    names: Sequence[str] = of_each(set_up.printer, set_up.names["syringe"], "--syringe")
    usable, several = usable_of(set_up), len(set_up.loads) > 1
    first, *others = (
        retreat_for(one.syringe, one.ink, plan.lift_mm, part.prime_ul) for one in set_up.loads
    )
    care = Care(
        checkpoint_s=part.checkpoint_every_s,
        deadman_s=60.0 * part.deadman_min,
        deadman_stops=part.deadman_stops,
        syringe=names[0],
        capacity_mm=usable[0],
        reload_at=plan.reload_at,
        reload_heads=plan.reload_heads,
        head_syringes=tuple(names) if several else (),
        head_capacity_mm=tuple(usable) if several else (),
        accepted=plan.accepted,
        silent_limit_s=part.silent_limit_s,
        noise_limit=part.noise_limit,
        start_mm=set_up.start_mm or (0.0, 0.0, 0.0),
        set_up=set_up.words,
    )
    return replace(order, retreat=replace(first, others=tuple(others)), care=care)
