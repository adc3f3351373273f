"""Read, check and write the compensation file: geometry corrections derived from earlier prints.

Goes in: a YAML file. Comes out: checked corrections, and the same back.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import Field, ValidationError

from design.files import write_text
from design.toolpath.correction import Corrections, Stretch
from firmware_profiles.errors import wording
from firmware_profiles.yaml_file import read_yaml
from printctl.errors import UsageError
from printctl.recipe.parts import Part

Number = Annotated[float, Field(allow_inf_nan=False)]
Three = tuple[Number, Number, Number]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class DesignPart(Part):
    """Which design it belongs to."""

    network_sha256: Sha256
    solid_sha256: Sha256
    bounds_mm: Annotated[tuple[Three, Three], Field(description="Of the construct.")]


class PrintConditions(Part):
    """How the prints were made that it was measured on."""

    method: Literal["fresh", "embedded"]
    printer: str
    needle: str
    ink: str
    bath: str
    layer_um: Number | None = None
    line_um: Number | None = None


class PrintPart(Part):
    """A print that it rests on."""

    folder: str
    recipe_sha256: Sha256
    registration_sha256: Sha256
    scan_sha256: Sha256 | None
    compensation_sha256: Sha256 | None = Field(
        default=None, description="Of the compensation that this print was itself made with."
    )
    scale: Three
    scale_interval_95: tuple[Number | None, Number | None, Number | None]


class StretchPart(Part):
    """The part as a whole."""

    factor: Three = Field(default=(1.0, 1.0, 1.0), description="Written over designed, x, y, z.")
    about_mm: Three = Field(description="What stays in place: the middle, at the foot's height.")
    depth: str = Field(default="", description="Why z was or wasn't corrected.")


class RadialPart(Part):
    """Every lumen's radius, linear in its designed diameter."""

    offset_um: Number = 0.0
    slope_um_per_mm: Number = 0.0
    at_mm: Number = 0.0
    from_mm: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    to_mm: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 1000.0


class VesselPart(Part):
    """One vessel's diameter."""

    vessel: Annotated[int, Field(ge=0)]
    diameter_um: Number


class NodePart(Part):
    """One node's place."""

    node: Annotated[int, Field(ge=0)]
    offset_um: Three


class GainPart(Part):
    """How much of what was measured is corrected at once."""

    whole: Annotated[float, Field(gt=0, le=1)] = Field(
        default=1.0, description="Share of scale and radial offset corrected at once."
    )
    local: Annotated[float, Field(gt=0, le=1)] = Field(
        default=0.7, description="Share of local corrections made at once."
    )


class CompensationFile(Part):
    """The whole file."""

    schema_version: Literal[1] = Field(alias="printctl_compensation")
    design: DesignPart
    made_with: PrintConditions
    simulated: bool = Field(description="Whether a simulated scan is among its evidence.")
    prints: Annotated[tuple[PrintPart, ...], Field(min_length=1)]
    gain: GainPart = GainPart()
    stretch: StretchPart
    radial: RadialPart = RadialPart()
    vessels: tuple[VesselPart, ...] = ()
    nodes: tuple[NodePart, ...] = ()
    evidence: dict[str, Any] = Field(default={}, description="Measured and decided; not read.")
    notes: tuple[str, ...] = ()


SUFFIXES = (".json", ".yaml", ".yml")


def save_compensation(path: Path, made: CompensationFile) -> None:
    """Write a file, JSON or YAML by its suffix; same content, same bytes.

    Raises
    ------
    UsageError
        For another suffix.
    OSError
        When it can't be written.
    """
    check_suffix(path)
    data = made.model_dump(mode="json", by_alias=True)
    if path.suffix.lower() == ".json":
        write_text(path, json.dumps(data, indent=1, allow_nan=False) + "\n")
        return
    write_text(path, yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=100))


def check_suffix(path: Path) -> None:
    """Refuse a name that says no format.

    Raises
    ------
    UsageError
    """
    if path.suffix.lower() not in SUFFIXES:
        raise UsageError(f"{path}: a compensation is written as .yaml or .json; name it so")


