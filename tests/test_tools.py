"""Rigid tools without a mesh: beside what is prescribed outright, books, each other; and what is wrong with them."""

import copy

import numpy as np
import pytest
from in_process import IN_PROCESS
from quick import quick_sets

from orchestrator.config.load import config_from
from orchestrator.errors import InputError
from orchestrator.run import solve
from orchestrator.scene.build import build_scene

HELD = {"on": "zmin", "displacement": [0, 0, 0]}
PLANE = {"plane": {"at": [0, 0, 0.5], "normal": [0, 0, -1]}}
BALL = {"sphere": {"centre": [0.5, 0.5, 2.5], "radius": 2.0}}


def block(tool: dict, element: str = "P1", error: float = 1e-5, **entry) -> dict:
    return {"name": "tools", "mesh": {"box": {"size": [1, 1, 0.5], "cells": [4, 4, 2]}}, "subdomains": {"grid": [1, 1, 1]},
            "materials": [{"young": 1e3, "poisson": 0.3}], "boundary": [HELD], "blackbox": {**IN_PROCESS, "element": element},
            "interfaces": [{"between": ["*", tool], "law": "contact", **entry}], "method": {"tolerance": {"error": error}},
            "output": {"figures": False}}


def solved(data: dict):
    solution = solve(config_from(data))
    assert solution.converged, solution.stop_reason
    return solution


@pytest.mark.parametrize("element, gap, error", quick_sets((("P1", 0.0, 1e-4), ("P1", 0.02, 1e-5), ("P2", 0.0, 1e-5)), ("P1", 0.0, 1e-4)))
@pytest.mark.long
def test_a_force_does_what_the_way_does_that_it_makes(element, gap, error):
    """Across a gap, too; the layer that stands for the tool gives way by less than a thousandth. No gap is told to be off."""
    found = solved(block({**BALL, "displacement": [0, 0, -0.01]}, element, error))
    assert not any("gaps are off" in text for text in found.summary["warnings"])
    force = found.reactions[1, 0, 2]
    higher = {"sphere": {"centre": [0.5, 0.5, 2.5 + gap], "radius": 2.0}}
    pushed = solved(block({**higher, "force": [0, 0, force]}, element, error))
    assert pushed.summary["tools"][0]["displacement"][0] == pytest.approx([0, 0, -0.01 - gap], abs=1e-5)
    assert pushed.reactions[1, 0] == pytest.approx(found.reactions[1, 0], abs=1e-4 * -force)  # aside, too: the mesh is not symmetric
    about, there = (np.array(s.summary["reaction_moments"]["moments"])[1, 0] for s in (pushed, found))
    assert about == pytest.approx([0.5 * force, -0.5 * force, 0], abs=1e-3 * -force) and about == pytest.approx(there, abs=2e-4 * -force)
    assert pushed.iterations < 4 * found.iterations


@pytest.mark.parametrize("more, holds", [(-0.005, True), (0.005, False)])
def test_a_block_slides_off_an_incline_at_the_angle_of_friction(more, holds):
    angle = np.arctan(0.3) + more
    data = block({"plane": {"at": [0, 0, 0], "normal": "z"}}, error=1e-3, friction=0.3)
    data |= {"boundary": [], "loads": [{"body_force": [10 * np.sin(angle), 0, -10 * np.cos(angle)]}]}
    solution = solve(config_from(data))
    assert (solution.stop_reason == "converged") == holds and bool(solution.summary["limit_load"]) != holds


FLOOR = {"plane": {"at": [0, 0, 0], "normal": "z"}, "name": "floor"}
SLAB = {"name": "slab", "mesh": {"box": {"size": [1, 1, 0.5], "cells": [3, 3, 1]}}, "move": {"translate": [0, 0, -0.5]}}


@pytest.mark.parametrize("under, element", [(FLOOR, "P1"), (FLOOR, "P2"), (SLAB, "P1")], ids=["plane", "plane, six-node faces", "meshed apart"])
@pytest.mark.parametrize("sides, across", [(("xmax",), 0.0), (("xmin", "xmax"), 5.0)], ids=["one side", "both sides, pushed across"])
def test_nodes_that_are_dragged_by_supports_rub(under, element, sides, across):
    """Sides that supports drag end on the floor: μ N in all, against the way. What pushes across the way is carried by the part of
    friction that points there, tan = 5/√(20² − 5²)."""
    meshed = under is SLAB
    on = {"box": {"size": [1, 1, 0.4], "cells": [2, 2, 1]}}
    parts = [{"name": "block", "mesh": on}, *([SLAB] if meshed else [])]
    held = [{"on": "slab/zmin", "displacement": [0, 0, 0]}, {"on": "slab/xmax", "displacement": [0, None, None]}] if meshed else []
    solution = solved({
        "name": "dragged", "parts": parts, "subdomains": "groups", "materials": [{"young": 2e5, "poisson": 0.0}],
        "boundary": [{"on": "block/zmax", "traction": [0, across, -100]}, *held,
                     *({"on": f"block/{side}", "displacement": [0.01, None, None]} for side in sides)],
        "interfaces": [{"between": "auto" if meshed else ["block", under], "law": "contact", "friction": 0.2}],
        "blackbox": {**IN_PROCESS, "element": element}, "method": {"tolerance": {"error": 1e-6}}, "output": {"figures": False}})
    pulled = sum(solution.reactions[k, 0, 0] for k, name in enumerate(solution.summary["reaction_names"]) if name.startswith("block"))
    assert pulled == pytest.approx(np.sqrt(20**2 - across**2), rel=1e-4)
    if across and not meshed:
        moved = solution.parts[0][0]
        assert moved[:, 1].mean() == pytest.approx(0.01 * across / np.sqrt(20**2 - across**2), rel=5e-3)


