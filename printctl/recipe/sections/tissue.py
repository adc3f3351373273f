"""Recipe section on the tissue: shape, keep-out zones, relative perfusion demand.

Paths are relative to the recipe.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from design.units import LengthUnit
from printctl.recipe.parts import FILE, Length, Part, Point, value_given

FileName = Annotated[
    str,
    Field(min_length=1, description="Path, relative to the recipe.", json_schema_extra=FILE),
]
Voxel = Annotated[
    tuple[Length, Length, Length],
    Field(description="Size of a voxel along x, y, z, for images that don't say it."),
]


class CylinderPart(Part):
    """A rod between the centres of its ends: a needle, a port."""

    shape: Literal["cylinder"]
    from_mm: Point
    to_mm: Point
    radius_mm: Length


class SpherePart(Part):
    """A ball."""

    shape: Literal["sphere"]
    centre_mm: Point
    radius_mm: Length


class BlockPart(Part):
    """A box along the axes between two opposite corners."""

    shape: Literal["block"]
    from_mm: Point
    to_mm: Point


class MeshPart(Part):
    """What a closed mesh encloses."""

    mesh: FileName
    unit: LengthUnit


def _zone_kind(value: Any) -> str:
    return "mesh" if value_given(value, "mesh") is not None else str(value_given(value, "shape"))


ZonePart = Annotated[
    Annotated[CylinderPart, Tag("cylinder")]
    | Annotated[SpherePart, Tag("sphere")]
    | Annotated[BlockPart, Tag("block")]
    | Annotated[MeshPart, Tag("mesh")],
    Discriminator(_zone_kind),
]


class DepthDemandPart(Part):
    """Demand against the depth below the surface, linear in between."""

    depth_mm: Annotated[
        tuple[Annotated[float, Field(ge=0, le=1000)], ...], Field(min_length=1, max_length=1000)
    ]
    relative: tuple[Annotated[float, Field(ge=0, le=1e12)], ...]

    @model_validator(mode="after")
    def _is_a_table(self) -> DepthDemandPart:
        if len(self.depth_mm) != len(self.relative):
            raise ValueError(
                f"{len(self.depth_mm)} depths but {len(self.relative)} relative values; "
                "give one for each"
            )
        if any(two <= one for one, two in pairwise(self.depth_mm)):
            raise ValueError("depth_mm doesn't ascend; sort the table by depth")
        if not any(self.relative):
            raise ValueError("relative is 0 throughout; give some values above 0")
        return self


class ImageDemandPart(Part):
    """Demand by a volume image in the tissue's frame."""

    image: FileName
    voxel_mm: Voxel | None = None
    unit: LengthUnit | None = None


def _demand_kind(value: Any) -> str:
    return "image" if value_given(value, "image") is not None else "depth_mm"


DemandPart = Annotated[
    Annotated[DepthDemandPart, Tag("depth_mm")] | Annotated[ImageDemandPart, Tag("image")],
    Discriminator(_demand_kind),
]


class TissueSection(Part):
    """What every tissue may say besides its shape."""

    keep_out: tuple[ZonePart, ...] = Field(
        default=(), max_length=1000, description="Cut out of the tissue: needles, ports, fixtures."
    )
    keep_within: tuple[ZonePart, ...] = Field(
        default=(), max_length=1000, description="Only tissue in one of these is kept."
    )
    demand: DemandPart | None = Field(default=None, description="Uniform by default.")

    @property
    def label(self) -> str:
        """What the report calls it."""
        raise NotImplementedError

    def files(self) -> list[str]:
        """Names of the user's files that the tissue is made from."""
        zones = [*self.keep_out, *self.keep_within]
        named = [zone.mesh for zone in zones if isinstance(zone, MeshPart)]
        if isinstance(self.demand, ImageDemandPart):
            named.append(self.demand.image)
        return named


class FileSection(TissueSection):
    """Tissue from a file."""

    size_limits_mm: tuple[Length, Length] = Field(
        default=(5.0, 400.0), description="Refused when the largest extent lies outside."
    )

    @property
    def file(self) -> str:
        """The file that holds the shape."""
        raise NotImplementedError

    @property
    def label(self) -> str:
        """The file's name."""
        return self.file

    def files(self) -> list[str]:
        """As `TissueSection.files`."""
        return [self.file, *super().files()]


