"""A hundred bad inputs: one clear message each, no traceback, nothing accepted in silence, none of them slow.

What stands in the messages is tested beside the rooms that raise them, and their lines in ``test_bad_input``.
"""

import signal
import subprocess
import sys

import meshio
import numpy as np
import pytest
from test_bad_input import GOOD
from yaml_case import call

from orchestrator.scene.mesh import checks
from orchestrator.scene.mesh.sources import bricks

PATIENCE = 120  # seconds after which one counts as hanging, on a slow machine too

FOREIGN = {"rotation": "motion:", "symmetry": "in an entry of boundary", "temperature": "expansion:", "gravity": "density:",
           "contact": "law between parts", "dynamics": "load steps", "nlgeom": "small",
           "plane_stress": "slab"}

# what is wrong: the lines of the good configuration that change ("*": all of it), a word of the message
BAD = {
    # text
    "empty file": ({"*": ""}, "nothing"),
    "only a list": ({"*": "- a\n- b"}, "a mapping"),
    "tab": ({"mesh": "mesh:\n\t- 3"}, "start any token"),
    "open bracket": ({"mesh": "mesh: {box: {size: [4, 1, 1], cells: [8, 2, 2]}"}, "expected ','"),
    "bad indentation": ({"mesh": "mesh:\n  box: {size: [4, 1, 1], cells: [8, 2, 2]}\n scale: 1"}, "<block end>"),
    "key twice": ({"again": "name: bar"}, "every key once"),
    "two documents": ({"again": "---\nname: bar"}, "another document"),
    "unknown alias": ({"materials": "materials: *steel"}, "'steel'"),
    "control character": ({"name": "name: b\0r"}, "#x0000"),
    "nested 3000 deep": ({"extra": "extra: " + "[" * 3000 + "]" * 3000}, "levels of nesting"),
    "nested by indentation": ({"extra": "\n".join(" " * i + "a:" for i in range(3000))}, "levels of nesting"),
    "aliases of aliases": ({"extra": "a: &a [x, x, x, x, x, x, x, x, x]\n" + "\n".join(
         f"{chr(98 + i)}: &{chr(98 + i)} [" + ", ".join([f"*{chr(97 + i)}"] * 9) + "]" for i in range(12))}, "100,000 entries"),
    "aliases in a chain": ({"extra": "k0: &k0 [1]\n" + "\n".join(f"k{i + 1}: &k{i + 1} [*k{i}]" for i in range(500))}, "levels of nesting"),
    "number of 5000 digits": ({"materials": "materials: [{young: " + "1" * 5000 + ", poisson: 0.3}]"}, "5000 digits"),
    "number of 400 digits": ({"materials": "materials: [{young: " + "1" * 400 + ", poisson: 0.3}]"}, "400 digits"),
    # shape
    "no materials": ({"materials": ""}, "no materials"),
    "mapping for a list": ({"materials": "materials: {young: 1, poisson: 0.3}"}, "a list"),
    "list for a mapping": ({"mesh": "mesh: [4, 1, 1]"}, "a mapping (key: value) with beam"),
    "text for a list": ({"mesh": "mesh: {box: {size: large, cells: [8, 2, 2]}}"}, '"large"'),
    "number for a name": ({"name": "name: 3"}, "text"),
    "name of a path": ({"name": "name: ../../etc/passwd"}, "../../etc"),
    "null materials": ({"materials": "materials: null"}, "null"),
    "empty materials": ({"materials": "materials: []"}, "at least 1 entry"),
    "true for a number": ({"materials": "materials: [{young: true, poisson: 0.3}]"}, "true"),
    "not a number": ({"materials": "materials: [{young: .nan, poisson: 0.3}]"}, "NaN"),
    "infinite": ({"materials": "materials: [{young: .inf, poisson: 0.3}]"}, "Infinity"),
    "beyond numbers": ({"materials": "materials: [{young: 1e308, poisson: 0.3}]"}, "1e+308"),
    "next to nothing": ({"materials": "materials: [{young: 1e-320, poisson: 0.3}]"}, "1e-320"),
    "decimal comma": ({"materials": "materials: [{young: 200e3, poisson: 0,3}]"}, "write poisson: 0.3"),
    "thousands parted by a comma": ({"materials": "materials: [{young: 210,000, poisson: 0.3}]"}, "write young: 210000, or"),
    "decimal comma in a text": ({"materials": "materials:\n  - young: 2,1e5\n    poisson: 0.3"}, "write 2.1e5"),
    "below rounding": ({"method": "method: {tolerance: {error: 1e-12}}"}, "rounding alone"),
    "unit": ({"materials": "materials: [{young: 200 GPa, poisson: 0.3}]"}, "200 GPa"),
    "poisson -1": ({"materials": "materials: [{young: 1, poisson: -1}]"}, "> -1"),
    "material of no volume": ({"materials": "materials: [{young: 1, poisson: 0.3, on: steel}]"}, "'steel'"),
    # other programs
    **{f"{key} elsewhere": ({"extra": f"{key}: 1"}, word) for key, word in FOREIGN.items()},
    "moduli by letters": ({"materials": "materials: [{E: 200e3, nu: 0.3}]"}, "write young"),
    "density": ({"materials": "materials: [{young: 200e3, poisson: 0.3, rho: 7.8e-9}]"}, "gravity"),
    "fixed": ({"held": "boundary: [{on: {plane: x, at: 0}, fixed: true},"}, "displacement: [0, 0, 0]"),
    "force": ({"loaded": "  {on: {plane: x, at: 4}, force: [1, 0, 0]}]"}, "force per area"),
    "nothing prescribed": ({"held": "boundary: [{on: {plane: x, at: 0}, displacement: null},"}, "displacement: null"),
    "no load named": ({"extra": "loads: [{on: box, gravity: null}]"}, "gravity: null"),
    "rotation of a face": ({"held": "boundary: [{on: {plane: x, at: 0}, rotation: [0, 0, 0]},"}, "motion: {rotate"),
    # mesh
    "no source": ({"mesh": "mesh: {}"}, "exactly one of them"),
    "a thousand millions of cells": ({"mesh": "mesh: {box: {size: [4, 1, 1], cells: [1000, 1000, 1000]}}"}, "1e+09 nodes"),
    "no cells": ({"mesh": "mesh: {box: {size: [4, 1, 1], cells: [8, 0, 2]}}"}, ">= 1"),
    "half a cell": ({"mesh": "mesh: {box: {size: [4, 1, 1], cells: [8, 1.5, 2]}}"}, "a whole number"),
    "four lengths": ({"mesh": "mesh: {box: {size: [1,5, 1, 1], cells: [8, 2, 2]}}"}, "at most 3 entries"),
    "negative length": ({"mesh": "mesh: {box: {size: [4, -1, 1], cells: [8, 2, 2]}}"}, "> 0"),
    "beam too fine": ({"mesh": "mesh: {beam: {size: [160, 10, 10], h: 1e-6}}"}, "take h: 0."),
    "beam without h": ({"mesh": "mesh: {beam: {size: [160, 10, 10]}}"}, "no h"),
    "grains too fine": ({"mesh": "mesh: {polycrystal: {grains: 10, size: 1, h: 1e-9}}"}, "nodes"),
    "grains too coarse": ({"mesh": "mesh: {polycrystal: {grains: 10, size: 1, h: 3}}"}, "smaller than the grains"),
    "flat grains": ({"mesh": "mesh: {polycrystal: {grains: 10, size: [1, 1, 1e-9], h: 1e-4}}"}, "smaller than the grains"),
    "a million grains": ({"mesh": "mesh: {polycrystal: {grains: 1000000, size: 1, h: 0.01}}"}, "10000"),
    "endless relaxation": ({"mesh": "mesh: {polycrystal: {grains: 10, size: 1, h: 0.1, lloyd: 1000000000}}"}, "100"),
    "scale 0": ({"mesh": "mesh: {box: {size: [4, 1, 1], cells: [8, 2, 2]}, scale: 0}"}, "> 0"),
    "scale beyond numbers": ({"mesh": "mesh: {box: {size: [4, 1, 1], cells: [8, 2, 2]}, scale: 1e300}"}, "1e+30"),
    "h beside a box": ({"mesh": "mesh: {box: {size: [4, 1, 1], cells: [8, 2, 2]}, h: 1}"}, "h without step"),
    "long path": ({"mesh": "mesh: {file: " + "a" * 5000 + ".msh}"}, "no file"),
    "path with a zero": ({"mesh": 'mesh: {file: "a\\0.msh"}'}, "no file"),
    "folder for a mesh": ({"mesh": "mesh: {file: .}"}, "no file"),
    "hexahedra": ({"mesh": "mesh: {file: bricks.vtu}"}, "too distorted to be split"),
    "twenty nodes": ({"mesh": "mesh: {file: twenty.msh}"}, "element: P2"),
    "empty group": ({"mesh": "mesh: {file: groups.msh}", "loaded": "  {on: empty, traction: [1, 0, 0]}]"}, "without triangles"),
    "volume for a surface": ({"mesh": "mesh: {file: groups.msh}", "loaded": "  {on: body, traction: [1, 0, 0]}]"}, "only a volume"),
    "text for a model": ({"mesh": "mesh: {step: unreadable.stp}"}, "ISO-10303-21"),
    "model that is not there": ({"mesh": "mesh: {step: none.stp}"}, "none.stp"),
    "example that is not there": ({"mesh": "mesh: {step: 'gmsh:none.stp'}"}, "gmsh:as1-tu-203.stp"),
    "model too fine": ({"mesh": "mesh: {step: 'gmsh:as1-tu-203.stp', h: 0.005}"}, "nodes"),
    "model too coarse": ({"mesh": "mesh: {step: 'gmsh:as1-tu-203.stp', h: 5000}"}, "the model measures 200"),
    # partition
    "two ways to cut": ({"subdomains": "subdomains: {metis: 4, grid: [2, 1, 1]}"}, "metis and grid together"),
    "axis": ({"subdomains": "subdomains: {slices: {axis: w, count: 4}}"}, "one of x, y, z"),
    "slices beyond counting": ({"subdomains": "subdomains: {slices: {axis: x, count: 1000000000000}}"}, "192 tets"),
    "grid beyond counting": ({"subdomains": "subdomains: {grid: [100000, 100000, 100000]}"}, "192 tets"),
    "fraction of a count": ({"subdomains": "subdomains: {slices: {axis: x, count: 4,5}}"}, "unknown key '5'"),
    # boundary
    "nothing held": ({"held": "boundary: ["}, "nothing holds it"),
    "two kinds": ({"loaded": "  {on: xmax, traction: [1, 0, 0], pressure: 1}]"}, "traction and pressure together"),
    "no kind": ({"loaded": "  {on: xmax}]"}, "none of displacement"),
    "two components": ({"loaded": "  {on: xmax, traction: [1, 0]}]"}, "three numbers"),
    "null traction": ({"loaded": "  {on: xmax, traction: [1, null, 0]}]"}, "null"),
    "free displacement": ({"loaded": "  {on: xmax, displacement: [null, null, null]}]"}, "no prescribed component"),
    "plane without place": ({"loaded": "  {on: {plane: x}, traction: [1, 0, 0]}]"}, "at together"),
    "corners swapped": ({"loaded": "  {on: {box: [[4, 1, 1], [3, 0, 0]]}, traction: [1, 0, 0]}]"}, "lower corner first"),
    "unknown history": ({"loaded": "  {on: xmax, traction: [1, 0, 0], history: ramp}]"}, "'ramp'"),
    "empty history": ({"loaded": "  {on: xmax, traction: [1, 0, 0], history: ramp}]", "extra": "histories: {ramp: []}"},
                      "at least 1 entry"),
    "histories of two lengths": ({
        "held": "boundary: [{on: {plane: x, at: 0}, displacement: [0, 0, 0]}, {on: ymin, traction: [0, 1, 0], history: two},",
        "loaded": "  {on: xmax, traction: [1, 0, 0], history: ramp}]", "extra": "histories: {ramp: [1, 2, 3], two: [1, 2]}"},
        "3 load steps"),
    "load of no volume": ({"extra": "loads: [{on: bolt, body_force: [0, 0, 1]}]"}, "'bolt'"),
    # interfaces
    "unknown law": ({"interfaces": "interfaces: [{law: glued}]"}, "glued"),
    "three parts": ({"interfaces": "interfaces: [{between: [a, b, c], law: perfect}]"}, "names of two parts"),
    "friction without contact": ({"interfaces": "interfaces: [{law: perfect, friction: 0.3}]"}, "law: contact only"),
    "friction infinite": ({"interfaces": "interfaces: [{law: contact, friction: .inf}]"}, "Infinity"),
    # method
    "two criteria": ({"method": "method: {tolerance: {error: 1e-3, indicator: 1e-3}}"}, "error and indicator together"),
    "tolerance 0": ({"method": "method: {tolerance: {error: 0}}"}, "> 0"),
    "tolerance 1": ({"method": "method: {tolerance: {error: 1}}"}, "< 1"),
    "unknown acceleration": ({"method": "method: {acceleration: andersen}"}, "did you mean 'anderson'"),
    "gmres with contact": ({"method": "method: {acceleration: gmres}", "interfaces": "interfaces: [{law: contact, friction: 0}]"},
                           "use anderson"),
    "no iterations": ({"method": "method: {max_iterations: 0}"}, ">= 1"),
    "relaxation 2": ({"method": "method: {relaxation: 2}"}, "<= 1"),
    # black box
    "unknown code": ({"extra": "blackbox: {code: abacus}"}, "abacus"),
    "unknown element": ({"extra": "blackbox: {element: P3}"}, "P1, P2"),
    "no worker": ({"extra": "blackbox: {workers: 0}"}, ">= 1"),
    "a thousand workers": ({"extra": "blackbox: {workers: 1000}"}, "1,000 workers"),
    "endless patience": ({"extra": "blackbox: {timeout: 1e20}"}, "1e+06"),
    "code of no subdomain": ({"extra": "blackbox: [{code: freefem}, {code: freefem, on: bolt}]"}, "'bolt'"),
    "solver that is not there": ({"extra": "blackbox: {code: none.py}"}, "none.py"),
    # output
    "folder of 5000 letters": ({"output": "output: {directory: " + "a" * 5000 + ", figures: false}"}, "folder"),
    "fields maybe": ({"output": "output: {fields: maybe, figures: false}"}, "true or false"),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Meshes that are none, or lack something."""
    folder = tmp_path_factory.mktemp("bad")
    mesh = bricks(np.array([4.0, 1.0, 1.0]), np.array([8, 2, 2]), "box")
    left = mesh.surfaces["xmin"]
    meshio.Mesh(mesh.nodes, [("hexahedron", np.arange(8)[None])]).write(folder / "bricks.vtu")
    meshio.Mesh(np.random.default_rng(0).random((20, 3)), [("tetra20", np.arange(20)[None])]).write(
        folder / "twenty.msh", file_format="gmsh22")
    tags = [np.full(len(mesh.cells), 1), np.full(len(left), 2)]
    meshio.Mesh(mesh.nodes, [("tetra", mesh.cells), ("triangle", left)],
                cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
                field_data={"body": np.array([1, 3]), "left": np.array([2, 2]), "empty": np.array([3, 2])},
                ).write(folder / "groups.msh", file_format="gmsh22", binary=False)
    (folder / "unreadable.stp").write_text("this is no model\n")
    return folder


@pytest.fixture
def in_time():
    """Whatever takes longer than its patience is broken off, and fails."""
    def too_slow(number, frame):
        raise TimeoutError(f"more than {PATIENCE} s")

    before = signal.signal(signal.SIGALRM, too_slow)
    signal.alarm(PATIENCE)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def refused(path, *more):
    """What a command says that ends with exit code 2, in order."""
    done = call("run", path, "--quiet", *more)
    assert done.exit_code == 2 and isinstance(done.exception, SystemExit), (done.exception, done.output)
    assert "found:" in done.stderr and "expected:" in done.stderr and "Traceback" not in done.stderr
    return done.stderr


@pytest.mark.parametrize("changes, word", BAD.values(), ids=BAD)
def test_refused_with_a_message(folder, in_time, monkeypatch, changes, word):
    monkeypatch.chdir(folder)  # results go below, where no other process writes
    path = folder / "bar.yaml"
    path.write_text(changes.get("*", "\n".join({**GOOD, **changes}.values()) + "\n"))
    told = refused(path)
    assert word in told and "bar.yaml" in told, told


def test_there_are_a_hundred():
    assert len(BAD) >= 100


@pytest.mark.parametrize("path", ["a" * 5000 + ".yaml", "."], ids=["long", "folder"])
def test_paths_of_no_configuration(in_time, path):
    refused(path)


@pytest.mark.parametrize("mesh, word", [("mesh: {box: {size: [4, 1, 1], cells: [80, 20, 20]}}", "GB of memory"),
                                        ("mesh: {beam: {size: [4, 1, 1], h: 0.02}}", "take h: ")])
def test_meshes_must_fit_in_what_is_free(folder, in_time, monkeypatch, mesh, word):
    """Asked before they are made: with 10 MB left, forty thousand nodes are too many."""
    monkeypatch.setattr(checks, "memory_left", lambda: 1e7)
    (folder / "bar.yaml").write_text("\n".join({**GOOD, "mesh": mesh}.values()))
    assert word in refused(folder / "bar.yaml", "--output", str(folder / "out"))


def test_ten_nodes_must_fit_too(folder, in_time, monkeypatch):
    """A mesh of 81 corners that fits with four nodes a tet does not with ten."""
    monkeypatch.setattr(checks, "memory_left", lambda: 4e5)
    (folder / "ten.yaml").write_text("\n".join({**GOOD, "extra": "blackbox: {element: P2}"}.values()))
    assert "element: P2" in refused(folder / "ten.yaml", "--output", str(folder / "out"))
    (folder / "four.yaml").write_text("\n".join(GOOD.values()))
    assert call("check", folder / "four.yaml").exit_code == 0


def test_more_batches_than_iterations(folder, in_time):
    """``check`` says it, not only ``run``."""
    changes = {"loaded": "  {on: {plane: x, at: 4}, traction: [1, 0, 0], history: up}]",
               "interfaces": "interfaces: [{law: contact, friction: 0.1}]",
               "held": "boundary: [{on: {box: [[-1, -1, -1], [5, 5, 0]]}, displacement: [0, 0, 0]},",
               "method": "method: {max_iterations: 2, increment: 1}", "extra": "histories: {up: [1, 0.5, 1, 0.5]}"}
    (folder / "few.yaml").write_text("\n".join({**GOOD, **changes}.values()))
    done = call("check", folder / "few.yaml")
    assert done.exit_code == 2 and "2 iterations for 4 batches" in done.stderr, done.output


def test_memory_left_heeds_the_process_own_limit():
    """As ``ulimit -v`` sets it: no more is left than is allowed."""
    program = ("import resource; from orchestrator.scene.mesh.checks import memory_left; free = memory_left()\n"
               "resource.setrlimit(resource.RLIMIT_AS, (1 << 32, 1 << 32)); assert 0 < memory_left() < min(1 << 32, free)")
    subprocess.run([sys.executable, "-c", program], check=True, timeout=60)


def test_many_load_steps_must_fit_too(folder, in_time, monkeypatch):
    monkeypatch.setattr(checks, "memory_left", lambda: 1e6)
    steps = {"loaded": "  {on: xmax, traction: [1, 0, 0], history: ramp}]", "extra": f"histories: {{ramp: {[1] * 200}}}"}
    (folder / "bar.yaml").write_text("\n".join({**GOOD, **steps}.values()))
    assert "200 load steps on 81 nodes" in refused(folder / "bar.yaml", "--output", str(folder / "out"))
