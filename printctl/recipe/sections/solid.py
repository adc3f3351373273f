"""Recipe section on the printed solid: lumens or tubes, fittings, marks, files."""

from __future__ import annotations

from dataclasses import fields
from typing import Annotated, Final, Literal

from pydantic import Field, model_validator

from design.solids import Chamber, Connector, check_connector
from printctl.recipe.parts import Length, Part, Point

Size = Annotated[float, Field(gt=0, le=200, allow_inf_nan=False)]
Wall = Annotated[float, Field(gt=0, le=50, allow_inf_nan=False)]
_MANY_VESSELS: Final = 500
"""Above it, a file with facets of 1 µm is too large for most programs that show it."""
_MANY_VESSELS_FACETS: Final = 0.05
Format = Literal["stl", "3mf", "step", "ply", "obj", "vtp"]


class ConnectorPart(Part):
    """A fitting at the network's inlets or outlets."""

    kind: Literal["plain", "barb", "luer_female", "luer_male"]
    bore_mm: Size = Field(description="Diameter of the channel through it.")
    outer_mm: Size = Field(default=6.5, description="Of the tube, the barb's shank, the socket.")
    length_mm: Size = 10.0
    barb_mm: Annotated[float, Field(ge=0, le=10)] = Field(
        default=0.8, description="By how much a barb is wider than its shank."
    )
    barbs: Annotated[int, Field(ge=1, le=20)] = 2

    @property
    def connector(self) -> Connector:
        """The fitting."""
        return Connector(**{field.name: getattr(self, field.name) for field in fields(Connector)})

    @model_validator(mode="after")
    def _can_be_made(self) -> ConnectorPart:
        check_connector(self.connector)
        return self


class TubePart(Part):
    """The network as tubes, in the place of a tissue with lumens."""

    wall_mm: Wall


class ChamberPart(Part):
    """A bioreactor around the construct, open at its top: a file of its own."""

    shape: Literal["block", "cylinder"] = "block"
    clearance_mm: Length = Field(default=1.0, description="Around the construct.")
    headroom_mm: Length = Field(default=1.0, description="Over the construct, up to the rim.")
    wall_mm: Wall = 2.0
    floor_mm: Wall = 2.0
    ledge_mm: Annotated[float, Field(ge=0, le=50)] = Field(
        default=0.0, description="Of a step in the rim for a lid; 0 for none."
    )
    ledge_depth_mm: Wall = 1.0
    inlets: ConnectorPart | None = None
    outlets: ConnectorPart | None = None

    @model_validator(mode="after")
    def _ledge_fits(self) -> ChamberPart:
        if not self.ledge_mm < self.wall_mm:
            raise ValueError(
                f"ledge_mm {self.ledge_mm:g} isn't below wall_mm {self.wall_mm:g}; "
                "make the wall thicker or the ledge narrower"
            )
        return self

    def around(self, inner_mm: tuple[float, float, float]) -> Chamber:
        """The chamber of these inner lengths."""
        return Chamber(
            self.shape, inner_mm, self.wall_mm, self.floor_mm, self.ledge_mm, self.ledge_depth_mm
        )


class MarkPart(Part):
    """Where a mark stands on a flat face of the construct."""

    at_mm: Point
    along: Point = (1.0, 0.0, 0.0)
    outward: Point = (0.0, 0.0, 1.0)

    @model_validator(mode="after")
    def _is_a_frame(self) -> MarkPart:
        (a, b, c), (x, y, z) = self.along, self.outward
        across = (b * z - c * y) ** 2 + (c * x - a * z) ** 2 + (a * y - b * x) ** 2
        if not across > 1e-12 * (a * a + b * b + c * c) * (x * x + y * y + z * z):
            raise ValueError(
                f"along {self.along} and outward {self.outward} must be two directions; outward "
                "is the face's normal, along lies in the face"
            )
        return self


class TextPart(MarkPart):
    """Letters on a face."""

    text: Annotated[str, Field(min_length=1, max_length=200, pattern=r"\S")]
    height_mm: Size = Field(default=2.0, description="Of a capital letter.")
    depth_mm: Wall = 0.3
    engraved: bool = True


class FiducialPart(MarkPart):
    """Three dimples that fit in one pose only."""

    size_mm: Size = Field(default=5.0, description="Length of the pattern's long leg.")
    diameter_mm: Wall = 0.8


class SolidPart(Part):
    """How the network becomes a surface."""

    fillet_ratio: Annotated[float, Field(ge=0, le=1)] = Field(
        default=0.0,
        description="Radius of the rounding in a junction's corners, over its thinnest vessel's.",
    )
    facet_percent: Annotated[float, Field(ge=0, le=10)] | None = Field(
        default=None,
        description="Greatest distance of a facet from a vessel's wall, % of its radius, where "
        "that is above 1 µm; by default 0, and 5 for more than 500 vessels.",
    )
    tubes: TubePart | None = Field(
        default=None, description="Tubes in the place of the tissue; by default its lumens."
    )
    inlets: ConnectorPart | None = Field(
        default=None, description="A fitting wherever flow comes in through a face."
    )
    outlets: ConnectorPart | None = Field(default=None, description="Wherever it leaves.")
    texts: tuple[TextPart, ...] = Field(default=(), max_length=100)
    fiducials: tuple[FiducialPart, ...] = Field(default=(), max_length=100)
    chamber: ChamberPart | None = None
    formats: Annotated[tuple[Format, ...], Field(min_length=1, max_length=6)] = Field(
        default=("stl", "3mf"),
        description="STL is always written: later stages read it. STEP holds the lumens alone.",
    )

    def facet_ratio(self, vessels: int) -> float:
        """Share of the radius that a facet may lie off the wall of one of so many vessels."""
        if self.facet_percent is not None:
            return self.facet_percent / 100
        return _MANY_VESSELS_FACETS if vessels > _MANY_VESSELS else 0.0

    def heavy_facets(self, vessels: int) -> str:
        """What to know of facets asked for that so many vessels are too many for; else empty."""
        if vessels <= _MANY_VESSELS or self.facet_ratio(vessels) > 0.0:
            return ""
        return (
            f"facet_percent 0: facets of 1 µm on {vessels} vessels may take minutes, and files "
            f"of 100 MB and more; leave it out (then {100 * _MANY_VESSELS_FACETS:g} % of each "
            "vessel's radius) or give a small share, such as 1"
        )

    @model_validator(mode="after")
    def _formats_differ(self) -> SolidPart:
        if len(set(self.formats)) < len(self.formats):
            raise ValueError(f"formats {', '.join(self.formats)} names one twice; remove it")
        return self