def test_supports_that_rest_leave_friction_undetermined():
    """And that is told, with the load steps."""
    tool = {"plane": {"at": [0, 0, 0.5], "normal": [0, 0, -1]}}
    data = block(tool, friction=0.2)
    data["histories"] = {"go": [0, 1, 2, 2]}
    data["boundary"] = [HELD, {"on": "xmax", "displacement": [0.01, None, None], "history": "go"}]
    data["boundary"][0] = {"on": "zmin", "displacement": [None, None, 0.001]}
    (told,) = [text for text in build_scene(config_from(data)).warnings if "rest at load step" in text]
    assert "at load step 1, 4:" in told and "5 nodes" in told
    data["histories"] = {"go": [1, 2, 3, 2]}
    assert not [text for text in build_scene(config_from(data)).warnings if "rest at load step" in text]


def test_a_tool_is_pulled_along_the_part_as_far_as_friction_holds():
    """Nothing else holds it that way: without friction it is refused."""
    belt = {"plane": {"at": [0, 0, 0.5], "normal": [0, 0, -1]}, "displacement": [None, 0, -0.001], "force": [0.05, 0, 0]}
    solution = solved(block(belt, friction=0.2))
    assert solution.reactions[1, 0, 0] == pytest.approx(0.05, rel=1e-4)
    with pytest.raises(InputError, match="nothing holds it"):
        build_scene(config_from(block(belt)))


WRONG = {
    "an unknown shape": ({"torus": {"radius": 1.0}}, {}, "unknown key 'torus'"),
    "two shapes": (BALL | PLANE, {}, "sphere and plane together"),
    "no radius": ({"sphere": {"centre": [0, 0, 9], "radius": 0.0}}, {}, "> 0"),
    "no direction": ({"plane": {"at": [0, 0, 1], "normal": [0, 0, 0]}}, {}, "a direction"),
    "held and pushed": (BALL | {"displacement": [0, 0, 0], "force": [0, 0, -1.0]}, {}, "displacement holds the tool"),
    "free at times": (BALL | {"displacement": [[0, 0, 0], [0, 0, None]]}, {}, "free at some steps only"),
    "glued": (BALL, {"law": "perfect"}, "law: perfect with a rigid tool"),
    "a gap": (BALL, {"gap": 0.1}, "gap beside a rigid tool"),
    "follows": (BALL, {"pairing": "follow"}, "follow beside a rigid tool"),
    "no history": (BALL | {"history": "none"}, {}, "which is not defined"),
    "inside": ({"sphere": {"centre": [0.5, 0.5, 2.4], "radius": 2.0}}, {}, "begins 0.1 inside the part, at (0.5, 0.5, 0.5)"),
    "amid a facet": ({"sphere": {"centre": [0.58, 0.67, 0.6], "radius": 0.15}}, {}, "inside the part"),
    "inside altogether": ({"sphere": {"centre": [0.61, 0.63, 0.26], "radius": 0.05}}, {}, "inside the part altogether"),
    "far away": ({"plane": {"at": [0, 0, 2.5], "normal": [0, 0, -1]}}, {}, "comes no nearer than 2 "),
    "drawn away": (BALL | {"force": [0, 0, 1.0]}, {}, "draws sphere away"),
    "a part's name": (BALL | {"name": "box"}, {}, "as a part is"),
    "no such part": (BALL, {"between": ["bolt", BALL]}, "no volume is called 'bolt'"),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_with_a_tool_is_one_message(what):
    tool, entry, words = WRONG[what]
    data = block(copy.deepcopy(tool))
    data["interfaces"][0] |= entry
    with pytest.raises(InputError) as caught:
        build_scene(config_from(data))
    assert len(caught.value.problems) == 1 and words in str(caught.value) and caught.value.problems[0].cure


def test_a_tool_that_presses_on_what_is_held_is_called_by_its_name():
    data = block(PLANE | {"displacement": [0, 0, -0.01]})
    data["boundary"] = [HELD, {"on": "xmin", "displacement": [0, 0, 0]}]
    with pytest.raises(InputError, match=r"boundary\[1\] and plane on both sides") as caught:
        build_scene(config_from(data))
    assert [problem.path for problem in caught.value.problems] == [("interfaces", 0)]


def test_what_holds_a_tool_does_not_feel_how_far_it_goes():
    """A layer is stiff: of a way along with the part nothing must be left, not even its rounding."""
    data = {**block({**PLANE, "displacement": [1e4, 0, -0.01]}), "boundary": [{"on": "zmin", "displacement": [1e4, 0, 0]}]}
    assert np.abs(solved(data).reactions[1, 0, :2]).max() < 1e-9
