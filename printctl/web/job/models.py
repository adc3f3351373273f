"""Request and response types of the Job page's REST routes."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from printctl.web.job.set_up import JobSetUp, Millimetre


class RequestModel(BaseModel):
    """What is sent; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid")


class ResponseModel(BaseModel):
    """What is answered."""


class JobResponse(ResponseModel):
    """A job, and what is known of it without a dry run."""

    id: str = Field(description="run~NAME or file~NAME.")
    name: str
    sha256: str
    size: int = Field(description="Bytes.")
    changed: float = Field(description="s since 1970.")
    duration_s: float | None = Field(description="By the dry run; null before the first.")
    ink_ul: float | None
    layers: int | None = Field(description="Passes of an embedded print.")
    vessels: int | None
    commands: int | None


class CheckResponse(ResponseModel):
    """One check before the print."""

    check: str = Field(description="What was looked at.")
    result: Literal["passed", "failed", "warning"]
    value: float | None = Field(description="What was found, in `unit`.")
    limit: float | None = Field(description="What is allowed, in `unit`.")
    unit: str
    passed: bool
    place: str = Field(description="Line of the G-code, or key of a profile.")
    remedy: str
    weight: Literal["refuses", "warns"]


class PreflightResponse(ResponseModel):
    """The list of checks, and what the dry run found."""

    model_config = ConfigDict(extra="allow")

    job: str
    key: str = Field(description="Of the job's content and the set-up.")
    passed: bool = Field(description="Whether nothing refuses the print.")
    checks: list[CheckResponse]
    sha256: str
    duration_s: float
    layers: int
    vessels: int
    ink_ul: float
    accepted: list[str] = Field(description="What failed and was accepted; the journal keeps it.")
    reload_at: list[int] = Field(description="Commands before each change of syringe.")


class MachineResponse(ResponseModel):
    """The printer that is connected."""

    profile: str
    port: str
    ready: bool
    message: str
    words: str = Field(description="What `confirmed` must say at the start.")
    tip_mm: tuple[float, float, float] | None
    mounted: dict[str, str]
    ul_left: float | None


class FormResponse(ResponseModel):
    """The set-up filled in, and the printer."""

    set_up: JobSetUp
    machine: MachineResponse | None
    checklist: list[dict[str, str]] = Field(description="Points to tick before the start.")


class PreflightRequest(RequestModel):
    """A set-up to check the job with; as it is filled in where it is left out."""

    set_up: JobSetUp | None = None


class StartRequest(RequestModel):
    """A start."""

    set_up: JobSetUp | None = Field(default=None, description="As it is filled in if left out.")
    confirmed: str = Field(max_length=500, description="The machine, as `machine.words` says it.")


class ToStartRequest(RequestModel):
    """A move of the tip to where a job starts."""

    start_mm: tuple[Millimetre, Millimetre, Millimetre] | None = Field(
        default=None, description="As the set-up is filled in if left out."
    )


class TipResponse(BaseModel):
    """Where the tip stands now."""

    tip_mm: tuple[float, float, float] | None


class PauseRequest(RequestModel):
    """When to pause."""

    after: Literal["now", "layer", "vessel"] = "now"


class ResumeRequest(RequestModel):
    """What was put in at a change of syringe."""

    plunger_mm: Annotated[float, Field(ge=0, le=1000)] | None = Field(
        default=None, description="Travel that the new syringe's plunger has used up; 0 when full."
    )
    syringe: Annotated[str, Field(max_length=300)] | None = Field(
        default=None, description="Its profile, where it is another."
    )
    unchanged: bool = Field(default=False, description="The syringe wasn't changed after all.")


class RecoverRequest(RequestModel):
    """Where the rest of a print begins."""

    from_line: Annotated[int, Field(ge=1, le=2**31)] | None = Field(
        default=None, description="Line of the job's file; the last checkpoint if left out."
    )


class RecoveryResponse(ResponseModel):
    """How to go on after the position was lost."""

    lines_left_out: int = Field(description="Commands of the job that aren't printed again.")
    steps: list[str] = Field(description="What a person does first, in order.")
    start_mm: tuple[float, float, float] | None


class RestResponse(ResponseModel):
    """The rest of a print, as a job of its own."""

    job: str
    steps: list[str]


class ReloadRequest(RequestModel):
    """Of several heads, whose syringe."""

    head: Annotated[int, Field(ge=0, le=15)] | None = None


class StatusResponse(ResponseModel):
    """A print as its link process tells it."""

    model_config = ConfigDict(extra="allow")

    state: str
    lines_done: int
    lines_executed: int
    lines_total: int
    message: str
    waits_for: str
    position_known: bool
    deadman_left_s: float | None
    look: dict[str, Any] | None = Field(
        default=None, description="The look that it is held for (state looking): number, mark, ..."
    )


class ActionResponse(ResponseModel):
    """What may be done to a print now."""

    action: Literal["pause", "resume", "stop", "kill", "go_on", "recover", "give_up"]
    possible: bool
    reason: str = Field(description="Why not; empty where it is possible.")
    needs: Literal["", "syringe", "from_line"] = Field(description="What must be given with it.")
    from_line: int = Field(
        default=0, description="Line to begin with where nobody says otherwise; 0: nobody knows."
    )


class PrintResponse(StatusResponse):
    """A print, and how far it has come."""

    job: str
    folder: str
    print_id: str = Field(description="Identity of the print, as the history names it.")
    started: float = Field(description="s since 1970.")
    share: float = Field(description="Of the time where that is known, else of the lines; 0 to 1.")
    words: dict[str, str] = Field(description="State, time, layer, vessel, ink, as people read.")
    time_left_s: float | None = Field(description="null for a print that is over.")
    actions: list[ActionResponse] = Field(description="Each action, and if it is possible now.")
    progress: dict[str, Any] | None = Field(
        description="By time, layer, vessel and ink; null until the job's table is made."
    )


class ViabilityResponse(ResponseModel):
    """The clock of the cells."""

    minutes: float | None
    limit_min: float | None
    source: str
    words: str
    state: Literal["unknown", "in time", "close", "late"]


class TickRequest(RequestModel):
    """A step done, or not after all."""

    done: bool = True


class NoteRequest(RequestModel):
    """A note."""

    text: Annotated[str, Field(min_length=1, max_length=10_000)]


class RampRequest(RequestModel):
    """Warming at a rate."""

    heater: Annotated[str, Field(max_length=40)] = "bed"
    target_c: Annotated[float, Field(ge=0, le=60)]
    rate_c_min: Annotated[float, Field(gt=0, le=20)] = 1.0


class RampResponse(ResponseModel):
    """Warming as it stands."""

    heater: str
    target_c: float
    rate_c_min: float
    now_c: float | None
    set_c: float | None
    going_on: bool
    message: str


class FlushResponse(ResponseModel):
    """How hard the channels may be flushed."""

    pressure_pa: float
    wall_shear_pa: float
    vessel: str


class StepResponse(ResponseModel):
    """A step after the print."""

    id: str
    text: str
    done: bool
    at: float | None
    who: str


class NoteResponse(ResponseModel):
    """A note of a print."""

    at: float
    who: str
    text: str


class PhotoResponse(ResponseModel):
    """A photo of a print."""

    at: float
    who: str
    name: str
