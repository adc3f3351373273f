"""Recipe section on a scan's measurement record: operator, instrument, certificate, conditions."""

from __future__ import annotations

from datetime import date, datetime
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from printctl.recipe.parts import Part


def _as_text(value: Any) -> Any:
    """YAML reads an unquoted date as one; the record keeps text."""
    return value.isoformat() if isinstance(value, date) else value


def _checked_day(value: str) -> str:
    try:
        return date.fromisoformat(value).isoformat()
    except ValueError as exc:
        raise ValueError(f"{value!r} is no date; give one like 2026-03-31") from exc


def _checked_time(value: str) -> str:
    try:
        zone = datetime.fromisoformat(value).tzinfo
    except ValueError as exc:
        raise ValueError(f"{value!r} is no time; give one like 2026-03-31T14:30+02:00") from exc
    if zone is None:
        raise ValueError(f"{value!r} has no time zone; give one like 2026-03-31T14:30+02:00")
    return value


Text = Annotated[str, Field(min_length=1, max_length=200)]
Day = Annotated[str, BeforeValidator(_as_text), AfterValidator(_checked_day)]
Time = Annotated[str, BeforeValidator(_as_text), AfterValidator(_checked_time)]
Celsius = Annotated[float, Field(ge=-50, le=150)]


class CertificatePart(Part):
    """The calibration certificate of the instrument."""

    number: Text | None = None
    issued: Day | None = Field(default=None, description="Date, like 2026-03-31.")
    valid_until: Day | None = Field(default=None, description="Last day, like 2027-03-31.")
    by: Text | None = Field(default=None, description="Laboratory that issued it.")


class RecordPart(Part):
    """What a measurement's report states beside its numbers; what isn't given is "not stated"."""

    instrument: Text | None = Field(default=None, description="Maker and model of the scanner.")
    serial: Text | None = None
    certificate: CertificatePart = CertificatePart()
    operator: Text | None = None
    part: Text | None = Field(default=None, description="Name or number of the part scanned.")
    material: Text | None = Field(default=None, description="Of the part, as you name it.")
    scanned: Time | None = Field(
        default=None, description="Time of the scan with its zone, like 2026-03-31T14:30+02:00."
    )
    temperature_c: Celsius | None = Field(default=None, description="Of bath or room.")
    temperature_range_c: tuple[Celsius, Celsius] | None = Field(
        default=None, description="Lowest and highest temperature the measurement is valid for."
    )
    tolerance_source: Text | None = Field(
        default=None, description="Drawing or specification that the tolerances come from."
    )

    @model_validator(mode="after")
    def _check_rising(self) -> RecordPart:
        span = self.temperature_range_c
        if span is not None and not span[0] < span[1]:
            raise ValueError(
                f"temperature_range_c goes from {span[0]:g} to {span[1]:g} °C; let it rise"
            )
        issued, until = self.certificate.issued, self.certificate.valid_until
        if issued is not None and until is not None and until < issued:
            raise ValueError(
                f"certificate.valid_until {until} lies before certificate.issued {issued}; mend one"
            )
        return self
