"""Scenes solved by ranks: run by mpiexec, rank 0 writes what the tests compare."""

import json
import sys
from pathlib import Path

import numpy as np
from boxes import boxed
from in_process import IN_PROCESS

from orchestrator.accuracy.loop import run as accuracy
from orchestrator.config.load import Loaded, config_from, load_config
from orchestrator.errors import NOT_CONVERGED
from orchestrator.method.sparse.blocks import BlockPattern
from orchestrator.launch import join
from orchestrator.parallel.team import ALONE, Team
from orchestrator.results.extremes import STRESS
from orchestrator.run import Means, follow, run
from orchestrator.solving import Ranks, solve


PROBES = {"probes": [{"at": [1.1, 0.3, 0.4]}, {"on": {"plane": "z", "at": 1}}, {"section": {"plane": "z", "at": 0.25}},
                     {"on": {"plane": "z", "at": 0}, "quantity": "resultant"}]}
# in a tet, where blocks meet, along an edge and out of the body, of one block
WATCHED = [{"at": [0.31, 0.77, 0.2]}, {"at": [0.5, 0.5, 0.5], "quantity": "stress"}, {"along": [[0, 1, 1], [2, 0, 0]], "points": 9},
           {"along": [[0, 0.5, 0.5], [1.5, 0.5, 0.5]], "quantity": "stress"}, {"at": [0.5, 0.5, 0.2], "part": "block 1-*"},
           # on one rank and on several, along borders of ranks and beside them
           {"on": "xmin"}, {"on": "xmin", "of": "stress"}, {"on": "xmax", "quantity": "max"}, {"on": "ymax", "quantity": "min", "of": "stress"},
           {"on": "xmin", "quantity": "resultant"}, {"on": "zmax", "quantity": "resultant", "part": "block 1-*", "about": [1, 1, 0]},
           {"on": {"box": [[0.4, 0, 1], [1.2, 1, 1]]}, "quantity": "resultant"}, {"section": {"plane": "x", "at": 0.5}},
           {"section": {"plane": [1, 2, 0.5], "at": [0.7, 0.5, 0.5]}}, {"section": {"plane": "z", "at": 0.5}, "part": "block 2-1-*"}]
