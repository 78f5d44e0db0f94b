"""Relations between doors: a part as the matrix, the deck or the form of the same elasticity, another code, two ranks.

Files that such a scene needs travel with it under ``files``: name → text, written beside the YAML.
"""

from __future__ import annotations

import copy
import io
from typing import Any

import numpy as np
import scipy.io
import scipy.sparse as sp

from benchmarks.kit.elasticity import stiffness
from benchmarks.metamorphic.tools import tools
from benchmarks.metamorphic.variant import Variant
from orchestrator import build_scene, config_from

CODES = ("freefem", "scikit-fem", "in-process", "calculix")
FORM = """// Isotropic elasticity, said as a form of one's own
func myLambda = {lam!r};
func myMu = {mu!r};
macro myEps(w) [dx(w#x), dy(w#y), dz(w#z), (dy(w#z) + dz(w#y)), (dx(w#z) + dz(w#x)), (dx(w#y) + dy(w#x))] // EOM
macro myHooke [[myLambda + 2*myMu, myLambda, myLambda, 0, 0, 0], [myLambda, myLambda + 2*myMu, myLambda, 0, 0, 0],
               [myLambda, myLambda, myLambda + 2*myMu, 0, 0, 0], [0, 0, 0, myMu, 0, 0], [0, 0, 0, 0, myMu, 0], [0, 0, 0, 0, 0, myMu]] // EOM
macro Stiffness(u, v) int3d(Th, mine, qfV = qfV2)(myEps(v)'*(myHooke*myEps(u))) // EOM
"""


def other_code(data: dict, rng: np.random.Generator) -> Variant | None:
    """Solved by another code; by two of them, part by part."""
    own = data["blackbox"]
    others = [c for c in CODES if c != own["code"] and not (c == "calculix" and own.get("element") == "P2")]
    made = {**own, "code": str(rng.choice(others))}
    if len(data["parts"]) > 1 and data["subdomains"] == "groups" and rng.integers(2):
        return Variant({**data, "blackbox": [own, {**made, "on": [str(rng.choice([p["name"] for p in data["parts"]]))]}]})
    return Variant({**data, "blackbox": made})


def two_ranks(data: dict, rng: np.random.Generator) -> Variant | None:
    """The same by two processes under mpiexec, from the command line, with a code that these find."""
    code = {**data["blackbox"], "code": "freefem"}
    return Variant({**data, "blackbox": code, "ranks": 2}) if len(data["parts"]) > 1 else None


def part_as_form(data: dict, rng: np.random.Generator) -> Variant | None:
    """A part whose matter is a form in FreeFEM's language, the same elasticity."""
    if data["subdomains"] != "groups" or any("temperature" in e for e in data.get("loads", [])):
        return None
    part, (young, poisson) = _chosen(data, rng)
    form = FORM.format(lam=young * poisson / ((1 + poisson) * (1 - 2 * poisson)), mu=young / (2 * (1 + poisson)))
    codes = [{**data["blackbox"], "code": "freefem"}, {**data["blackbox"], "code": "freefem", "form": "form.idp", "on": [part["name"]]}]
    return Variant({**data, "blackbox": codes, "files": {"form.idp": form}})


def part_as_matrix(data: dict, rng: np.random.Generator) -> Variant | None:
    """A part that is a stiffness matrix with all its outer faces as joints."""
    return _foreign(data, rng, _matrix)


def part_as_deck(data: dict, rng: np.random.Generator) -> Variant | None:
    """A part that is a CalculiX deck of the same tets."""
    return _foreign(data, rng, _deck)


