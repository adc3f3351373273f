"""Request and response types of the print history's REST routes."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any, Literal

from pydantic import BaseModel, Field

from printctl.history.repeat import RepeatPlan
from printctl.history.table import outcome
from printctl.history.verify import BundleCheck
from printctl.machine.link.history_entry import PrintEntry
from printctl.web.history.service import PastPrintDetails


class AlarmResponse(BaseModel):
    """One alarm of a print."""

    at: float = Field(description="s since 1970; 0 where the journal doesn't say")
    text: str


class PastPrint(BaseModel):
    """One print as its journal tells it."""

    id: str
    file: str = Field(description="name of the G-code file")
    sha256: str = Field(description="of the G-code file")
    profile: str = Field(description="printer profile")
    port: str
    operator: str = Field(description="as the print's record names them; may be empty")
    who: str = Field(description="user of the computer")
    host: str
    started: float = Field(description="s since 1970")
    ended: float = Field(description="s since 1970; 0 for not yet")
    state: str = Field(
        description="done, stopped, failed, killed, position_unknown, interrupted or running"
    )
    message: str
    error: str
    done: int = Field(description="command lines that the printer took")
    total: int = Field(description="command lines in the job")
    begun: int = Field(description="how often it was begun or gone on with")
    alarms: list[AlarmResponse]

    @classmethod
    def of(cls, entry: PrintEntry) -> PastPrint:
        """Without where its files lie."""
        values = asdict(entry)
        return cls(**{name: values[name] for name in cls.model_fields})


class PrintsPage(BaseModel):
    """Some of the prints that were asked for."""

    prints: list[PastPrint]
    total: int = Field(description="on all pages")
    offset: int


class EventResponse(BaseModel):
    """Something that happened in a print."""

    at: float = Field(description="s since 1970; 0 where the journal doesn't say")
    after_s: float = Field(description="since the print began")
    kind: str
    text: str


class StateInterval(BaseModel):
    """A time in one state, s since the print began."""

    state: str
    start_s: float
    end_s: float


class WholePrint(BaseModel):
    """One print with all that there is of it."""

    print: PastPrint
    verdict: Literal["pass", "fail", "undecided", ""] = Field(description="of the scan, if any")
    reasons: list[str]
    gcode_there: bool = Field(description="whether the bytes that were printed are still there")
    report: list[str] = Field(description="files of the report")
    photos: list[str]
    note: dict[str, Any] = Field(description="what the operator noted")
    missing: list[str] = Field(description="what isn't there any more, or is of another print")
    events: list[EventResponse]
    more_events: int
    states: list[StateInterval]

    @classmethod
    def of(cls, shown: PastPrintDetails) -> WholePrint:
        """What the service gave."""
        evidence, line = shown.found, shown.line
        reasons = (evidence.verdict or {}).get("reasons", ())
        return cls(
            print=PastPrint.of(shown.entry),
            verdict=outcome(evidence.verdict),
            reasons=[str(text) for text in reasons],
            gcode_there=evidence.gcode is not None,
            report=sorted(evidence.report),
            photos=[n.partition("/")[2] for n in evidence.noted if n.startswith("photos/")],
            note=evidence.note(),
            missing=list(evidence.missing),
            events=[EventResponse(**asdict(one)) for one in line.events] if line else [],
            more_events=line.more if line else 0,
            states=[StateInterval(**asdict(one)) for one in line.stretches] if line else [],
        )


class VerificationResponse(BaseModel):
    """What was found of a bundle."""

    whole: bool
    signature: str = Field(description="trusted, unknown key, wrong, unsigned or unchecked")
    fingerprint: str = Field(description="SHA-256 of the key that signed")
    changed: list[str]
    lines: list[str] = Field(description="the same for people")
    print_id: str
    file: str

    @classmethod
    def of(cls, check: BundleCheck) -> VerificationResponse:
        """What the service gave."""
        past = check.manifest.print if check.manifest and check.whole else None
        return cls(
            whole=check.whole,
            signature=check.signature.value,
            fingerprint=check.fingerprint,
            changed=list(check.changed),
            lines=check.lines(),
            print_id=past.id if past else "",
            file=past.file if past else "",
        )


class DifferenceResponse(BaseModel):
    """Something that isn't as it was when it was printed."""

    what: str
    then: str
    now: str


class RepeatResponse(BaseModel):
    """A print that can be, or was, made ready again."""

    sha256: str
    differences: list[DifferenceResponse]
    unknown: list[str] = Field(description="what nobody can tell whether it differs")
    set_up: dict[str, Any]

    @classmethod
    def of(cls, plan: RepeatPlan) -> RepeatResponse:
        """What the service gave."""
        return cls(
            sha256=plan.entry.sha256,
            differences=[DifferenceResponse(**asdict(one)) for one in plan.differences],
            unknown=list(plan.unknown),
            set_up=plan.set_up,
        )


class JobMade(BaseModel):
    """A job that is ready for the Job page."""

    job: str
