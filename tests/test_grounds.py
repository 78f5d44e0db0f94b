"""Supports that give, and points that surfaces follow: against CalculiX, closed forms, and what prescribes the same outright."""

import numpy as np
import pytest
from in_process import IN_PROCESS
from ring_case import ring

from orchestrator.config.load import config_from
from orchestrator.errors import InputError
from orchestrator.run import solve
from orchestrator.scene.build import build_scene
from orchestrator.scene.cautions import scene_cautions
from orchestrator.scene.mesh.geometry import node_areas
from orchestrator.scene.mesh.quadratic import CORNER_SHARES
from benchmarks.kit.calculix_whole import displacements

ELEMENTS = ("P1", "P2")
HELD = {"on": "zmin", "displacement": [0, 0, 0]}
LOADED = {"on": "zmax", "traction": [3.0, 1.0, -5.0]}


def bar(boundary: list, element: str = "P1", **changes) -> dict:
    return {"name": "bar", "mesh": {"box": {"size": [1, 1, 2], "cells": [2, 2, 2]}}, "subdomains": {"slices": {"axis": "z", "count": 1}},
            "materials": [{"young": 2e4, "poisson": 0.3}], "boundary": boundary, "blackbox": {**IN_PROCESS, "element": element},
            "method": {"tolerance": {"error": 1e-9}}, **changes}


def solved(*rest, **changes):
    solution = solve(config_from(bar(*rest, **changes)))
    assert solution.converged, solution.stop_reason
    return solution


def body(solution) -> int:
    """Number of the nodes that are not a ground's."""
    return int(solution.scene.subdomains[0].nodes.max()) + 1


def test_a_foundation_is_what_springs_at_the_nodes_are_in_calculix(tmp_path):
    solution = solved([{"on": "zmin", "foundation": {"normal": 1000.0, "tangential": 300.0}}, {**LOADED, "history": "any"}],
                      histories={"any": [1.0, -2.0]})
    scene, n = solution.scene, body(solution)
    interface = scene.interfaces[0]
    points = scene.mesh.nodes[interface.global_nodes]
    area = node_areas(points, interface.triangles, CORNER_SHARES[3])
    lines, element = [], len(scene.mesh.cells)
    for node, a in zip(interface.global_nodes + 1, area):
        for direction, k in ((1, 300.0), (2, 300.0), (3, 1000.0)):
            element += 1
            lines.append(f"*ELEMENT,TYPE=SPRING1,ELSET=K{element}\n{element},{node}\n*SPRING,ELSET=K{element}\n{direction}\n{k * a:.13e}")
    exact = displacements(scene, tmp_path, more="\n".join(lines))
    assert np.abs(exact - solution.displacement)[:, :n].max() < 1e-6 * np.abs(exact).max()
    same = solved([{"on": "zmin", "foundation": {"stiffness": [300.0, 300.0, 1000.0]}}, LOADED])
    assert np.allclose(same.displacement[0], solution.displacement[0], atol=1e-8 * np.abs(exact).max())


