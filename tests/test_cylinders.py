"""Faces on a circular cylinder are straight along its axis, whatever their facets; others are as their facets have them."""

import numpy as np
import pytest
from scipy.spatial import Delaunay
from in_process import IN_PROCESS

from orchestrator import build_scene, config_from, solve
from orchestrator.scene.interfaces.cylinders import straightened
from orchestrator.scene.mesh.geometry import node_normals

TURN = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]


def meshed(at, wide=2.0, high=1.5, n=12):
    """A net over [0, wide] × [0, high], its inner nodes moved about, as ``at`` bends it, far away and turned: nodes, triangles, normals."""
    s, z = (v.ravel() for v in np.meshgrid(np.linspace(0, wide, n), np.linspace(0, high, n), indexing="ij"))
    inner = (s > 0) & (s < wide) & (z > 0) & (z < high)
    moves = np.random.default_rng(0).uniform(-0.3, 0.3, (2, inner.sum())) / n
    s[inner], z[inner] = s[inner] + wide * moves[0], z[inner] + high * moves[1]
    points = np.stack(at(s, z), axis=1) @ TURN + [300, -200, 100]
    triangles = Delaunay(np.c_[s, z]).simplices
    return points, triangles, node_normals(points, triangles)


@pytest.mark.parametrize("radius", [1.0, 4.0])
def test_normals_of_a_cylinder(radius):
    points, triangles, normals = meshed(lambda s, z: (radius * np.cos(s / radius), radius * np.sin(s / radius), z))
    found, axis = straightened(points, triangles, normals), TURN[2]
    assert np.abs(normals @ axis).max() > 1e-3 / radius and np.abs(found @ axis).max() < 1e-12
    arm = points - [300, -200, 100]
    arm -= np.outer(arm @ axis, axis)
    assert found == pytest.approx(arm / radius * np.sign(np.sum(arm * normals)), abs=1e-10)


@pytest.mark.parametrize("at", [
    lambda s, z: (s, z, 0 * s), lambda s, z: (np.cos(s), 1.3 * np.sin(s), z), lambda s,
    z: ((3 + 0.2 * z) * np.cos(s), (3 + 0.2 * z) * np.sin(s), z),
    lambda s, z: (np.cos(s) * np.cos(z - 0.7), np.sin(s) * np.cos(z - 0.7), np.sin(z - 0.7)), lambda s, z: (s, z, 0.05 * s**2)],
    ids=["a plane", "an ellipse", "a cone", "a ball", "a parabola"])
def test_other_faces_keep_theirs(at):
    points, triangles, normals = meshed(at)
    assert straightened(points, triangles, normals) is normals


@pytest.mark.long
def test_a_shaft_pulled_out_of_a_shrunk_ring(tmp_path):
    """Far beyond where friction gives way the force stays what friction carries: facets do not climb each other."""
    gmsh = pytest.importorskip("gmsh")
    for name, size in (("shaft", 4.5), ("ring", 3.5)):
        gmsh.initialize()
        gmsh.option.setNumber("General.Terminal", 0)
        add = gmsh.model.occ.addCylinder
        if name == "shaft":
            add(0, 0, -10, 0, 0, 30, 10)
        else:
            gmsh.model.occ.cut([(3, add(0, 0, 0, 0, 0, 10, 16))], [(3, add(0, 0, 0, 0, 0, 10, 10))])
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(3, [gmsh.model.getEntities(3)[0][1]], name=name)
        for end in ("Min", "Max"):
            gmsh.option.setNumber(f"Mesh.MeshSize{end}", size)
        gmsh.option.setNumber("Mesh.MshFileVersion", 2.2)
        gmsh.model.mesh.generate(3)
        gmsh.write(str(tmp_path / f"{name}.msh"))
        gmsh.finalize()
    made = config_from({
        "name": "pull", "parts": [{"name": name, "mesh": {"file": str(tmp_path / f"{name}.msh")}} for name in ("shaft", "ring")],
        "subdomains": "groups", "materials": [{"young": 200e3, "poisson": 0.3}], "blackbox": IN_PROCESS,
        "interfaces": [{"between": ["shaft", "ring"], "law": "contact", "friction": 0.2, "gap": -0.01}],
        "boundary": [{"on": {"plane": "z", "at": 20}, "displacement": [[0, 0, way] for way in (0, 0.02, 0.5, 1.9, 3.0)]},
                     {"on": {"box": [[-16.1, -16.1, -0.001], [16.1, 16.1, 0.001]]}, "displacement": [0, 0, 0]}],
        "method": {"tolerance": {"law": 1e-5}, "max_iterations": 200}})
    found = solve(made, build_scene(made))
    pull = np.array(found.summary["reactions"])[0, 1:, 2]
    carried = 0.2 * (found.interfaces.pressure * found.interfaces.areas).sum(axis=1)[1:]
    assert found.converged and pull == pytest.approx(carried, rel=2e-3) and pull[1:] == pytest.approx(pull[0], rel=2e-3)