def load_compensation(path: Path) -> CompensationFile:
    """Read and check a file.

    Raises
    ------
    UsageError
        When it isn't there or isn't one: what is wrong, and where.
    """
    try:
        data: Any = read_yaml(path.read_text(encoding="utf-8"))
    except OSError as exc:
        raise UsageError(
            f"compensation {path} can't be read: {exc.strerror}; check the path, or make it with "
            "`printctl compensate RUN --out FILE`"
        ) from exc
    except (yaml.YAMLError, UnicodeDecodeError) as exc:
        raise UsageError(f"{path} is neither YAML nor JSON: {exc}") from exc
    if not isinstance(data, dict) or "printctl_compensation" not in data:
        raise UsageError(
            f"{path} isn't a compensation (no key printctl_compensation); make one with "
            "`printctl compensate RUN --out FILE`"
        )
    try:
        return CompensationFile.model_validate(data)
    except ValidationError as exc:
        raise UsageError(_wrong(path, exc)) from exc


def _wrong(path: Path, exc: ValidationError) -> str:
    first = exc.errors()[0]
    place = ".".join(map(str, first["loc"])) or "the file"
    more = f" ({exc.error_count() - 1} more)" if exc.error_count() > 1 else ""
    value = first["input"]
    shown = "" if isinstance(value, dict | list) else f" (is {value!r})"
    return f"{path}: {place}: {wording(first)}{shown}{more}; make the file anew"


def corrections_of_file(made: CompensationFile) -> Corrections:
    """What the toolpath needs of it, in mm."""
    return Corrections(
        stretch=Stretch(made.stretch.factor, made.stretch.about_mm),
        radial_mm=made.radial.offset_um * 1e-3,
        radial_slope=made.radial.slope_um_per_mm * 1e-3,
        radial_at_mm=made.radial.at_mm,
        radial_range_mm=(made.radial.from_mm, max(made.radial.from_mm, made.radial.to_mm)),
        diameter_mm={part.vessel: part.diameter_um * 1e-3 for part in made.vessels},
        offset_mm={part.node: _mm(part.offset_um) for part in made.nodes},
    )


def _mm(offset_um: tuple[float, float, float]) -> tuple[float, float, float]:
    x, y, z = offset_um
    return (x * 1e-3, y * 1e-3, z * 1e-3)


def changes_line(made: CompensationFile) -> str:
    """For the report and the command line: sizes, lumens, axes; what is left alone is said too."""
    x, y, z = made.stretch.factor
    parts = [f"x × {x:.4f}, y × {y:.4f}"]
    parts.append(f"z × {z:.4f}" if z != 1 else "depth as designed")
    parts.append(_radial(made))
    if made.vessels:
        worst = max((part.diameter_um for part in made.vessels), key=abs)
        parts.append(f"{_count(len(made.vessels), 'vessel')} by up to {worst:+.0f} µm in diameter")
    if made.nodes:
        most = max(sum(v * v for v in part.offset_um) ** 0.5 for part in made.nodes)
        parts.append(f"{_count(len(made.nodes), 'node')} moved by up to {most:.0f} µm")
    return "; ".join(parts).replace("-", "\N{MINUS SIGN}")


def evidence_lines(made: CompensationFile) -> list[str]:
    """What prints were like, each number with its interval."""
    scale, diameter = made.evidence["scale"], made.evidence["diameter"]
    sizes = ", ".join(
        f"{axis} {100 * (one['size'] - 1):+.2f} ± {100 * one['interval_95']:.2f} %"
        for axis, one in scale.items()
    )
    return [
        f"{_count(len(made.prints), 'print')}: size {sizes}",
        f"diameters {diameter['excess_um']:+.1f} ± {diameter['interval_95_um']:.1f} µm "
        f"once size is corrected ({'corrected' if diameter['corrected'] else 'not corrected'})",
    ]


def _radial(made: CompensationFile) -> str:
    radial = made.radial
    if not radial.offset_um and not radial.slope_um_per_mm:
        return "no radial offset"
    text = f"lumens' radius {radial.offset_um:+.1f} µm"
    if radial.slope_um_per_mm:
        text += f" at {radial.at_mm:.2f} mm, {radial.slope_um_per_mm:+.1f} µm per mm of diameter"
    return text


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
