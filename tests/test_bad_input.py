"""Bad input, as a user meets it: the whole command, one clear message with its place and cure, exit code 2.

The messages' details are tested beside the rooms that raise them; here, that they come through.
"""

import tempfile
from pathlib import Path

import meshio
import numpy as np
import pytest
from method_case import saved
from yaml_case import call

from orchestrator.blackbox.codes.freefem.code import INSTALL
from orchestrator.scene.mesh.mesh import Mesh
from orchestrator.scene.mesh.sources import bricks

GOOD = {
    "name": "name: bar",
    "mesh": "mesh: {box: {size: [4, 1, 1], cells: [8, 2, 2]}}",
    "subdomains": "subdomains: {slices: {axis: x, count: 4}}",
    "materials": "materials: [{young: 200e3, poisson: 0.3}]",
    "held": "boundary: [{on: {plane: x, at: 0}, displacement: [0, 0, 0]},",
    "loaded": "  {on: {plane: x, at: 4}, traction: [1, 0, 0]}]",
    "interfaces": "interfaces: [{between: ['*', '*'], law: perfect}]",
    "method": "method: {tolerance: {error: 1e-3}}",
    "output": "output: {fields: false, figures: false}",
}
FREE = "boundary: [{on: {plane: x, at: 0}, displacement: [0, null, null]},"

# what is wrong: the lines that change, words of the message, the line it points to (None: none)
WRONG = {
    "unknown key": ({"method": "method: {tolerence: {error: 1e-3}}"}, ["did you mean 'tolerance'"], "method"),
    "wrong type": ({"materials": "materials: [{young: stiff, poisson: 0.3}]"}, ["a number", "stiff"], "materials"),
    "poisson 0.5": ({"materials": "materials: [{young: 1, poisson: 0.5}]"}, ["poisson", "< 0.5"], "materials"),
    "young 0": ({"materials": "materials: [{young: 0, poisson: 0.3}]"}, ["young", "> 0"], "materials"),
    "friction negative": ({"interfaces": "interfaces: [{law: contact, friction: -1}]"}, ["friction", ">= 0"], "interfaces"),
    "error below rounding": ({"method": "method: {tolerance: {error: 1e-11}}"}, ["1e-11", "rounding alone", "error: 1e-8"], "method"),
    "relaxation 0": ({"method": "method: {relaxation: 0}"}, ["relaxation", "> 0"], "method"),
    "missing mesh": ({"mesh": "mesh: {file: none.msh}"}, ["none.msh"], "mesh"),
    "unreadable mesh": ({"mesh": "mesh: {file: unreadable.msh}"}, ["unreadable.msh"], "mesh"),
    "mesh without tets": ({"mesh": "mesh: {file: flat.mesh}"}, ["flat.mesh", "tet"], "mesh"),
    "inverted tets": ({"mesh": "mesh: {file: inverted.mesh}"}, ["2 inverted of 192 tets"], "mesh"),
    "zero-volume tets": ({"mesh": "mesh: {file: sliver.mesh}"}, ["zero-volume"], "mesh"),
    "two sources": ({"mesh": "mesh: {beam: {size: [4, 1, 1], h: 1}, file: unreadable.msh}"}, ["beam and file together"], "mesh"),
    "unknown group": ({"loaded": "  {on: xmaks, traction: [1, 0, 0]}]"}, ["'xmaks'", "did you mean xmax"], "loaded"),
    "plane hits nothing": ({"loaded": "  {on: {plane: x, at: 5}, traction: [1, 0, 0]}]"}, ["x = 5"], "loaded"),
    "box hits nothing": ({"loaded": "  {on: {box: [[9, 9, 9], [10, 10, 10]]}, pressure: 1}]"}, ["box"], "loaded"),
    "rigid motion": ({"held": FREE}, ["can still move as a rigid body", "translation along y", "translation along z",
                                      "rotation about the x axis"], "held"),
    "no subdomain": ({"subdomains": "subdomains: {metis: 0}"}, [">= 1"], "subdomains"),
    "more subdomains than tets": ({"subdomains": "subdomains: {metis: 500}"}, ["500", "192"], "subdomains"),
    "empty slices": ({"subdomains": "subdomains: {slices: {axis: x, count: 50}}"}, ["without any tet"], "subdomains"),
    "disconnected subdomain": ({"mesh": "mesh: {file: apart.mesh}", "subdomains": "subdomains: groups"},
                               ["disconnected", "volume_1 is in 2 pieces"], "subdomains"),
    "interface of no pair": ({"interfaces": "interfaces: [{between: ['bolt*', '*'], law: perfect}]"},
                             ["'bolt*' matches no subdomain"], "interfaces"),
    "gap of no pair": ({"interfaces": "interfaces: [{between: ['slice 0', 'slice 3'], law: contact, gap: geometry}]"},
                       ["interfaces[0].gap", "share no face", "whose faces lie on each other"], "interfaces"),
    "within alone": ({"interfaces": "interfaces: [{law: contact, gap: 0.1, within: 1}]"}, ["within without gap: geometry"],
                     "interfaces"),
    "contradiction": ({"loaded": "  {on: xmin, displacement: [0, 0, 1]}]"}, ["contradict", "uz = 0 and 1"], "loaded"),
    "sole ratio": ({"method": "method: {sole: {modulus_ratio: 1000}}"}, ["1000", "0.001 to 100"], "method"),
}