@pytest.mark.parametrize("element", ELEMENTS)
def test_tractions_and_displacements_have_cylindrical_components(element, tmp_path):
    """A ring that is held outside and sheared inside along its tangent: the moment, and u_θ = τ a² (b/r − r/b) … of theory."""
    tau, a, b = 6.0, 1.0, 2.0
    frame = {"axis": [0, 0, 2.0], "at": [0, 0, 7.0]}
    x = ring(tmp_path / "ring.msh", a, b, 0.3, (3, 6, 1))
    data = bar([{"on": "outer", "displacement": [0, 0, 0], "frame": frame},
                {"on": "inner", "traction": [[0, tau, 0], [0, 0, tau]], "frame": frame}],
               element, mesh={"file": str(tmp_path / "ring.msh")})
    scene = build_scene(config_from(data))
    loads, points = scene.loads, scene.mesh.nodes
    entry = scene.boundary[1]
    corners = scene.mesh.nodes[entry.triangles[:, :3]]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    unit = corners[..., :2] / np.linalg.norm(corners[..., :2], axis=2, keepdims=True)
    tangent = np.stack([-unit[..., 1], unit[..., 0]], axis=2)  # linear between the corners
    weight = (1 + np.eye(3)) / 12
    force = tau * np.einsum("k,kac->c", area / 3, tangent)
    moment = tau * np.einsum("k,ab,ka,kb->", area, weight, corners[..., 0], tangent[..., 1]) - tau * np.einsum(
        "k,ab,ka,kb->", area, weight, corners[..., 1], tangent[..., 0])
    assert loads[0].sum(axis=0) == pytest.approx([*force, 0], abs=1e-10)
    assert np.cross(points, loads[0]).sum(axis=0)[2] == pytest.approx(moment, abs=1e-10)
    assert moment == pytest.approx(tau * a**2 * np.pi / 2 * 0.3, rel=0.02)
    assert loads[1].sum(axis=0) == pytest.approx([0, 0, tau * area.sum()], abs=1e-10)
    grown = build_scene(config_from(bar([{"on": "outer", "displacement": [0.01, 0.02, 0.03], "frame": frame}],
                                        mesh={"file": str(tmp_path / "ring.msh")})))
    even = {"on": "start", "displacement": [None, 0, None]}  # what a radial displacement is there, but for rounding
    build_scene(config_from(bar([{"on": "outer", "displacement": [0.01, 0, 0], "frame": frame}, even],
                                mesh={"file": str(tmp_path / "ring.msh")})))
    at = np.flatnonzero(grown.fixed.any(axis=1))
    r = x[at, :2] / np.linalg.norm(x[at, :2], axis=1, keepdims=True)
    wanted = np.c_[0.01 * r + 0.02 * np.c_[-r[:, 1], r[:, 0]], np.full(len(at), 0.03)]
    assert grown.prescribed[0, at] == pytest.approx(wanted, abs=1e-14)