CASES = {
    "perfect": {
        "parts": [boxed("beam", [4, 1, 1], [8, 2, 2])], "subdomains": {"metis": 8},
        "materials": [{"young": 200e3, "poisson": 0.3}],
        "boundary": [{"on": {"plane": "x", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "x", "at": 4}, "traction": [[10, 0, 5], [0, 10, 1]]}],
        "output": PROBES,
    },
    # cross points, mono-scale: the bound balances by a problem of its own; η decides; k⁺ is one's own sole
    "mono-scale": {
        "mesh": {"box": {"size": [2, 2, 1], "cells": [4, 4, 2]}}, "subdomains": {"grid": [2, 2, 1]},
        "materials": [{"young": 200e3, "poisson": 0.3}],
        "boundary": [{"on": {"plane": "x", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "x", "at": 2}, "traction": [10, 0, 5]}], "blackbox": IN_PROCESS,
        "method": {"macro": {"strategy": "none"}, "search_direction": {"kplus": "full"}, "acceleration": "none",
                   "sole": {"kind": "layer"}, "tolerance": {"indicator": 1e-9}},
    },
    # blocks that are not cut along bricks; loads and supports of all kinds that are local
    "blocks": {
        "mesh": {"box": {"size": [3, 2, 2], "cells": [7, 6, 4]}, "scale": 0.5}, "subdomains": {"grid": [3, 2, 2]},
        "materials": [{"young": 200e3, "poisson": 0.3, "density": 2.0, "expansion": 1e-5}], "histories": {"up": [1, 0.5, 0], "down": [0, 1, 1]},
        "boundary": [{"on": "xmin", "symmetry": True}, {"on": {"plane": "y", "at": 0}, "displacement": [None, 0, 0]},
                     {"on": {"box": [[0.4, 0, 1], [1.2, 1, 1]]}, "pressure": 3.0, "history": "up"},
                     {"on": "xmax", "pressure": {"at": [0, 0, 0.7], "gradient": [0, 0, -4.0]}, "history": "down"},
                     {"on": "ymax", "traction": [[1, 2, 3], [0, 0, 1], [1, 2, 4]]},
                     {"on": "zmax", "resultant": {"force": [1, 2, -3], "moment": [0, 1, 2], "about": [0, 0, 1]}, "history": "up"}],
        "loads": [{"gravity": [0, 0, -1], "history": "up"}, {"temperature": {"at": [0, 0, 1], "gradient": [2, 1, 3]}, "history": "down"}],
        "blackbox": IN_PROCESS, "output": {"probes": WATCHED}, "method": {"tolerance": {"error": "auto", "fraction": 1e-5}},
    },
    # springs below several blocks, a frame that holds two sides of others, a point that a face of one block follows, another in the mean
    "grounds": {
        "mesh": {"box": {"size": [3, 2, 2], "cells": [6, 4, 4]}}, "subdomains": {"grid": [3, 2, 2]}, "blackbox": IN_PROCESS,
        "materials": [{"young": 200e3, "poisson": 0.3}], "histories": {"up": [1, 0.5]},
        "boundary": [{"on": "zmin", "foundation": {"normal": 1e5, "tangential": 3e4}}, {"on": "ymax", "traction": [[0, 30, 20], [10, 10, -20]]},
                     {"on": "ymin", "displacement": [0, None, None], "frame": {"axis": [0, 1, 1], "at": [1.5, 9, 1]}},
                     {"on": {"box": [[3, 0, 1], [3, 1, 2]]}, "coupling": {"about": [4, 0.5, 1.5], "force": [5, 0, -10], "moment": [1, 2, 3]},
                      "history": "up"},
                     {"on": {"box": [[0, 1, 1], [0, 2, 2]]}, "coupling": {"kind": "distributed", "displacement": [1e-3, None, 0]}}],
        "output": {"probes": [{"on": "zmin", "quantity": "resultant"}, {"on": "zmin"}, {"at": [1, 1, 0]}, {"section": {"plane": "z", "at": 0.5}}]},
    },
    # two bolts that are cut, tightened one after the other, and a joint with the law of one; in contact with what is between
    "bolted": {
        "parts": [boxed("low", [3, 1, 0.5], [6, 2, 1], [0, 0, 0]), boxed("one", [1, 1, 1], [2, 2, 4], [0, 0, 0.5]),
                  boxed("two", [1, 1, 1], [2, 2, 4], [2, 0, 0.5]), boxed("high", [3, 1, 0.5], [6, 2, 1], [0, 0, 1.5]),
                  boxed("end", [1, 1, 0.5], [2, 2, 1], [3, 0, 1.5]), boxed("amid", [1, 1, 1], [2, 2, 2], [1, 0, 0.5])],
        "subdomains": "groups", "materials": [{"young": 200e3, "poisson": 0.3}], "blackbox": IN_PROCESS,
        "histories": {"first": [1, 1], "then": [0, 1]},
        "interfaces": [{"law": "contact", "friction": 0.3}, {"law": "perfect", "between": ["one*", "low"]},
                       {"law": "perfect", "between": ["one*", "high"]},
                       {"law": "perfect", "between": ["two*", "low"]}, {"law": "perfect", "between": ["two*", "high"]},
                       {"law": "pretension", "between": ["high", "end"], "force": 30, "history": "then"}],
        "bolts": [{"on": "two", "cut": {"plane": "z", "at": 1}, "force": 50, "history": "first"},
                  {"on": "one", "cut": {"plane": [0, 0.1, 1], "at": [0.5, 0.5, 1.02]}, "force": 80, "history": "then"}],
        "boundary": [{"on": "low/zmin", "displacement": [0, 0, 0]}, {"on": "high/zmax", "displacement": [None, None, 0]},
                     {"on": "end/xmax", "displacement": [0, 0, 0]}],
        "method": {"tolerance": {"law": 1e-6}},
    },
    # files of gmsh's in partitions: ten-node tets, two kinds of matter
    "partitions": {
        "mesh": {"file": str(Path(__file__).parent / "meshes/bar_*.msh"), "scale": 2.0}, "subdomains": "groups",
        "materials": [{"young": 200e3, "poisson": 0.3, "density": 2.0},
                      {"young": 300e3, "poisson": 0.47, "density": 1.0, "expansion": 2e-5, "on": "bar_2"}],
        "boundary": [{"on": "wall", "displacement": [0, 0, 0]}, {"on": "end", "traction": [[10, 0, 5], [0, 10, 1]]},
                     {"on": "end", "resultant": {"force": [0, 10, 1]}},
                     {"on": {"plane": "x", "at": 8}, "displacement": [None, 0, None]}],
        "loads": [{"gravity": [0, 0, -1]}, {"temperature": 3.0, "on": "bar_2"}],
        "blackbox": {**IN_PROCESS, "element": "P2"},
    },
    "soft modes": {
        "mesh": {"box": {"size": [4, 4, 0.25], "cells": [8, 8, 1]}}, "subdomains": {"grid": [2, 2, 1]},
        "materials": [{"young": 200e3, "poisson": 0.3}],
        "boundary": [{"on": {"plane": "x", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "x", "at": 4}, "traction": [0, 0, 1]}],
        "method": {"macro": {"basis": "modes"}}, "blackbox": IN_PROCESS,
    },
    "contact": {
        "mesh": {"box": {"size": [2, 2, 2], "cells": [4, 4, 4]}}, "subdomains": {"grid": [2, 2, 2]},
        "materials": [{"young": 200e3, "poisson": 0.3}],
        "interfaces": [{"between": ["*", "*"], "law": "contact", "friction": 0.2},
                       {"between": ["block 0-0-0", "block 1-0-0"], "law": "perfect"},
                       {"between": ["block 0-1-0", "block 0-1-1"], "law": "pretension", "force": 100.0}],
        "boundary": [{"on": {"plane": "z", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "z", "at": 2}, "displacement": [[0, 0, -0.01], [0.004, 0, -0.01]]},
                     {"on": {"plane": "x", "at": 2}, "foundation": {"normal": 1e4, "tangential": 1e3}},
                     {"on": {"box": [[0, 0, 0.5], [0, 1, 1.5]]}, "displacement": [[1e-3, None, None], [0, None, None]]}],
        "method": {"tolerance": {"law": 1e-6}},
        "output": {"probes": [{"on": {"plane": "z", "at": 0}, "quantity": "resultant"}, {"section": {"plane": "z", "at": 0.5}},
                              {"on": {"plane": "y", "at": 2}, "quantity": "max", "of": "stress"}, {"on": {"plane": "x", "at": 2}},
                              {"on": {"plane": "x", "at": 2}, "quantity": "resultant"}]},
    },
    # sides meshed each on its own: a T in which all is bonded, and one that slides on one side; supports beside interfaces
    "parts bonded": {
        "parts": [boxed("base", [2, 1, 0.5], [7, 4, 2], [0, 0, 0]), boxed("left", [0.9, 1, 0.5], [4, 5, 2], [0, 0, 0.5]),
                  boxed("right", [1.1, 1, 0.5], [3, 3, 2], [0.9, 0, 0.5]), boxed("end", [0.5, 1, 0.5], [2, 3, 2], [2, 0, 0])],
        "subdomains": "groups",
        "materials": [{"young": 200e3, "poisson": 0.3}], "interfaces": [{"law": "perfect"}], "blackbox": IN_PROCESS,
        "boundary": [{"on": {"plane": "x", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "z", "at": 1}, "traction": [[10, 0, 5], [0, 10, 1]]}],
    },
    "leaps between parts": {
        "parts": [boxed("low", [2, 1, 0.5], [2, 2, 1], [0, 0, 0]), boxed("high", [2, 1, 0.5], [3, 3, 1], [1, 0, 0.5])],
        "subdomains": "groups", "materials": [{"young": 200e3, "poisson": 0.3}], "blackbox": {**IN_PROCESS, "element": "P2"},
        "interfaces": [{"law": "perfect"}],
        "boundary": [{"on": {"plane": "x", "at": 0}, "displacement": [0, 0, 0]}, {"on": {"plane": "x", "at": 3}, "traction": [10, 0, 0]}],
    },
    "parts in contact": {
        "parts": [boxed("base", [2, 1, 0.5], [6, 3, 2], [0, 0, 0]), boxed("left", [0.9, 1, 0.5], [4, 4, 2], [0, 0, 0.5]),
                  boxed("right", [1.1, 1, 0.5], [3, 2, 2], [0.9, 0, 0.5]), boxed("end", [0.5, 1, 0.5], [2, 2, 2], [2, 0, 0])],
        "subdomains": "groups",
        "materials": [{"young": 200e3, "poisson": 0.3}], "blackbox": IN_PROCESS,
        "interfaces": [{"between": ["*", "*"], "law": "contact", "friction": 0.2},
                       {"between": ["base", "left"], "law": "perfect"}],
        "boundary": [{"on": {"plane": "z", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "z", "at": 1}, "displacement": [[0, 0, -0.01], [0.004, 0, -0.01]]}],
        "method": {"tolerance": {"error": 1e-6}}, "output": PROBES,
    },
    "parts that slide on": {
        "parts": [boxed("base", [4, 1, 0.5], [8, 2, 1], [0, 0, 0]), boxed("block", [1, 1, 0.5], [3, 3, 2], [0.25, 0, 0.5])],
        "subdomains": "groups", "materials": [{"young": 200e3, "poisson": 0.3}], "blackbox": IN_PROCESS,
        "interfaces": [{"law": "contact", "friction": 0.2, "pairing": "follow"}],
        "boundary": [{"on": {"plane": "z", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "z", "at": 1}, "displacement": [[0.7, 0, -0.005], [1.6, 0.1, -0.005]]}],
        "method": {"tolerance": {"error": 1e-6}},
    },
    # little friction in one load step: the error is guaranteed, with a factor
    "a little friction": {
        "parts": [boxed("base", [1, 1, 0.5], [2, 2, 1], [0, 0, 0]), boxed("block", [1, 1, 0.5], [3, 3, 1], [0, 0, 0.5])],
        "subdomains": "groups", "materials": [{"young": 200e3, "poisson": 0.3}], "blackbox": IN_PROCESS,
        "interfaces": [{"law": "contact", "friction": 0.1}],
        "boundary": [{"on": {"plane": "z", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "z", "at": 1}, "displacement": [0.004, 0, -0.01]}],
        "method": {"tolerance": {"error": "auto", "fraction": 1e-4}},
    },
    "contact on ten nodes": {
        "mesh": {"box": {"size": [2, 2, 1], "cells": [2, 2, 2]}}, "subdomains": {"grid": [2, 2, 1]},
        "materials": [{"young": 200e3, "poisson": 0.3}], "blackbox": {**IN_PROCESS, "element": "P2"},
        "interfaces": [{"between": ["*", "*"], "law": "contact", "friction": 0.2}],
        "boundary": [{"on": {"plane": "x", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "x", "at": 2}, "displacement": [[-0.01, 0, 0], [-0.01, 0.002, 0]]},
                     {"on": {"box": [[0, 0, 0], [1, 1, 0]]}, "displacement": [None, None, 0]}],
        "method": {"tolerance": {"error": 1e-5}},
    },
    # a stack whose upper half slides far, as springs of stabilisation begin anew; with one friction, where it slides would be rounding's choice
    "slides far": {
        "mesh": {"box": {"size": [1, 1, 1], "cells": [2, 2, 4]}}, "subdomains": {"grid": [1, 1, 4]}, "blackbox": IN_PROCESS,
        "materials": [{"young": 200e3, "poisson": 0.3}], "interfaces": [
            {"law": "contact", "friction": 0.2}, {"between": ["block 0-0-1", "block 0-0-2"], "law": "contact", "friction": 0.1}],
        "boundary": [{"on": {"plane": "z", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "z", "at": 1}, "displacement": [[0, 0, None], [0.05, 0, None]]},
                     {"on": {"plane": "z", "at": 1}, "pressure": 100.0}],
        "method": {"tolerance": {"law": 1e-6}},
    },
    # beams that bend, moved in modes of their own
    "slender beams": {
        "mesh": {"box": {"size": [10, 1, 2], "cells": [10, 1, 2]}}, "subdomains": {"grid": [1, 1, 2]}, "blackbox": IN_PROCESS,
        "materials": [{"young": 200e3, "poisson": 0.3}], "interfaces": [{"law": "contact", "friction": 0.3}],
        "boundary": [{"on": {"plane": "x", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"box": [[10, 0, 1], [10, 1, 2]]}, "traction": [[0, 0, -1], [1, 0, -2]]}],
        "method": {"tolerance": {"law": 1e-8}},
    },
    # a block that is pushed beyond what friction holds: what each rank knows of the contact goes into one cone problem
    "pushed off": {
        "mesh": {"box": {"size": [1, 1, 1], "cells": [2, 2, 2]}}, "subdomains": {"grid": [1, 1, 2]}, "blackbox": IN_PROCESS,
        "materials": [{"young": 200e3, "poisson": 0.3}], "interfaces": [{"law": "contact", "friction": 0.2}],
        "boundary": [{"on": {"plane": "z", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "z", "at": 1}, "traction": [30, 0, -100]}],
    },
    # a grain that nothing holds shows differences of rounding, ten million times larger; with the springs that auto ends with, a
    # hundredth of these, a thousand million times
    "loose grains": {
        "mesh": {"polycrystal": {"grains": 10, "size": 1, "h": 0.15, "seed": 7}}, "subdomains": "groups",
        "materials": [{"young": 200e3, "poisson": 0.3}], "interfaces": [{"law": "contact", "friction": 0.1}],
        "boundary": [{"on": {"plane": "z", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "z", "at": 1},
                      "displacement": [[0, 0, -0.005], [0, 0, -0.01], [0, 0, -0.005], [0, 0, -0.001]]}],
        "method": {"tolerance": {"law": 1e-4}, "contact": {"stabilisation": 2.5e-5}},
    },
    # made in pieces: gaps that are read, sides that touch and match, of which one is bonded, and supports on one of several bodies
    "parts apart": {
        "parts": [boxed("base", [2, 1, 0.5], [4, 2, 1], [0, 0, 0]), boxed("left", [0.9, 1, 0.5], [2, 2, 1], [0, 0, 0.501]),
                  boxed("right", [1, 1, 0.5], [2, 2, 1], [1, 0, 0.5]), boxed("top", [2, 1, 0.5], [3, 1, 1], [0, 0, 1.002])],
        "subdomains": "groups", "materials": [{"young": 200e3, "poisson": 0.3}], "blackbox": {**IN_PROCESS, "element": "P2"},
        "interfaces": [{"law": "contact", "friction": 0.3, "gap": "geometry"}, {"between": ["base", "right"], "law": "perfect"}],
        "boundary": [{"on": "base/zmin", "displacement": [0, 0, 0]}, {"on": "left/xmin", "displacement": [0, None, None]},
                     {"on": "top/zmax", "displacement": [[0, 0, -0.006], [0.004, 0, -0.006]]}],
        "method": {"tolerance": {"error": 1e-4}},
        "output": {"probes": [{"at": [0.5, 0.5, 0.5], "part": "base"}, {"along": [[0, 0, 0.4], [2, 1, 1.2]]}]},
    },
    # two tools: a plane that comes down on two bodies, and a ball that is pushed into three from aside
    "tools": {
        "parts": [boxed("base", [2, 1, 0.5], [4, 2, 1], [0, 0, 0]), boxed("left", [1, 1, 0.5], [2, 2, 1], [0, 0, 0.5]),
                  boxed("right", [1, 1, 0.5], [2, 2, 1], [1, 0, 0.5]), boxed("foot", [2, 1, 0.5], [4, 2, 1], [0, 0, -0.5])],
        "subdomains": "groups", "materials": [{"young": 200e3, "poisson": 0.3}], "blackbox": IN_PROCESS,
        "interfaces": [{"law": "perfect"}, {"law": "contact", "friction": 0.2, "between": [
            "*t", {"plane": {"at": [0, 0, 1.001], "normal": [0, 0, -1]}, "displacement": [[0, 0, -0.002], [0.001, 0, -0.003]]}]},
            {"law": "contact", "between": ["*", {"sphere": {"centre": [4, 0.5, 0.8], "radius": 2}, "force": [-20, 0, 0]}]}],
        "boundary": [{"on": "foot/zmin", "displacement": [0, 0, 0]}], "method": {"tolerance": {"error": 1e-4}},
    },
    # a plane that presses on two bodies in contact: on the rank of the third, and largest, no point is
    "contact on one of two ranks": {
        "parts": [boxed("base", [2, 1, 0.5], [6, 4, 4], [0, 0, 0]), boxed("left", [1, 1, 0.5], [2, 2, 1], [0, 0, 0.5]),
                  boxed("right", [1, 1, 0.5], [2, 2, 1], [1, 0, 0.5])],
        "subdomains": "groups", "materials": [{"young": 200e3, "poisson": 0.3}], "blackbox": IN_PROCESS,
        "interfaces": [{"law": "perfect"}, {"between": ["left", "right"], "law": "contact", "friction": 0.2},
            {"law": "contact", "friction": 0.2, "between": [
                "*t", {"plane": {"at": [0, 0, 1.001], "normal": [0, 0, -1]}, "displacement": [0.001, 0, -0.003]}]}],
        "boundary": [{"on": "base/zmin", "displacement": [0, 0, 0]}], "method": {"tolerance": {"error": 1e-4}},
    },
    # two blocks in contact, each cut in pieces: bonds at nodes in contact, between ranks as well
    "cut blocks in contact": {
        "mesh": {"box": {"size": [3, 2, 2], "cells": [6, 4, 4]}}, "subdomains": {"grid": [3, 2, 2]},
        "materials": [{"young": 200e3, "poisson": 0.3}],
        "interfaces": [{"between": ["*-0", "*-1"], "law": "contact", "friction": 0.3}],
        "boundary": [{"on": {"plane": "z", "at": 0}, "displacement": [0, 0, 0]},
                     {"on": {"plane": "z", "at": 2}, "displacement": [[0, 0, -0.002], [0.001, 0, -0.002], [0, 0.001, -0.001]]}],
        "blackbox": IN_PROCESS, "method": {"tolerance": {"error": 1e-6}},
    },
}