def _foreign(data: dict, rng: np.random.Generator, door) -> Variant | None:
    if data["subdomains"] != "groups" or data["blackbox"].get("element") == "P2" or len(data["parts"]) < 2 or \
            any(e.get("on", "*") == "*" for e in data.get("loads", [])) or tools(data):
        return None
    busy = {e["on"].split("/")[0] for e in data["boundary"]} | {e["on"] for e in data.get("loads", [])}
    busy |= {probe["part"] for probe in data.get("output", {}).get("probes", [])}
    free = [p["name"] for p in data["parts"] if p["name"] not in busy]
    if not free:
        return None
    part, moduli = _chosen(data, rng, free)
    mesh = build_scene(config_from({k: v for k, v in data.items()})).mesh
    cells = mesh.cells[mesh.volume == mesh.volumes.index(part["name"])]
    nodes, local = np.unique(cells, return_inverse=True)
    made = copy.deepcopy(data)
    entry, files = door(mesh.nodes[nodes], local.reshape(-1, 4), *moduli)
    at = [p["name"] for p in data["parts"]].index(part["name"])
    made["parts"][at] = {"name": part["name"], **entry}
    if "matrix" in entry:
        made["parts"][at]["material"] = {"young": moduli[0], "poisson": moduli[1]}
    return Variant({**made, "files": files}, without={part["name"]})


def _matrix(nodes: np.ndarray, cells: np.ndarray, young: float, poisson: float) -> tuple[dict, dict[str, str]]:
    K = sp.coo_array(stiffness(nodes, cells, np.full(len(cells), young), np.full(len(cells), poisson)))
    file = io.BytesIO()
    scipy.io.mmwrite(file, sp.coo_matrix(0.5 * (K + K.T)), precision=17, symmetry="symmetric")
    table = "id,x,y,z\n" + "".join(f"{i},{x!r},{y!r},{z!r}\n" for i, (x, y, z) in enumerate(nodes.tolist(), 1))
    facets = "".join(" ".join(str(1 + n) for n in face) + "\n" for face in _outer(cells))
    return {"matrix": {"stiffness": "K.mtx", "nodes": "nodes.csv", "facets": "facets.csv"}}, {
        "K.mtx": file.getvalue().decode(), "nodes.csv": table, "facets.csv": facets}


def _deck(nodes: np.ndarray, cells: np.ndarray, young: float, poisson: float) -> tuple[dict, dict[str, str]]:
    text = "*NODE,NSET=NALL\n" + "".join(f"{i},{x!r},{y!r},{z!r}\n" for i, (x, y, z) in enumerate(nodes.tolist(), 1))
    text += "*ELEMENT,TYPE=C3D4,ELSET=EALL\n" + "".join(f"{i},{a},{b},{c},{d}\n" for i, (a, b, c, d) in enumerate((cells + 1).tolist(), 1))
    text += "*NSET,NSET=SKIN\n" + "".join(f"{n + 1},\n" for n in np.unique(_outer(cells)))
    text += f"*MATERIAL,NAME=STEEL\n*ELASTIC\n{young!r},{poisson!r}\n*SOLID SECTION,ELSET=EALL,MATERIAL=STEEL\n"
    return {"deck": {"calculix": "part.inp", "joints": ["SKIN"]}}, {"part.inp": text}


def _outer(cells: np.ndarray) -> np.ndarray:
    """(k, 3) faces that one tet alone has, anticlockwise seen from outside."""
    faces = np.concatenate([cells[:, [0, 2, 1]], cells[:, [0, 1, 3]], cells[:, [1, 2, 3]], cells[:, [0, 3, 2]]])
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    return faces[np.sort(first[count == 1])]


def _chosen(data: dict, rng: np.random.Generator, names: list[str] | None = None) -> tuple[dict, tuple[float, float]]:
    """One of the parts, and its moduli: the last match wins."""
    parts = [p for p in data["parts"] if names is None or p["name"] in names]
    part: dict[str, Any] = parts[int(rng.integers(len(parts)))]
    matter = part.get("material") or [m for m in data["materials"] if m.get("on", part["name"]) == part["name"]][-1]
    return part, (float(matter["young"]), float(matter["poisson"]))
