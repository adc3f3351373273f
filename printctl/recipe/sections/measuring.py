"""Recipe sections on the scan and on what its registration is held against."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from printctl.recipe.parts import FILE, Part, Seed, value_given
from printctl.recipe.sections.defects import DefectPart
from printctl.recipe.sections.record import RecordPart
from printctl.recipe.sections.tolerances import Sides, TolerancesPart
from registration.measuring.geometry.datum import read_datums
from registration.measuring.judging.tolerance import DecisionRule, Rule, Tolerances


class SimulatedScan(Part):
    """A scan of what the simulated printer deposited."""

    simulated: Literal["oct", "microct"]
    voxel_um: tuple[float, float, float] | None = Field(
        default=None, description="x, y, z; else as fine as the thinnest vessel needs."
    )
    shrink_percent: Annotated[float, Field(ge=-10, le=20)] = Field(
        default=1.0, description="By how much the part shrank."
    )
    format: Literal["tif", "oct"] = Field(
        default="tif", description="Of the file: TIFF, or Thorlabs' for an OCT."
    )
    spread_percent: Annotated[float, Field(ge=-50, le=100)] = Field(
        default=0.0, description="By how much more ink a line holds than it was dosed."
    )
    seed: Seed | None = Field(default=None, description="Of the noise and the pose; else derived.")
    defects: Annotated[tuple[DefectPart, ...], Field(max_length=100)] = Field(
        default=(), description="Put into the deposit before it is scanned."
    )
    large: bool = Field(default=False, description="The scan may be larger than 1 GB.")

    @model_validator(mode="after")
    def _voxels_are_sensible(self) -> SimulatedScan:
        for value in self.voxel_um or ():
            if not 1 <= value <= 1000:
                raise ValueError(f"voxel {value:g} µm lies outside 1 to 1000 µm; mend voxel_um")
        if self.simulated == "microct" and len(set(self.voxel_um or ())) > 1:
            raise ValueError("a micro-CT's voxels are cubes; give voxel_um three equal sizes")
        if self.simulated == "microct" and self.format == "oct":
            raise ValueError("a micro-CT writes no .oct; leave format out, or say tif")
        return self


class FileScan(Part):
    """A scan from a file."""

    file: str = Field(
        min_length=1, description="Path, relative to the recipe.", json_schema_extra=FILE
    )
    voxel_um: tuple[float, float, float] | None = Field(
        default=None, description="Size of a voxel, x, y, z, where the file doesn't say."
    )
    refractive_index: Annotated[float, Field(ge=1, le=2)] | None = Field(
        default=None, description="Group index of gel and liquid."
    )
    optical_depth: bool | None = Field(
        default=None, description="Whether the depth voxel counts optical path."
    )
    modality: Literal["oct", "microct", "confocal"] | None = Field(
        default=None, description="What measured."
    )
    scale: Literal["linear", "db"] | None = Field(default=None, description="Of the intensity.")
    db_range: tuple[float, float] | None = Field(
        default=None, description="dB of the lowest and the highest count of an integer scan."
    )
    count_range: tuple[float, float] | None = Field(
        default=None, description="Counts that mean db_range; else the range of their type."
    )
    counts_per_db: Annotated[float, Field(gt=0)] | None = Field(
        default=None, description="In place of db_range."
    )
    db_at_zero: float | None = Field(default=None, description="dB of count 0, with counts_per_db.")
    axes: str | None = Field(
        default=None, description="Order of the file's axes, slowest first, like zyx."
    )
    depth_down: bool | None = Field(
        default=None, description="Whether growing depth index goes down into the sample."
    )
    mirrored: bool | None = Field(
        default=None, description="Whether the file's x, y, z are left-handed."
    )
    filled: bool = Field(
        default=False, description="Lumens are brighter than the gel: filled with contrast agent."
    )
    oct_calibration: str | None = Field(
        default=None,
        description="File of `printctl calibrate oct`, relative to the recipe.",
        json_schema_extra=FILE,
    )
    walls: str | None = Field(
        default=None,
        description="Old name for a file of walls; give it as oct_calibration.",
        json_schema_extra=FILE,
    )
    air_above: bool = Field(
        default=False, description="Air lies above the sample: undo refraction at its surface."
    )
    record: RecordPart | None = Field(
        default=None, description="Instrument, operator, conditions, for the report."
    )


def _scan_kind(value: Any) -> str:
    return "file" if value_given(value, "file") is not None else "simulated"


ScanPart = Annotated[
    Annotated[SimulatedScan, Tag("simulated")] | Annotated[FileScan, Tag("file")],
    Discriminator(_scan_kind),
]


def _checked_datums(value: list[str]) -> list[str]:
    read_datums(value)
    return value


class RegistrationPart(Part):
    """What the print is held against."""

    tolerance_um: Annotated[float, Field(gt=0, le=5000)] = Field(
        default=100.0, description="RMS deviation, scaled fit, above which the verdict is fail."
    )
    diameter_tolerance_percent: Sides = Field(
        default=10.0,
        description="Error of a diameter, in any section, beyond which it fails, like 10 or "
        "+10/-5.",
    )
    decision_rule: Literal["guarded", "conformance", "shared_risk"] = Field(
        default="conformance",
        description="How limits count uncertainty: conformance (probability that the vessel "
        "conforms), guarded (ISO 14253-1) or shared_risk (the value alone).",
    )
    conformance_percent: Annotated[float, Field(gt=50, lt=100)] = Field(
        default=100 * Rule.level,
        description="Of the rule conformance: probability from which on a vessel passes.",
    )
    tolerances: TolerancesPart | None = Field(
        default=None, description="Finer limits: by vessel, by feature, in µm, or of one side."
    )
    datums: Annotated[list[str], AfterValidator(_checked_datums)] = Field(
        default=[],
        description="Datum features, primary first, like [face -z, axis 3]; else best fit.",
    )

    @model_validator(mode="after")
    def _check_once(self) -> RegistrationPart:
        finer, given = self.tolerances, self.model_fields_set
        for name, other in _SAME.items():
            if finer is not None and name in given and getattr(finer, other) is not None:
                raise ValueError(
                    f"{name} and tolerances.{other} both set one limit; leave one of them out"
                )
        return self

    def all_tolerances(self) -> Tolerances:
        """What every section, vessel and feature is held against."""
        part = self.tolerances or TolerancesPart()
        rule = Rule(DecisionRule(self.decision_rule), self.conformance_percent / 100)
        return part.tolerances(self.tolerance_um, self.diameter_tolerance_percent, rule)


_SAME = {"tolerance_um": "rms_um", "diameter_tolerance_percent": "diameter_percent"}
