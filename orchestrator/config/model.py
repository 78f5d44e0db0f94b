"""The whole configuration, and ``output``: what is written, and what is asked of the solution.
Names are the YAML's keys.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any

from pydantic import Field, model_validator

from orchestrator.config.base import Name, Part, Vector
from orchestrator.config.blackbox import BlackBoxes, CodeSettings, settings_class
from orchestrator.config.boundary import Bolt, Boundary, Entry, Interfaces, Loads
from orchestrator.config.mesh import MaterialEntry, MeshEntry, OnePart, Subdomains, elements_of
from orchestrator.config.method import Method
from orchestrator.config.conditions import ProbeEntry, Probes
from orchestrator.config.tools import Tool
from orchestrator.registry import FOREIGN

UnitName = Annotated[str, Field(pattern=r"^[^\s/*]{1,12}$")]


class Units(Part):
    """Units of the model's numbers: named beside them, nothing is converted."""

    length: UnitName = Field(description="unit of the mesh's coordinates, such as mm")
    force: UnitName = Field(
        description="unit of forces, such as N; moduli and stresses are then force/length²")

    @property
    def stress(self) -> str:
        """Unit of stresses, with the name that the usual pairs have."""
        known = {("N", "mm"): "MPa", ("N", "m"): "Pa", ("kN", "m"): "kPa", ("kN", "mm"): "GPa",
                 ("MN", "m"): "MPa"}
        return known.get((self.force, self.length), f"{self.force}/{self.length}²")


class Output(Part):
    directory: Name | None = Field(None, description="results folder; none: results/<name>")
    fields: bool = Field(True,
                         description="write displacement and stress fields; cheap beside the solve")
    figures: bool = Field(True,
                          description="draw the figures, as they are what most people look at "
                                      "first")
    probes: Probes = Field([], description=(
        "values that are asked for, at points, along paths, on surfaces, across sections; into "
        "summary.json, probes.csv, paths.csv"))
    moments_about: Vector = Field([0.0, 0.0, 0.0], description=(
        "reactions' moments are about this point; the origin by default, which no one has to look "
        "up"))
    units: Units | None = Field(None,
                                description="names of the units of length and force, shown beside "
                                "numbers; none: no units")

    @property
    def named_probes(self) -> dict[str, ProbeEntry]:
        """Name → probe, in the order of the YAML; one without a name is called by its place."""
        return {probe.name or f"probe_{i + 1}": probe for i, probe in enumerate(self.probes)}