def found(name: str, team: Team = ALONE, nudge: float = 0.0) -> dict[str, np.ndarray] | None:
    """What a case comes out as; on rank 0. ``nudge``: a force per volume on all of it."""
    loads = {"loads": [{"body_force": [nudge, -0.7 * nudge, 0.4 * nudge]}]} if nudge else {}
    config = config_from({"name": name, **CASES[name], **loads})
    solved = solve(config, ranks=Ranks(team))
    if team.rank:
        return None
    summary = solved.summary
    result = {"displacement": solved.displacement, "estimate": [summary["discretisation_error"]], "reactions": summary["reactions"],
              "energy": summary["energy"], "iterations": summary["iterations"], "sweeps": summary["sweeps"]["total"],
              "factor": summary["error_factor"] or 0.0,
              "weakened": (summary["stabilised"] or {"weakened": []})["weakened"]}
    if summary["limit_load"]:
        result["limit"] = [[limit["lacking"], *limit["motions"][0]["shift"]] for limit in summary["limit_load"]]
    for bolt in summary["bolts"] or ():
        result[f"bolt {bolt['name']}"] = [bolt[name] for name in ("force", "shear", "bending", "torsion", "shortening")]
    if summary["error_shares"]:
        result["shares"] = [share for _, share in sorted(summary["error_shares"]["bodies"].items())]
    if summary["places"]:
        result["places"] = [far or 0.0 for _, far in sorted(summary["places"]["bodies"].items())]
    if summary["tools"]:
        result["tools"] = [tool[name] for tool in summary["tools"] for name in ("displacement", "rotation")]
    carried = solved.resultants
    result |= {"carried": carried.force, "turned": carried.moment, "moments": summary["reaction_moments"]["moments"],
               "stresses": [float(row[3]) for row in solved.tables["extremes.csv"][1:] if row[1] in STRESS]}
    result |= {one["name"]: np.nan_to_num(np.array(list(one["values"].values()), float))
               for one in (*summary["probes"], *summary["paths"])}
    if (met := solved.met) is not None:  # what nodes add up to, which are on all ranks
        result |= {"taken": met.work, "lost": met.dissipation, "pressed": met.pressure, "each": met.resultant,
                   "far": np.nan_to_num([met.slid, met.amiss]),
                  "on faces": [0.0, *(x for face in met.faces for name in ("normal", "bears", "carried", "capacity") for x in face.carries[name])],
                   "told": json.dumps([met.counts, met.detached, met.weakly_held, met.within.tolist(), met.common.tolist(), met.unresolved, [
                       (face.name, face.pieces, face.carries["slipping"].tolist()) for face in met.faces]])}
    if solved.interfaces is not None:
        result |= {"sides": np.concatenate(solved.sides, axis=1), "joined": solved.fields.joined, "status": solved.interfaces.status,
                   "pressure": solved.interfaces.pressure, "resultant": solved.interfaces.resultant}
        if solved.interfaces.shift_normal is not None:
            result |= {"shifts": np.stack([solved.interfaces.shift_normal, solved.interfaces.shift_tangential]),
                       "largest shifts": [summary["backward"][name] for name in ("normal", "tangential")]}
    return result


