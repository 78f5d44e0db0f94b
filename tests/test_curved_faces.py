"""Faces on cylinders, cones, spheres and tori, or on faces of a CAD model, have their normals and gaps, whatever their facets."""

import sys
from pathlib import Path

import gmsh
import numpy as np
import pytest
from scipy.spatial import Delaunay
from in_process import IN_PROCESS
from quick import late

from orchestrator import build_scene, config_from, solve
from orchestrator.scene.interfaces.skins import surface_of
from orchestrator.scene.mesh.geometry import node_normals

sys.path.append(str(Path(__file__).parents[1] / "meshes"))
from hertz import LENGTH, cylinder_on_block, write  # noqa: E402

TURN = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
ROUND = {
    "cylinder": lambda s, z: (np.cos(s), np.sin(s), z), "wide cylinder": lambda s, z: (4 * np.cos(s / 4), 4 * np.sin(s / 4), z),
    "cone": lambda s, z: ((3 + 0.2 * z) * np.cos(s / 3), (3 + 0.2 * z) * np.sin(s / 3), z),
    "sphere": lambda s, z: (np.cos(s) * np.cos(z - 0.7), np.sin(s) * np.cos(z - 0.7), np.sin(z - 0.7)),
    "torus": lambda s, z: ((3 + np.cos(z)) * np.cos(s / 3), (3 + np.cos(z)) * np.sin(s / 3), np.sin(z)),
    "its inner side": lambda s, z: ((3 + np.cos(3 + z)) * np.cos(s / 3), (3 + np.cos(3 + z)) * np.sin(s / 3), np.sin(3 + z))}


def meshed(at, wide=2.0, high=1.5, n=12):
    """A net over [0, wide] × [0, high], its inner nodes moved about, as ``at`` bends it, far away and turned: nodes, triangles, and
    the normals of the surface at the nodes."""
    s, z = (v.ravel() for v in np.meshgrid(np.linspace(0, wide, n), np.linspace(0, high, n), indexing="ij"))
    inner = (s > 0) & (s < wide) & (z > 0) & (z < high)
    moves = np.random.default_rng(0).uniform(-0.3, 0.3, (2, inner.sum())) / n
    s[inner], z[inner] = s[inner] + wide * moves[0], z[inner] + high * moves[1]
    small = 1e-5
    along, across = (np.stack(at(s + a, z + b), 1) - np.stack(at(s - a, z - b), 1) for a, b in ((small, 0), (0, small)))
    normal = np.cross(along, across) @ TURN * np.linalg.det(TURN)
    return (np.stack(at(s, z), axis=1) @ TURN + [300, -200, 100], Delaunay(np.c_[s, z]).simplices,
            normal / np.linalg.norm(normal, axis=1, keepdims=True))


@pytest.mark.parametrize("name", ROUND)
def test_normals_of_round_faces(name):
    points, triangles, exact = meshed(ROUND[name])
    surface = surface_of(points, triangles, np.full(len(triangles), -1))
    means = node_normals(points, triangles)
    way = np.sign(np.sum(means * exact, axis=1))[:, None]
    assert np.abs(means - way * exact).max() > 0.01 and np.abs(surface.normals - (way * exact)[triangles]).max() < 1e-8


def ball_and_shell(folder, **more):
    """A hollow ball in a shell, meshed apart from BREP files, both held; a press fit, no friction, the ball's inside turned by 3°."""
    for name, inner, outer in (("ball", 0.5, 1.0), ("shell", 1.0, 1.5)):
        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.occ.cut([(3, gmsh.model.occ.addSphere(0, 0, 0, outer))], [(3, gmsh.model.occ.addSphere(0, 0, 0, inner))])
        gmsh.model.occ.synchronize()
        gmsh.write(str(folder / f"{name}.brep"))
        gmsh.finalize()
    return config_from({
        "name": "socket", "subdomains": "groups", "materials": [{"young": 200e3, "poisson": 0.3}], "blackbox": IN_PROCESS,
        "parts": [{"name": name, "mesh": {"step": str(folder / f"{name}.brep")}, "h": h} for name, h in (("ball", 0.5), ("shell", 0.6))],
        "interfaces": [{"between": "auto", "law": "contact", **more}], "histories": {"turned": [0, 1]},
        "boundary": [{"on": "shell/solid:1", "displacement": [0, 0, 0]},
                     {"on": "ball/solid:2", "motion": {"rotate": {"axis": [1, 2, 3], "degrees": 3}}, "history": "turned"}],
        "method": {"tolerance": {"law": 1e-8}}})


def test_a_ball_turns_in_its_socket(tmp_path):
    """Facets of the ball and of the shell would interlock: pressures five times as large, and a torque of .03 of their sum × R."""
    made = ball_and_shell(tmp_path, gap=-1e-3)
    found = solve(made, build_scene(made))
    before, after = found.interfaces.pressure
    assert found.converged and (before > 0).all() and np.abs(after - before).max() < 1e-6 * before.max()
    assert not any("slid" in text for text in found.summary["warnings"])  # the surfaces conform


@pytest.mark.parametrize("way, told", [late(0.0, ""), late(0.006, "do not conform"), (0.03, "of an element")])
def test_a_cylinder_that_slid_on_a_block_is_told(tmp_path, way, told):
    """By a fraction of an element of 0.04: pressures move with the points that have been opposite each other, not with the cylinder."""
    write(tmp_path / "hertz.msh", cylinder_on_block(0.04, fine=0.16))
    held = [{"on": {"plane": "y", "at": y}, "displacement": [None, 0, None]} for y in (0.0, 0.08)]
    made = config_from({
        "name": "slid", "mesh": {"file": str(tmp_path / "hertz.msh")}, "subdomains": "groups", "blackbox": IN_PROCESS,
        "materials": [{"young": 200e3, "poisson": 0.3}], "interfaces": [{"law": "contact", "gap": "geometry", "within": 0.1}],
        "boundary": [*held, {"on": {"plane": "z", "at": -LENGTH}, "displacement": [0, None, 0]},
                     {"on": {"plane": "z", "at": LENGTH}, "displacement": [way, None, -0.005]}], "method": {"tolerance": {"law": 1e-4}}})
    texts = [text for text in solve(made, build_scene(made)).summary["warnings"] if "slid" in text]
    assert bool(texts) == bool(told) and all(told in text for text in texts[:1])


@pytest.mark.parametrize("degrees, flat", [(15.0, True), (5.0, True), (0.0, True), (15.0, False)])
def test_a_plane_that_meets_a_plane_of_symmetry_at_an_angle_is_no_round_face(degrees, flat):
    """Its mirror image makes an edge with it; a face that turns as it goes has its top there."""
    x, y = (each.ravel() for each in np.meshgrid(np.linspace(0.0, 1.0, 5), np.linspace(0.0, 1.0, 5)))
    slope = np.tan(np.radians(degrees))
    points = np.column_stack([x, y, slope * (x if flat else -2 * x**2)])
    triangles = Delaunay(points[:, :2]).simplices
    held = np.zeros_like(points, dtype=bool)
    held[x == 0, 0] = True
    surface = surface_of(points, triangles, -1, held=held)
    assert (surface.sagitta == 0).all() if flat else surface.sagitta[(x[triangles] == 0).any(axis=1)].max() > 0.005
    rim = surface.means[x[triangles] == 0]
    assert np.abs(rim[:, 0]) == pytest.approx(np.sin(np.radians(degrees)) if flat else 0.0, abs=1e-12)
