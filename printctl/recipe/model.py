"""Top level of a recipe: all settings of a run, in one file with a schema version."""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal

from pydantic import Discriminator, Field, ModelWrapValidatorHandler, Tag, model_validator

from printctl.recipe.parts import (
    FlowPart,
    OxygenPart,
    Part,
    Seed,
    value_given,
)
from printctl.recipe.sections.anatomy import AnatomyPart
from printctl.recipe.sections.forest import Forest
from printctl.recipe.sections.growth import (
    ClosedLoop,
    GivenNetwork,
    GrownNetwork,
    LatticeNetwork,
    NamedNetwork,
)
from printctl.recipe.sections.making import PrinterPart
from printctl.recipe.sections.measuring import RegistrationPart, ScanPart
from printctl.recipe.sections.observe import ObservePart
from printctl.recipe.sections.plate import PlatePart, check_plate
from printctl.recipe.sections.solid import SolidPart
from printctl.recipe.sections.tissue import Block, TissuePart
from printctl.recipe.sections.toolpath import Fresh, ToolpathPart


def _network_kind(value: Any) -> str:
    grown = value_given(value, "grow")
    if grown is not None:
        return f"grow: {grown}"
    return next(
        (key for key in ("design", "network", "lattice") if value_given(value, key) is not None),
        "none",
    )


NetworkPart = Annotated[
    Annotated[NamedNetwork, Tag("design")]
    | Annotated[GivenNetwork, Tag("network")]
    | Annotated[LatticeNetwork, Tag("lattice")]
    | Annotated[GrownNetwork, Tag("grow: tree")]
    | Annotated[ClosedLoop, Tag("grow: closed_loop")]
    | Annotated[Forest, Tag("grow: forest")],
    Discriminator(_network_kind),
]
_PLANAR_BLOCK_MM: Final = (16.0, 8.0, 3.0)
"""`design.vasculature.PLANAR_BLOCK_MM`, whose package takes seconds to load."""


