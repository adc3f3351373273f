"""Make tissues (closed shape, signed distance, demand) from meshes, images, points, parameters.

Goes in: a mesh, an image, points or parameters. Comes out: a `Tissue`. Begin with `tissue.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from design.geometry.surface import Surface
    from design.tissue.images import VolumeImage, label_surface, load_label_surface, read_image
    from design.tissue.load import (
        depth_demand,
        function_demand,
        image_demand,
        load_surface,
        load_tissue,
    )
    from design.tissue.parts import (
        Part,
        part_demands,
        part_numbers,
        part_tissue,
        parts_of,
        without_cavities,
    )
    from design.tissue.points import load_point_surface, point_surface
    from design.tissue.repair import repair_surface
    from design.tissue.shapes import (
        annulus,
        biventricle,
        block,
        cylinder,
        folded_cortex,
        kidney,
        liver,
    )
    from design.tissue.surface import SizeLimits, SpacingRule, tissue_from_surface
    from design.tissue.tissue import (
        Demand,
        Tissue,
    )
    from design.tissue.zones import (
        BlockZone,
        CylinderZone,
        MeshZone,
        SphereZone,
        Zone,
        carve,
        zone_surface,
    )

__all__ = [
    "BlockZone",
    "CylinderZone",
    "Demand",
    "MeshZone",
    "Part",
    "SizeLimits",
    "SpacingRule",
    "SphereZone",
    "Surface",
    "Tissue",
    "VolumeImage",
    "Zone",
    "annulus",
    "biventricle",
    "block",
    "carve",
    "cylinder",
    "depth_demand",
    "folded_cortex",
    "function_demand",
    "image_demand",
    "kidney",
    "label_surface",
    "liver",
    "load_label_surface",
    "load_point_surface",
    "load_surface",
    "load_tissue",
    "part_demands",
    "part_numbers",
    "part_tissue",
    "parts_of",
    "point_surface",
    "read_image",
    "repair_surface",
    "tissue_from_surface",
    "without_cavities",
    "zone_surface",
]

__getattr__, __dir__ = on_demand(__name__)