PAIRED = "paired anew"  # once it has converged, where sides have slid to
AGAIN = {PAIRED: CASES["parts that slide on"] | {"interfaces": [{"law": "contact", "friction": 0.2}]}}


def again(name: str, folder: Path, team: Team) -> None:
    """A run that is set up again, in a results folder."""
    config = {"name": name, **AGAIN[name], "output": {"figures": False}}
    if team.rank:
        follow(team)
    else:
        (folder / f"{name}.yaml").write_text(json.dumps(config))
        run(load_config(folder / f"{name}.yaml", []), output=folder / name, quiet=True, means=Means(Ranks(team)))
        team.share(None)


REFINED = {  # bonds at a cross point, which are guaranteed, and contact beside a bond
    "refined bonds": {"subdomains": {"grid": [2, 1, 2]}, "interfaces": [{"law": "perfect"}]},
    "refined contact": {"subdomains": {"slices": {"axis": "z", "count": 3}}, "interfaces": [
        {"law": "contact", "friction": 0.1}, {"between": ["slice 0", "slice 1"], "law": "perfect"}]}}


def refined(name: str, folder: Path, team: Team = ALONE) -> None:
    """A run on finer and finer meshes until a field is told to its accuracy."""
    if team.rank:
        follow(team)
        return
    probes = [{"at": [0.6, 0.5, 1.5]}, {"on": "zmin", "quantity": "resultant"}, {"section": {"plane": "z", "at": 0.5}}]
    config = config_from({
        "name": name, "mesh": {"box": {"size": [1, 1, 2], "cells": [3, 2, 6]}}, **REFINED[name],
        "materials": [{"young": 1000.0, "poisson": 0.3}], "blackbox": IN_PROCESS,
        "boundary": [{"on": "zmin", "displacement": [0, 0, 0]}, {"on": "zmax", "displacement": [0.3, 0.1, -0.3]},
                     {"on": {"box": [[1, 0, 1], [1, 1, 2]]}, "traction": [50, 25, 0]}],
        "output": {"figures": False, "probes": probes},
        "method": {"accuracy": {"error": 0.1, "elements": 800}}})
    assert accuracy(Loaded(config), output=folder, quiet=True, means=Means(Ranks(team))) == NOT_CONVERGED
    team.share(None)