class Config(Part):
    """One problem and how to solve it: ``config.mesh.beam.size``, ``config.method.tolerance.error``
    …

    Built by ``load_config`` (from a file) or ``config_from`` (from a dict), which also apply the
    rules that concern several keys.
    """

    name: Annotated[str, Field(pattern=r"^\w[\w. -]*$")] = Field(
        description="letters, digits, '-', '_', '.' and spaces, a letter or digit first: it names "
                    "the results folder")
    mesh: MeshEntry | None = Field(None,
                                   description="exactly one of beam, box, polycrystal, file and "
                                   "step; or parts")
    parts: Annotated[list[OnePart], Field(min_length=1)] | None = Field(None, description=(
        "in place of mesh: several, each part with its own: [{name: base, mesh: {step: base.stp, "
        "h: 4}}, …]"))
    subdomains: Subdomains = Field(
        description="one of {slices: {axis: x, count: 8}}, {grid: [2, 2, 2]}, {metis: 8}, groups")
    materials: Annotated[list[MaterialEntry], Field(min_length=1)] | None = Field(
        None,
        description="at least one, such as {young: 200e3, poisson: 0.3}; none where each part has "
                    "its own")
    boundary: Boundary = Field(description="where the body is held and loaded")
    histories: dict[Name, Annotated[list[float], Field(min_length=1)]] = Field(
        {}, description="name: factors, one per load step; none: one load step")
    bolts: list[Bolt] = Field([], description=(
        "bolts cut across their shanks, tightened by a force, then locked: [{on: bolt_1, force: "
        "8000}]; none by default"))
    loads: Loads = Field([], description="body forces; none by default")
    interfaces: Interfaces = Field(default_factory=lambda: [Entry()], description=(
        "laws between parts, the last match wins; perfect by default where nodes are shared or "
        "coincide; faces that do not match are joined by an entry alone"))
    method: Method = Field(Method(), description="how the decomposed problem is solved")
    blackbox: BlackBoxes = Field(default_factory=lambda: settings_class({})(), description=(
        "the finite element code, or a list of several with on:, the last match wins"))
    output: Output = Field(Output(), description="what is written, and where")

    @model_validator(mode="before")
    @classmethod
    def _results_folder(cls, data: Any) -> Any:
        """``output.directory`` defaults to results/<name>, which only the whole configuration
        knows.
        """
        if not isinstance(data, dict) or not isinstance(data.get("name"), str):
            return data
        output = data.get("output", {})
        if not isinstance(output, dict) or output.get("directory") is not None:
            return data
        return {**data, "output": {**output, "directory": f"results/{data['name']}"}}

    @model_validator(mode="before")
    @classmethod
    def _element_of_parts(cls, data: Any) -> Any:
        """Take for ``blackbox`` without an element the one that parts agree on; disagreement is
        told by a rule.
        """
        named = {element for _, element in elements_of(data.get("parts"))} if isinstance(
            data, dict) else set()
        if len(named) != 1:
            return data
        given, element = data.get("blackbox"), named.pop()
        codes = [{"element": element, **code} if isinstance(code, dict) else code
                 for code in (given if isinstance(given, list)
                              else [{} if given is None else given])]
        return {**data, "blackbox": codes if isinstance(given, list) else codes[0]}

    @property
    def refines(self) -> bool:
        """Whether one mesh may not be enough."""
        return self.method.accuracy is not None

    @property
    def matter(self) -> list[MaterialEntry]:
        """The materials in the order in which they are given to volumes, parts' own after the
        general ones.
        """
        own = [MaterialEntry(**part.material.model_dump(), on=[part.name]) for part in self.parts
               or [] if part.material]
        return [*(self.materials or []), *own]

    @property
    def codes(self) -> list[CodeSettings]:
        """The black boxes, in the order of the YAML; then one for each part that is a model of
        another program's.
        """
        found = list(self.blackbox if isinstance(self.blackbox, list) else [self.blackbox])
        for i, part in enumerate(self.parts or []):
            if (own := part.foreign) is not None:
                young = next((m.young for m in (part.material, *(self.materials or []))
                              if m is not None), None)
                found.append(FOREIGN[own.kind].Settings(code=own.kind, on=[part.name], part=own,
                                                        name=part.name, young=young, place=(
                    "parts", i, own.kind), factors=tuple(self.factors_of(own.history))))
        return found

    @property
    def tools(self) -> dict[str, Tool]:
        """The rigid tools that interfaces are with, by their names, in the order of the YAML."""
        found: dict[str, Tool] = {}
        for tool in (entry.tool for entry in self.interfaces if entry.tool is not None):
            name = tool.name or tool.shape
            found[name if name not in found else f"{name} {len(found) + 1}"] = tool
        return found

    @property
    def steps(self) -> int:
        """Number of load steps: the length of the histories in use and of the per-step lists; else
        1.
        """
        for entry in (*self.boundary, *self.loads, *self.interfaces, *self.bolts,
                      *self.tools.values()):
            if entry.history is not None:
                return len(self.histories[entry.history])
            if (vectors := entry.vectors) is not None:
                return len(vectors)
        for own in (part.foreign for part in self.parts or [] if part.foreign):
            if own.history is not None:
                return len(self.histories[own.history])
            if isinstance(own.loads, list) and len(own.loads) > 1:
                return len(own.loads)
        return 1

    def factors_of(self, history: str | None) -> list[float]:
        """The factors of every load step."""
        return [1.0] * self.steps if history is None else list(self.histories[history])

    def factors(self, entries: Iterable[Any]) -> list[list[float]]:
        """Return what multiplies each entry at every load step."""
        return [self.factors_of(entry.history) for entry in entries]

    def with_element(self, element: str) -> Config:
        """The same with an element in all entries of ``blackbox``, where it may have been left
        open.
        """
        several = isinstance(self.blackbox, list)
        made = [code.model_copy(update={"element": element})
                for code in (self.blackbox if several else [self.blackbox])]
        return self.model_copy(update={"blackbox": made if several else made[0]})

    def complete(self) -> dict[str, Any]:
        """The configuration as plain data, defaults filled in; ``config_from`` takes it back."""
        return self.model_dump(mode="json", exclude_none=True)