class MeshTissue(FileSection):
    """Tissue from a surface file (STL, OBJ, PLY, 3MF)."""

    mesh: FileName
    unit: LengthUnit = Field(description="Unit of the file; never guessed.")

    @property
    def file(self) -> str:
        """The mesh."""
        return self.mesh


class PointTissue(FileSection):
    """Tissue from points on its surface, with outward normals or without (PLY, XYZ, TXT, CSV)."""

    points: FileName
    unit: LengthUnit = Field(description="Unit of the file; never guessed.")

    @property
    def file(self) -> str:
        """The points."""
        return self.points


class LabelTissue(FileSection):
    """Tissue from one label of an image (NIfTI, NRRD, TIFF stack)."""

    labels: FileName
    value: int = Field(description="Value of the tissue's voxels.")
    voxel_mm: Voxel | None = None
    unit: LengthUnit | None = Field(
        default=None, description="Of the file's own voxel size, where the file doesn't say."
    )

    @property
    def file(self) -> str:
        """The image."""
        return self.labels


class NetworkTissue(TissueSection):
    """A box around a given network: the tissue of an embedded print whose recipe names none."""

    network: FileName
    unit: LengthUnit | None = Field(default=None, description="As in vasculature.")
    margin_mm: Length = Field(
        default=2.0,
        description="Beyond the vessels' walls. By default six times the outer width of a 30G "
        "needle (0.31 mm), so that the bath that yields around it is tissue.",
    )

    @property
    def label(self) -> str:
        """The file's name."""
        return f"box around {self.network}"

    def files(self) -> list[str]:
        """As `TissueSection.files`."""
        return [self.network, *super().files()]


class ShapeSection(TissueSection):
    """Tissue of a shipped shape."""

    shape: str

    @property
    def label(self) -> str:
        """The shape's name."""
        return self.shape


class Block(ShapeSection):
    """A box with one corner at the origin."""

    shape: Literal["block"]
    size_mm: tuple[Length, Length, Length]


class Cylinder(ShapeSection):
    """An upright cylinder."""

    shape: Literal["cylinder"]
    diameter_mm: Length
    height_mm: Length


class Annulus(ShapeSection):
    """An upright ring."""

    shape: Literal["annulus"]
    inner_diameter_mm: Length
    outer_diameter_mm: Length
    height_mm: Length

    @model_validator(mode="after")
    def _has_a_wall(self) -> Annulus:
        if not self.inner_diameter_mm < self.outer_diameter_mm:
            raise ValueError(
                f"inner_diameter_mm {self.inner_diameter_mm:g} isn't below "
                f"outer_diameter_mm {self.outer_diameter_mm:g}"
            )
        return self


class Biventricle(ShapeSection):
    """A phantom of both ventricles."""

    shape: Literal["biventricle"]
    length_mm: Length = 60.0


class Kidney(ShapeSection):
    """A phantom of a kidney."""

    shape: Literal["kidney"]
    length_mm: Length = 60.0


class Liver(ShapeSection):
    """A phantom of a liver."""

    shape: Literal["liver"]
    width_mm: Length = 60.0


class FoldedCortex(ShapeSection):
    """A folded slab of grey matter."""

    shape: Literal["folded_cortex"]
    thickness_mm: Length = 3.0


def _tissue_kind(value: Any) -> str:
    files = ("mesh", "points", "labels", "network")
    return next(
        (k for k in files if value_given(value, k) is not None), str(value_given(value, "shape"))
    )


TissuePart = Annotated[
    Annotated[MeshTissue, Tag("mesh")]
    | Annotated[PointTissue, Tag("points")]
    | Annotated[LabelTissue, Tag("labels")]
    | Annotated[NetworkTissue, Tag("network")]
    | Annotated[Block, Tag("block")]
    | Annotated[Cylinder, Tag("cylinder")]
    | Annotated[Annulus, Tag("annulus")]
    | Annotated[Biventricle, Tag("biventricle")]
    | Annotated[Kidney, Tag("kidney")]
    | Annotated[Liver, Tag("liver")]
    | Annotated[FoldedCortex, Tag("folded_cortex")],
    Discriminator(_tissue_kind),
]