SPRINGS = {"on": "zmin", "foundation": {"normal": 10.0, "tangential": 1.0}}
WRONG = {
    "no stiffness": ([{"on": "zmin", "foundation": {}}], ("boundary", 0, "foundation"), "nothing"),
    "tangential alone": ([{"on": "zmin", "foundation": {"tangential": 1.0}}], ("boundary", 0, "foundation"), "tangential"),
    "both ways": ([{"on": "zmin", "foundation": {"normal": 1.0, "stiffness": [1.0, 1.0, 1.0]}}], ("boundary", 0, "foundation"), "alone"),
    "all zero": ([{"on": "zmin", "foundation": {"stiffness": [0.0, 0.0, 0.0]}}], ("boundary", 0, "foundation", "stiffness"),
                 "no stiffness"),
    "negative": ([{"on": "zmin", "foundation": {"normal": -1.0}}], ("boundary", 0, "foundation", "normal"), "> 0"),
    "slides away": ([{"on": "zmin", "foundation": {"normal": 1.0}}], ("boundary",), "translation along x"),
    "turns": ([HELD | {"displacement": [None, None, 0]}, {"on": "zmax", "coupling": {"displacement": [0, 0, None]}}], ("boundary",),
              "rotation about the z axis"),
    "a history of springs": ([SPRINGS | {"history": "h"}], ("boundary", 0, "history"), "springs are what they are"),
    "a frame of nothing": ([HELD, {"on": "zmax", "pressure": 1.0, "frame": {"axis": "z"}}], ("boundary", 1, "frame"), "nothing to turn"),
    "a frame without direction": ([HELD, {"on": "zmax", "traction": [1.0, 0, 0], "frame": {"axis": [0, 0, 0]}}],
                                  ("boundary", 1, "frame", "axis"), "direction"),
    "on the axis": ([HELD, {"on": "zmax", "traction": [1.0, 0, 0], "frame": {"axis": "z", "at": [0.5, 0.5, 0]}}], ("boundary", 1, "frame"),
                    "radial"),
    "through a face": ([HELD, {"on": "zmax", "traction": [1.0, 0, 0], "frame": {"axis": "z", "at": [0.4, 0.3, 0]}}],
                       ("boundary", 1, "frame"), "runs through"),
    "held through a face": ([HELD, {"on": "zmax", "displacement": [0, None, None], "frame": {"axis": "z", "at": [0.4, 0.3, 0]}}],
                            ("boundary", 1, "frame"), "runs through"),
    "loaded and prescribed": ([HELD, {"on": "zmax", "coupling": {"displacement": [0, None, None], "force": [1.0, 0, 0]}}],
                              ("boundary", 1, "coupling", "force"), "component x"),
    "nothing": ([HELD, {"on": "zmax", "coupling": {"kind": "distributed"}}], ("boundary", 1, "coupling"), "nothing prescribed"),
    "an unknown kind": ([HELD, {"on": "zmax", "coupling": {"kind": "soft"}}], ("boundary", 1, "coupling", "kind"), "rigid"),
    "two kinds": ([SPRINGS | {"pressure": 1.0}], ("boundary", 0, "pressure"), "together"),
    "held as well": ([HELD, {"on": "x*", "coupling": {"force": [1.0, 0, 0]}}], ("boundary",), "prescribed by another entry"),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_with_a_ground_is_told_with_its_place(what):
    boundary, path, words = WRONG[what]
    with pytest.raises(InputError) as caught:
        build_scene(config_from(bar(boundary)))
    problem = next((p for p in caught.value.problems if p.path == path), caught.value.problems[0])
    assert problem.path == path and words in str(problem) and problem.expected and problem.cure


@pytest.mark.parametrize("held, springs, told", [
    ([0, 0, 0], {"normal": 10.0}, True), ([None, None, 0], {"normal": 10.0}, True), ([0, 0, 0.1], {"stiffness": [1.0, 0, 0]}, True),
    ([None, None, 0], {"normal": 10.0, "tangential": 1.0}, False), ([0, 0, None], {"normal": 10.0}, False)])
def test_springs_under_what_is_held_along_them_carry_nothing(held, springs, told):
    boundary = [{"on": "zmin", "displacement": held}, {"on": "zmin", "foundation": springs}, {"on": "xmin", "displacement": [0, 0, None]}, LOADED]
    cautions = scene_cautions(build_scene(config_from(bar(boundary))))
    assert [text.startswith("boundary[1], a foundation, acts on faces alone whose displacement is prescribed") for text in cautions] == [True] * told


def test_a_surface_that_several_subdomains_share_is_no_coupling():
    with pytest.raises(InputError, match="a surface of one subdomain"):
        build_scene(config_from(bar([HELD, {"on": "xmax", "coupling": {"force": [1.0, 0, 0]}}],
                                    subdomains={"slices": {"axis": "z", "count": 2}})))


@pytest.mark.parametrize("on, moment, element", [
    ({"foundation": {"normal": 1e3}}, 0.0, "P1"), ({"foundation": {"normal": 1e3}}, 0.0, "P2"),
    ({"foundation": {"stiffness": [0, 0, 1e3]}}, 0.0, "P2"), ("coupling", 0.0, "P1"), ("coupling", 0.1, "P2")])
def test_even_tractions_pass(on, moment, element):
    """Stresses are those of the traction at every node, with six-node faces too; σ = -1 ± 6 M on a side of 1."""
    if on == "coupling":
        boundary = [{"on": "zmin", "coupling": {"kind": "distributed", "force": [0, 0, 1], "moment": [0, moment, 0]}},
                    {"on": "zmax", "displacement": [0, 0, 0]}]
    else:
        boundary = [{"on": "zmin", **on}, {"on": "zmax", "traction": [0, 0, -1]}, {"on": "xmin", "symmetry": True},
                    {"on": "ymin", "symmetry": True}]
    solution = solved(boundary, element, materials=[{"young": 2e4, "poisson": 0.0}], output={"figures": False, "probes": [
        {"name": name, "on": "zmin", "quantity": name, "of": "stress"} for name in ("min", "max")]})
    found = [probe["values"]["szz"][-1] for probe in solution.summary["probes"]]
    assert found == pytest.approx([-1 - 6 * moment, -1 + 6 * moment], rel=1e-4)