class Recipe(Part):
    """A whole run, from tissue to registration report."""

    schema_version: Literal[1] = Field(alias="schema")
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")]
    seed: Seed = 1
    print_scale: Annotated[float, Field(ge=0.01, le=100)] = Field(
        default=1.0,
        description="Printed over designed length. Tissue and vessels are said in the design's "
        "size, all from the solid on in the print's.",
    )
    tissue: TissuePart = Field(
        description="An embedded print of a given network may leave it out: a box around it."
    )
    vasculature: NetworkPart
    flow: FlowPart = FlowPart()
    oxygen: OxygenPart | None = Field(
        default=None, description="Without it, oxygen isn't solved for."
    )
    solid: SolidPart = SolidPart()
    toolpath: ToolpathPart = Fresh(method="fresh")
    printer: PrinterPart = PrinterPart()
    observe: ObservePart | None = Field(
        default=None, description="Without it, nobody looks at the print while it is made."
    )
    plate: PlatePart | None = None
    scan: ScanPart | None = None
    registration: RegistrationPart = RegistrationPart()

    @model_validator(mode="before")
    @classmethod
    def _tissue_is_the_network_s_box(cls, data: Any) -> Any:
        """Give an embedded print of a given network a box for a tissue, where it has none."""
        if not isinstance(data, dict) or data.get("tissue") is not None:
            return data
        given = data.get("vasculature")
        network = value_given(given, "network")
        if network is None or value_given(data.get("toolpath"), "method") != "embedded":
            return data
        return data | {"tissue": {"network": network, "unit": value_given(given, "unit")}}

    @model_validator(mode="before")
    @classmethod
    def _ink_and_bath_suit_the_toolpath(cls, data: Any) -> Any:
        """Give embedded vessels a sacrificial ink and a matrix where the recipe names none."""
        if not isinstance(data, dict):
            return data
        toolpath, printer = data.get("toolpath"), data.get("printer") or {}
        vessels = value_given(toolpath, "writes") in (None, "vessels")
        if value_given(toolpath, "method") != "embedded" or not isinstance(printer, dict):
            return data
        ink = {"ink": "gelatin_sacrificial"} if vessels else {}
        if printer.get("heads"):
            heads = [ink | one if isinstance(one, dict) else one for one in printer["heads"]]
            return data | {"printer": {"bath": "cell_matrix", **printer, "heads": heads}}
        return data | {"printer": {**ink, "bath": "cell_matrix", **printer}}

    @model_validator(mode="wrap")
    @classmethod
    def _an_ink_that_suits_isn_t_set(
        cls, data: Any, make: ModelWrapValidatorHandler[Recipe]
    ) -> Recipe:
        """Count an ink that the recipe doesn't name as its default."""
        recipe = make(data)
        if isinstance(data, dict) and isinstance(printer := data.get("printer") or {}, dict):
            recipe.printer.model_fields_set.intersection_update(printer)
        return recipe

    @property
    def assumed_parts(self) -> dict[str, str]:
        """Syringe, ink, bath and needle that it takes by default, as it names none."""
        part, named = self.printer, self.printer.model_fields_set
        usual = {"bath": part.bath}
        if not part.heads:
            usual = {"syringe": part.syringe, "ink": part.ink, **usual}
        taken = {name: value for name, value in usual.items() if name not in named}
        if "needle" in self.toolpath.model_fields_set or any(one.needle for one in part.heads):
            return taken
        return {**taken, "needle": self.toolpath.needle}

    @model_validator(mode="after")
    def _parts_fit(self) -> Recipe:
        if self.plate is not None:
            check_plate(self.printer, self.toolpath)
        if isinstance(self.vasculature, NamedNetwork):
            self._is_the_design_s_block()
        if isinstance(self.vasculature, Forest):
            self._drains_are_fed(self.vasculature)
        if isinstance(self.vasculature, GrownNetwork) and self.vasculature.anatomy is not None:
            self._veins_are_solved(self.vasculature.anatomy)
        return self

    def files(self) -> list[str]:
        """Names of the user's files that part, flow, path and print are made from."""
        tables = (self.flow.outlets, self.flow.pulse and self.flow.pulse.table)
        return [
            *self.tissue.files(),
            *self.vasculature.files(),
            *(name for name in tables if name),
            *self.toolpath.files(),
            *self.printer.files(),
            *(self.observe.files() if self.observe is not None else ()),
        ]

    def _is_the_design_s_block(self) -> None:
        """Refuse any other block: ports and fiducial dimples lie on the faces of this one."""
        size = self.tissue.size_mm if isinstance(self.tissue, Block) else None
        if size == _PLANAR_BLOCK_MM:
            return
        size_text = (
            "" if size is None else " of 16 x 8 x 3 mm, not {:g} x {:g} x {:g}".format(*size)
        )
        raise ValueError(
            f"vasculature.design planar_four_vessel is made for a block{size_text}: its ports and "
            "fiducial dimples lie on that block's faces; give tissue: {shape: block, size_mm: "
            "[16, 8, 3]}, and print_scale for another size of the whole"
        )

    def _veins_are_solved(self, anatomy: AnatomyPart) -> None:
        """Refuse what can't drive a template's veins, which no artery joins."""
        if anatomy.template != "liver" and anatomy.vein != "beside":
            return
        flow, tree = self.flow, 2 if anatomy.template == "liver" else 1
        veins = f"the veins of the template (tree {tree}) are joined to no artery"
        if flow.one_d is not None or flow.three_d is not None or flow.exports:
            raise ValueError(
                f"{veins}, and flow's one_d, three_d and exports know one supply for all inlets; "
                "leave them out"
            )
        named = [number for supply in flow.supplies for number in supply.trees]
        if flow.inlet_pressure_mmhg is not None and tree not in named:
            raise ValueError(
                f"{veins}, and inlet_pressure_mmhg doesn't say how much they drain; give "
                "inlet_flow_ml_min, or add "
                f"flow: {{supplies: [{{trees: [{tree}], flow_ml_min: ...}}]}}"
            )

    def _drains_are_fed(self, forest: Forest) -> None:
        """Refuse a vein or lymph without partner whose flow nothing says."""
        known = {tree for supply in self.flow.supplies for tree in supply.trees}
        number = 0
        for network in forest.grown:
            for tree in network.trees:
                if not network.fed and tree.kind != "artery" and number not in known:
                    raise ValueError(
                        f"tree {number} of the forest is a {tree.kind} without partner: its flow "
                        "comes from the tissue, and nothing says how much; add "
                        f"flow: {{supplies: [{{trees: [{number}], flow_ml_min: ...}}]}}"
                    )
                number += 1