SIZE = 3  # of the blocks in elimination


def lattice(n: int) -> tuple[np.ndarray, int]:
    """(I, 2) neighbours in a cube of n³ bodies, and two chains beside it that touch nothing."""
    number = np.arange(n**3).reshape(n, n, n)
    ends = [np.column_stack([number.take(range(n - 1), axis).ravel(), number.take(range(1, n), axis).ravel()])
            for axis in range(3)]
    return np.vstack([*ends, n**3 + np.array([[0, 1], [1, 2], [2, 3], [5, 4]])]), n**3 + 7  # the last meets nobody


def eliminate(team: Team) -> None:
    """Interfaces of a lattice are dealt to ranks: all have the solution of one process, the same bits each."""
    ends, bodies = lattice(5)
    rng = np.random.default_rng(8)
    slopes, own = rng.normal(size=(len(ends), 2, 2, SIZE, SIZE)), 20 * np.eye(SIZE) + rng.normal(size=(bodies, SIZE, SIZE))
    right, mine = rng.normal(size=(bodies, SIZE)), rng.integers(team.size, size=len(ends)) == team.rank
    pattern, whole = BlockPattern(ends[mine], bodies, SIZE, team), BlockPattern(ends, bodies, SIZE)
    found = pattern.factors(pattern.values(slopes[mine], own), 0.1).solve(right)
    assert np.abs(found - whole.factors(whole.values(slopes, own), 0.1).solve(right)).max() < 1e-12
    assert len(set(team.all_gather(found.tobytes()))) == 1


if __name__ == "__main__":
    ranks = join()
    with ranks.together():
        eliminate(ranks)
        for case in sys.argv[2:]:
            if case in AGAIN:
                again(case, Path(sys.argv[1]), ranks)
                continue
            if case in REFINED:
                refined(case, Path(sys.argv[1]) / case, ranks)
                continue
            answer = found(case, ranks)
            if answer is not None:
                np.savez(f"{sys.argv[1]}/{case}.npz", ranks=ranks.size, **answer)