def write_meshes(folder):
    mesh = bricks(np.array([4.0, 1.0, 1.0]), np.array([8, 2, 2]), "box")
    (folder / "unreadable.msh").write_text("this is no mesh\n")
    meshio.Mesh(mesh.nodes, [("triangle", np.array([[0, 1, 4]]))]).write(folder / "flat.mesh")
    inverted, sliver = mesh.cells.copy(), np.r_[mesh.cells, [[0, 1, 3, 4]]]
    inverted[[4, 7]] = inverted[[4, 7]][:, [1, 0, 2, 3]]
    for name, cells in (("inverted", inverted), ("sliver", sliver)):
        saved(Mesh(mesh.nodes, cells, np.zeros(len(cells), int), ["box"]), folder / f"{name}.mesh")
    middle = np.abs(mesh.nodes[mesh.cells].mean(axis=1)[:, 0] - 2) < 1
    saved(Mesh(mesh.nodes, mesh.cells, middle.astype(int), ["ends", "middle"]), folder / "apart.mesh")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with meshes; FreeFEM's temporary files go below it, and to be started would be noticed."""
    write_meshes(tmp_path)
    (tmp_path / "tmp").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))
    return tmp_path


def run(path: Path, *arguments: str):
    return call("run", path, "--quiet", "--output", path.parent / "out", *arguments)


def write(folder, changes):
    path = folder / "bar.yaml"
    path.write_text("\n".join({**GOOD, **changes}.values()) + "\n")
    return path


def test_the_good_one_is_accepted(folder):
    """What the bad ones are changes of."""
    done = run(write(folder, {}))
    assert done.exit_code == 0, done.stderr
    assert not list((folder / "tmp").iterdir())


@pytest.mark.parametrize("changes, words, line", WRONG.values(), ids=WRONG)
def test_one_clear_message(folder, changes, words, line):
    """Exit code 2; file and line, what was found and expected; nothing was started, nothing is left."""
    path = write(folder, changes)
    done = run(path)
    assert done.exit_code == 2, done.output
    assert done.stderr.split()[0] == "1", done.stderr
    for word in words:
        assert word in done.stderr, done.stderr
    assert f"{path}:{list(GOOD).index(line) + 1}: " in done.stderr, done.stderr
    assert "found:" in done.stderr and "expected:" in done.stderr and "Traceback" not in done.stderr
    assert not list((folder / "tmp").iterdir())
    assert not (folder / "out" / "summary.json").exists()


def test_the_checker_says_the_same(folder):
    """``check`` finds without solving what ``run`` refuses."""
    for name in ("rigid motion", "unknown group", "interface of no pair"):
        path = write(folder, WRONG[name][0])
        checked = call("check", path)
        assert (checked.exit_code, checked.stderr) == (2, run(path).stderr)


def test_freefem_is_missing(folder, monkeypatch):
    """Named executable that is not there: said before anything is started."""
    monkeypatch.setenv("ORCHESTRATOR_FREEFEM", str(folder / "nowhere"))
    done = run(write(folder, {}))
    assert done.exit_code == 2 and "nowhere" in done.stderr and INSTALL in done.stderr.replace("\n", " ")
    assert not list((folder / "tmp").iterdir())
