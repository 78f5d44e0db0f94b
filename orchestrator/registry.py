"""Registry of all that can be added, a line each: interface laws, loads and supports,
accelerations, monitors, codes,
readers of mesh files, and their modules.

Modules are imported when a name is first used, so that knowing the names costs nothing.

>>> "contact" in LAWS
True
>>> LAWS["contact"].__name__
'Contact'
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from importlib import import_module
from typing import Any


class Registry(Mapping[str, Any]):
    """Names, and what they stand for.

    places : name → ``module:attribute``
    own : regular expression → ``module:attribute``: what stands for names of the user's own, by
        their form
    made : ``module:function`` by which what has been named becomes what is asked for; none: it is
    """

    def __init__(self, places: Mapping[str, str], own: Mapping[str, str] | None = None,
                 made: str = ""):
        self._places, self._own, self._made, self._known = dict(places), dict(own or {}), made, {}
        self._first = tuple(places)

    def __getitem__(self, name: str) -> Any:
        if (place := self._place(name)) is None:
            raise KeyError(name)
        return self._at(place)

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and self._place(name) is not None

    def own(self) -> list[Any]:
        """The entry that stands for names of the user's own."""
        return [self._at(place) for place in self._own.values()]

    def shipped(self) -> dict[str, Any]:
        """The names without those that were added."""
        return {name: self[name] for name in self._first}

    def add(self, name: str, thing: Any) -> None:
        """Something that is not shipped: a law or a code of the user's own."""
        place = f"{thing.__module__}:{thing.__qualname__}"
        self._places[name], self._known[place] = place, _named(self._made)(
            thing) if self._made else thing

    def remove(self, name: str) -> None:
        """Forget what was added."""
        del self._places[name]

    def _place(self, name: str) -> str | None:
        return self._places.get(name) or next((place for form, place in self._own.items()
                                               if re.fullmatch(form, name)), None)

    def _at(self, place: str) -> Any:
        if place not in self._known:
            self._known[place] = _named(self._made)(_named(place)) if self._made else _named(place)
        return self._known[place]


def _named(place: str) -> Any:
    module, _, attribute = place.partition(":")
    return getattr(import_module(module), attribute)


# what joins where nothing is said; across the cut of an entry of bolts; beside a rigid tool
DEFAULT_LAW, BOLT_LAW, TOOL_LAW = "perfect", "pretension", "contact"
LAWS = Registry({
    "perfect": "orchestrator.laws.perfect:Perfect",
    "contact": "orchestrator.laws.contact:Contact",
    "jump": "orchestrator.laws.perfect:Jump",
    "elastic": "orchestrator.laws.elastic:Elastic",
    "pretension": "orchestrator.laws.pretension:Pretension",
    "cohesive": "orchestrator.laws.cohesive:Cohesive",
})

# What watches the iterations, in the order in which it is asked: criteria, what changes the
# problem, when to end, the rest.
MONITORS = Registry({
    "error_bound": "orchestrator.method.monitors.criteria:BondedCriterion",
    "law_residual": "orchestrator.method.monitors.criteria:LawCriterion",
    "following": "orchestrator.method.monitors.following:FollowingMonitor",
    "limit_load": "orchestrator.method.monitors.limit_load:LimitLoadMonitor",
    "weakening": "orchestrator.method.monitors.weakening:Weakening",
    "ending": "orchestrator.method.monitors.ending:Ending",
    "far_bodies": "orchestrator.method.monitors.far_bodies:FarBodies",
})

# Kinds of entries of boundary and of loads, by their key there.
ON_FACES = Registry({
    "displacement": "orchestrator.scene.loads.prescribed:Displacement",
    "symmetry": "orchestrator.scene.loads.prescribed:Symmetry",
    "motion": "orchestrator.scene.loads.prescribed:RigidMotion",
    "traction": "orchestrator.scene.loads.forces:Traction",
    "pressure": "orchestrator.scene.loads.forces:Pressure",
    "resultant": "orchestrator.scene.loads.forces:Spread",
    "foundation": "orchestrator.scene.loads.grounds:Bedding",
    "coupling": "orchestrator.scene.loads.grounds:Remote",
})
IN_VOLUMES = Registry({
    "body_force": "orchestrator.scene.loads.forces:BodyForce",
    "gravity": "orchestrator.scene.loads.forces:Gravity",
    "spin": "orchestrator.scene.loads.forces:Centrifugal",
    "temperature": "orchestrator.scene.loads.temperature:Temperature",
})

# Kinds of entries of output.probes, by a key that each alone has.
PROBES = Registry({
    "at": "orchestrator.scene.conditions.probes:PointProbe",
    "along": "orchestrator.scene.conditions.probes:PathProbe",
    "section": "orchestrator.scene.conditions.probe_faces:SectionProbe",
    "on": "orchestrator.scene.conditions.probe_faces:SurfaceProbe",
})

# What a rigid ground does to surfaces of entries of boundary; not for interfaces between parts.
GROUND = Registry({"support": "orchestrator.laws.support:Support",
                   "coupling": "orchestrator.laws.coupling:CouplingLaw"})

ACCELERATIONS = Registry({
    "none": "orchestrator.method.acceleration.relaxation:Relaxation",
    "aitken": "orchestrator.method.acceleration.relaxation:Aitken",
    "anderson": "orchestrator.method.acceleration.anderson:Anderson",
    "gmres": "orchestrator.method.acceleration.residual_minimisation:ResidualMinimisation",
})

DEFAULT_CODE = "freefem"  # keeps its factors between requests, and is the fastest here
CODES = Registry({
    "freefem": "orchestrator.blackbox.codes.freefem.code:FreeFem",
    "calculix": "orchestrator.blackbox.codes.calculix.code:CalculiX",
    "scikit-fem": "orchestrator.blackbox.codes.libraries:ScikitFem",
}, own={
    r".+\.py(:\w+)?|[\w.]+:\w+": "orchestrator.blackbox.codes.python_code:PythonCode",
}, made="orchestrator.blackbox.codes.python_code:code_of")
# Parts whose mesh is not ours, by their key in ``parts``: who answers for them.
FOREIGN = Registry({
    "matrix": "orchestrator.blackbox.codes.parts:MatrixCode",
    "deck": "orchestrator.blackbox.codes.calculix.deck:DeckCode",
    "program": "orchestrator.blackbox.codes.parts:ProgramCode",
})
# Mesh files: who reads those of an ending.
READERS = Registry({
    ".msh": "orchestrator.scene.mesh.readers.libraries:read_msh",
    ".inp": "orchestrator.scene.mesh.readers.inp:read_inp",
}, own={
    r"\.(unv|med|bdf|nas)": "orchestrator.scene.mesh.readers.libraries:read_by_gmsh",
    r"\.(vtu|vtk)": "orchestrator.scene.mesh.readers.vtk:read_vtk",
    r"\.(xdmf|xmf)": "orchestrator.scene.mesh.readers.libraries:read_xdmf",
    r"\.(vtm|vtmb|pvd|pvtu)": "orchestrator.scene.mesh.readers.libraries:refuse_collection",
    ".*": "orchestrator.scene.mesh.readers.libraries:read_by_meshio",
})
