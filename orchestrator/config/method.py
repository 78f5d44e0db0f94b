"""``method``: how the problem is solved."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, GetJsonSchemaHandler, model_validator
from pydantic.json_schema import JsonSchemaValue

from orchestrator.config.base import AutoCount, Count, Part, Positive, auto_or
from orchestrator.registry import ACCELERATIONS

RATIO_RANGE = (1e-3, 1e2)  # of soles' moduli over matter's: beyond, rounding spoils answers
STABLEST = 0.1  # stabilisation beyond which springs, not laws, decide what contacts do
FRACTION = 0.1  # of the mesh's error, for the iterations'
# relative energy error that double precision leaves in back-substitutions and their differences
ROUNDING = 1e-11

AutoPositive = auto_or(Positive, "a number > 0")
AutoPoisson = auto_or(Annotated[float, Field(gt=-1, lt=0.5)], "a number > -1 and < 0.5")
AutoRelaxation = auto_or(Annotated[float, Field(gt=0, le=1)], "a number > 0 and <= 1")
Fraction = Annotated[float, Field(gt=0, lt=1)]
AutoStabilisation = auto_or(Annotated[float, Field(ge=0, le=STABLEST)],
                            f"a number from 0 to {STABLEST:g}")
AutoFraction = auto_or(Fraction, "a number > 0 and < 1")


class SoleSettings(Part):
    """The layer of plain matter glued to each interface: the search direction in mechanical
    form.
    """

    kind: Literal["auto", "layer", "symmetric", "overlap", "springs"] = Field("auto", description=(
        "symmetric: half the layer on each side of the interface, so both neighbours get the same "
        "stiffness; 15-30 % fewer iterations than the paper's one-sided layer. overlap: where all "
        "is one bonded mesh, one sole per subdomain, a copy of every outside element that touches "
        "it; elsewhere, per interface, a copy of the first row of elements of both sides, most of "
        "it the neighbour's. auto: overlap where all is one bonded mesh, unless parts are slender "
        "or of ν above 0.4995, and elsewhere for mixed moduli, ν above 0.49 and slender parts; "
        "else symmetric"))
    modulus_ratio: Positive = Field(0.5, description=(
        "sole modulus over the larger modulus of the two neighbours; 0.5 is a flat optimum "
        "(0.35-0.8). Of a sole that surrounds a subdomain, over the elements' own modulus: so "
        "much with 250 nodes in the subdomain, with n nodes (250/n)^(1/6) of it"))
    contact: Literal["layer", "symmetric", "springs"] = Field("springs", description=(
        "kind on interfaces that are not perfect; springs: a layer so thin that nodes do not "
        "couple, which pointwise laws converge best with"))
    contact_ratio: Positive = Field(1.2, description=(
        "on interfaces that are not perfect: modulus over thickness of the sole, over E/√(h L) "
        "with h the local element size, L the size of the smaller body and E between the two "
        "moduli, one to four times the smaller (the larger under laws that impose the jump); "
        "0.6-2.5 is a flat optimum"))
    fit: bool = Field(True, description=(
        "springs where bodies may part begin at contact_ratio; before the iterations two solves "
        "tell how stiff the bodies behind them are, and springs that are too soft by more than "
        "about a half become stiffer, all by one factor, for another factorisation"))
    thickness: AutoPositive = Field("auto",
                                    description="auto: the local element size, shrunk where it "
                                    "would invert")
    poisson: AutoPoisson = Field("auto", description=(
        "auto: the matter's own, at most 0.3: a nearly incompressible sole is stiff in the wrong "
        "direction"))
    allow_extreme: bool = Field(False, description=(
        f"permits a modulus_ratio outside [{RATIO_RANGE[0]:g}, {RATIO_RANGE[1]:g}], where rounding "
        "spoils the result; false because only studies want that"))


class MacroSettings(Part):
    """The macro problem, linear: it carries resultants over interfaces through the whole structure
    at once.
    """

    strategy: Literal["none", "equilibrium", "continuity"] = Field("equilibrium", description=(
        "equilibrium: the number of iterations then hardly grows with the number of subdomains"))
    basis: Literal["auto", "translations", "rigid", "affine", "quadratic",
                   "modes"] = Field("auto", description=(
        "affine: rotations are needed in bending, extensions and shears save iterations; modes: "
        "affine and the subdomains' soft modes, computed at set-up. auto: with one sole per "
        "subdomain, rigid motions about the nodes where most subdomains meet; else affine fields "
        "per interface, with soft modes of subdomains 10 times longer than thick, or of ν above "
        "0.49 (0.4995 with ten-node tets). The others are per interface, and exclude such soles"))
    on: Literal["perfect", "all"] = Field("perfect", description=(
        "perfect: on perfect interfaces; the coarse contact problem does better on contact. all: "
        "the paper's"))


class SearchDirectionSettings(Part):
    """k⁺, from the linear stage to the local stage; for studies."""

    kplus: Literal["exchange", "full", "diagonal"] = Field("exchange", description=(
        "exchange: the neighbour's own sole, which needs no interface factorisation. full, "
        "diagonal: where all interfaces are perfect"))


class ContactSettings(Part):
    """Settings where laws do not join their sides."""

    stabilisation: AutoStabilisation = Field("auto", description=(
        "share ε of a weak viscous spring that keeps facing nodes where they were at the end of "
        "the load step before, so that bodies that nothing else holds have one position; it leaves "
        "a law residual of about 2 ε. auto: springs between loose bodies and their neighbours "
        "alone, which begin anew where bodies are and leave nothing; 0: none"))


class Tolerance(Part):
    """Exactly one criterion: error, law or indicator."""

    error: AutoFraction | None = Field(None, description=(
        "bound on the relative energy error, between 0 and 1: guaranteed for convex laws, such as "
        "bonds and contact without friction, mostly an estimate with Coulomb's; where bodies are "
        "loose, or matter is nonlinear, as law; auto: a fraction of the estimated discretisation "
        "error, since nobody should pay for 1e-9 on a 3 % mesh"))
    law: Fraction | None = Field(None, description=(
        "where interfaces are not perfect: the largest relative residual of equilibrium and laws, "
        "of all together and of each body beside its own forces; it says nothing of the error"))
    fraction: Fraction | None = Field(None, description=(
        f"beside error: auto only: the iterations' error over the mesh's, {FRACTION} if not given; "
        "their squares add up, so that 0.1 adds half a per cent"))
    indicator: Positive | None = Field(None,
                                       description="the paper's indicator, a squared ratio; for "
                                       "studies")

    @model_validator(mode="before")
    @classmethod
    def _fraction(cls, value: Any) -> Any:
        """A fraction belongs to ``error: auto``, and there it has a default."""
        if isinstance(value,
                      dict) and value.get("error") == "auto" and value.get("fraction") is None:
            return {**value, "fraction": FRACTION}
        return value


class Accuracy(Part):
    """The error allowed in all, and what that may cost. A number stands for ``{error: number}``."""

    error: Fraction = Field(
        description="of mesh and iterations together, relative, in the energy norm, between 0 and "
                    "1")
    elements: Count | None = Field(None,
                                   description="no mesh has more tets than about this; none: no "
                                   "limit")
    memory: Positive | None = Field(None, description=(
        "GB that the program and its codes may take on all ranks together: meshes are only as fine "
        "as that is foreseen to hold; none: no limit but the machine's"))
    seconds: Positive | None = Field(None,
                                     description="meshes are only as fine as will likely be solved "
                                     "on in time; none: no limit")
    smallest: Positive | None = Field(None, description=(
        "elements are not made smaller than this, in the model's unit of length, where stresses "
        "grow without limit; none: no limit"))

    @model_validator(mode="before")
    @classmethod
    def _number(cls, value: Any) -> Any:
        return {"error": value} if isinstance(value,
                                              (int, float)) and not isinstance(
                                                  value, bool) else value

    @classmethod
    def __get_pydantic_json_schema__(cls, core: Any,
                                     handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return {
            "anyOf": [handler(core),
                      {"type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": 1}]}


class Skip(Part):
    """Work left out where a scene does not need it; true leaves it to the program where it pays."""

    congruent: bool = Field(True, description=(
        "subdomains, soles and rims that differ by a translation alone share one stiffness and "
        "one factorisation"))


class Method(Part):
    sole: SoleSettings = Field(SoleSettings(),
                               description="the search direction k⁻ as a layer of matter")
    macro: MacroSettings = Field(MacroSettings(),
                                 description="the macro problem: linear, of interface resultants, "
                                 "for perfect interfaces")
    search_direction: SearchDirectionSettings = Field(SearchDirectionSettings(),
                                                      description="k⁺, for studies")
    acceleration: Literal[tuple(ACCELERATIONS)] = Field("anderson", description=(
        "anderson, with contact: Anderson's of the nonlinear fixed point. Where all is bonded the "
        "fixed point is affine, and anderson and gmres both minimise the residual over all "
        "iterations so far: the generalised conjugate residual method, equivalent to GMRES; "
        "anderson may forget (memory). none: relaxation alone; aitken: relaxation by the last two "
        "residuals"))
    memory: AutoCount = Field("auto", description=(
        "depth of anderson alone; auto: the whole history for perfect interfaces, 30 with contact"))
    coarse: Literal["auto", "affine", "rigid", "none"] = Field("auto", description=(
        "the coarse contact problem: where interfaces are not perfect every body moves in its "
        "affine, or its rigid, fields under the true laws, after every linear stage; it removes "
        "the plateau of the fixed point. auto: affine, slender bodies in modes of their own"))
    contact: ContactSettings = Field(ContactSettings(),
                                     description="what keeps bodies in place that contact alone "
                                     "holds")
    increment: AutoCount = Field("auto", description=(
        "load steps solved together with contact; auto: all up to 12, otherwise 4 at a time, each "
        "batch starting from the last"))
    relaxation: AutoRelaxation = Field("auto", description=(
        "above 0 and at most 1 (0 would never move); auto: what suits the acceleration and search "
        "direction"))
    start: Literal["near", "cold"] = Field("near", description=(
        "what a variant of a sweep begins with; near: the states of solved variants near it; cold: "
        "zero, as with friction the start may decide between several solutions"))
    skip: Skip = Field(Skip(),
                       description=(
                           "work that is left out because the result does not need it; all of it "
                           "by default"))
    tolerance: Tolerance = Field(Tolerance(error=1e-6), description=(
        "error 1e-6: well below the discretisation error of any practical mesh"))
    accuracy: Accuracy | None = Field(None, description=(
        "the error that is asked for, 0.02 say: the run is repeated on meshes that are finer where "
        "it pays until its estimated error is below; in place of tolerance; or {error, elements, "
        "memory, seconds, smallest}; none: the mesh stays as it is"))
    max_iterations: Count = Field(500, description=(
        "of the whole run, all batches of load steps together; far above what a healthy run "
        "needs, so it only stops sick ones"))
