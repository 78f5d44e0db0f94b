"""Files of strangers: whatever they hold, reading them runs nothing, and messages do not tell what is in others.

Each would leave a mark if it were executed. The lines of the table in ``docs/security.md`` name these tests.
"""

import base64
import json
import os
import pickle
import re
import struct
import subprocess
import sys
from pathlib import Path

import gmsh
import in_process  # noqa: F401 - the code that runs in this process
import meshio
import numpy as np
import pytest
from quick import late, quick
from yaml_case import call

import orchestrator
from orchestrator import build_scene
from orchestrator.errors import InputError
from orchestrator.results.fields.fields import read_npz
from orchestrator.results.folder import ResultsFolder
from orchestrator.results.report.document import page
from orchestrator.scene.mesh.readers import child
from orchestrator.scene.mesh.readers.read import read
from orchestrator.scene.mesh.gmsh_session import session

MARK, SECRET = "mark-of-the-stranger", "correct-horse-battery"
SCRIPT = f'SystemCall "touch {MARK}";\n'
PROGRAM = f"#!/bin/sh\ntouch {{folder}}/{MARK}\n"
VTU = '<VTKFile type="{}UnstructuredGrid" version="1.0"><{}UnstructuredGrid>{}</{}UnstructuredGrid></VTKFile>'
SCENE = """name: stranger
{mesh}
subdomains: {cut}
materials: [{{young: 200e3, poisson: 0.3}}]
boundary:
  - {{on: {{plane: x, at: 0}}, displacement: [0, 0, 0]}}
  - {{on: {{plane: x, at: 1}}, traction: [1, 0, 0]}}
blackbox: {blackbox}
output: {{figures: false, fields: false}}
"""
BOX = "mesh: {box: {size: [1, 1, 1], cells: [2, 2, 2]}}"
# a part of another kind, by three of its nodes on the top of a box
ON_A_BOX = ("interfaces: [{{between: auto, law: perfect}}]\nparts:\n"
            "  - {{name: a, mesh: {{box: {{size: [1, 1, 1], cells: [2, 2, 2]}}}}}}\n  - {{name: b, {}}}")
# name → content: none is what its name says, and gmsh would run them all
FORGED = {
    "script.msh": SCRIPT, "breaks.msh": "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n" + SCRIPT, "blank.msh": "\n$MeshFormat\n" + SCRIPT,
    "plain.geo": SCRIPT, "plain.pos": SCRIPT, "plain.opt": SCRIPT, "none": SCRIPT, "part.msh.gz": SCRIPT,
    "part.unv": SCRIPT, "part.bdf": SCRIPT, "part.nas": SCRIPT, "part.med": SCRIPT, "part.mesh": SCRIPT, "part.inp": SCRIPT,
    "part.step": SCRIPT, "part.stp": SCRIPT, "part.brep": SCRIPT, "part.igs": SCRIPT, "part.stl": SCRIPT,
    "part.vtk": SCRIPT, "part.vtu": SCRIPT, f"; touch {MARK};.msh": SCRIPT,
    "entity.xdmf": '<!DOCTYPE Xdmf [<!ENTITY x SYSTEM "file:///etc/passwd">]><Xdmf>&x;</Xdmf>',
    "entity.xml": "<!DOCTYPE dolfin [<!ENTITY x 'y'>]><dolfin/>",
    "entity.vtu": '<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]>' + VTU.format("", "", "&x;", ""),
    "pickled.npz": pickle.dumps(eval), "pickled.h5": pickle.dumps(eval), "code.py": f"open('{MARK}', 'w')",
}
OPTIONS = ("msh", "unv", "bdf", "med", "step", "brep")


def written(folder, mesh=BOX, blackbox="{code: in-process, workers: 1}"):
    path = folder / "scene.yaml"
    path.write_text(SCENE.format(mesh=mesh, blackbox=blackbox, cut="groups" if "parts:" in mesh else "{slices: {axis: x, count: 2}}"))
    return path


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The current folder; nobody leaves the mark in it, or below it."""
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    assert not list(tmp_path.rglob(MARK))


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """A box as gmsh writes it, in every format that it has options for; of .msh one that meshio leaves to gmsh."""
    folder = tmp_path_factory.mktemp("sound")
    with session():
        gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        gmsh.model.occ.synchronize()
        for ending in ("step", "brep"):
            gmsh.write(str(folder / f"box.{ending}"))
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.6)
        gmsh.model.mesh.generate(3)
        for ending in ("unv", "bdf", "med"):
            gmsh.write(str(folder / f"box.{ending}"))
        gmsh.model.addPhysicalGroup(2, [1], name="clamp")
        gmsh.option.setNumber("Mesh.SaveAll", 1)
        gmsh.write(str(folder / "box.msh"))
    return folder


def test_the_script_is_one(tmp_path):
    """What the others rely on: gmsh runs it, under a mesh's name too."""
    (tmp_path / "script.msh").write_text(SCRIPT)
    with session():
        gmsh.open("script.msh")
    (tmp_path / MARK).unlink()


@pytest.mark.parametrize("command", quick(["check", "inspect", "init", "run"], "init", "run"))
def test_nothing_that_is_no_mesh_is_run(tmp_path, command):
    for name, content in FORGED.items():
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        if command in ("check", "run"):
            key = "step" if path.suffix in (".step", ".stp", ".brep", ".igs") else "file"
            done = call(command, written(tmp_path, f"mesh: {{{key}: {json.dumps(str(path))}}}"))
        else:
            done = call(command, *(["new.yaml"] if command == "init" else []), path)
        assert done.exit_code == 2 and "Traceback" not in done.output, (name, done.output)
        assert not (tmp_path / MARK).exists(), name


@pytest.mark.parametrize("ending", ["step", "brep"])
def test_models_that_are_cut_short_are_refused(tmp_path, sound, ending):
    """gmsh reads such a BREP file for ever, or ends the program."""
    whole = (sound / f"box.{ending}").read_bytes().rstrip()
    for share in (0.3, 0.6, 0.95, 1.0):
        (tmp_path / f"cut.{ending}").write_bytes(whole[: int(share * len(whole)) - 1])
        done = call("check", written(tmp_path, f"mesh: {{step: cut.{ending}}}"))
        assert done.exit_code == 2 and f"cut.{ending}: " in done.output and "Traceback" not in done.output, (share, done.output)


@pytest.mark.parametrize("head", ["$Comments\nx\n$EndComments\n", "$NOD\n"])
def test_what_begins_as_a_mesh_is_read_as_one(tmp_path, head):
    (tmp_path / "part.msh").write_text(head + SCRIPT)
    with pytest.raises(InputError, match="cannot be read by gmsh"):
        read(tmp_path / "part.msh")


@pytest.mark.parametrize("name", ["plain.geo", "plain.opt", "script.msh"])
def test_no_script_comes_by_the_door_of_cad(tmp_path, name):
    (tmp_path / name).write_text(SCRIPT)
    assert call("check", written(tmp_path, f"mesh: {{step: {name}}}")).exit_code == 2


@pytest.mark.parametrize("ending", quick(OPTIONS, "msh", "step"))
def test_options_beside_a_file_are_not_gmshs(tmp_path, sound, ending):
    name = f"box.{ending}"
    (tmp_path / name).write_bytes((sound / name).read_bytes())
    for beside in (f"{name}.opt", "box.opt", ".gmshrc", ".gmsh-options", "gmshrc", "gmsh-options"):
        (tmp_path / beside).write_text(SCRIPT)
    key = "step" if ending in ("step", "brep") else "file"
    done = call("check", written(tmp_path, f"mesh: {{{key}: {name}}}"))
    assert done.exit_code == 0, done.output
    if ending == "msh":
        for command in (["inspect"], ["init", "new.yaml"]):
            assert call(*command, name).exit_code == 0
        assert call("run", tmp_path / "scene.yaml").exit_code == 0


@pytest.mark.skipif(sys.platform != "linux" or os.uname().machine not in child.MACHINES, reason="no such filter here")
def test_gmshs_process_starts_no_other(tmp_path):
    """Whatever it may take for a script one day."""
    (tmp_path / "plain.geo").write_text(SCRIPT + 'SystemCall "/usr/bin/touch ' + MARK + '";\nPoint(1) = {0, 0, 0};\n')
    (tmp_path / "plain.geo.opt").write_text(SCRIPT)
    done = subprocess.run([sys.executable, "-P", child.__file__, str(1 << 31), "plain.geo", "out.msh"], capture_output=True, text=True)
    assert "aborting system call" in done.stdout, done  # it came as far as that


# ---- programs, interpreters, solvers, forms

def program(folder, name="stranger.sh"):
    path = folder / name
    path.write_text(PROGRAM.format(folder=folder))
    path.chmod(0o755)
    return path


def with_program(folder):
    program(folder)
    return written(folder, "parts:\n  - {name: base, mesh: {box: {size: [1, 1, 1], cells: [2, 2, 2]}}}\n"
                   "  - {name: top, program: {run: ./stranger.sh, outward: [0, 0, 1]}}")


def test_a_program_is_started_where_its_user_says_so_alone(tmp_path):
    path = with_program(tmp_path)
    for command in ("check", "inspect"):
        done = call(command, path)
        assert done.exit_code == 0 and "not checked: 'top'" in done.output and "--run-programs" in done.output, done.output
    with pytest.raises(InputError, match="nobody has asked"):
        build_scene(orchestrator.load_config(path).config)
    assert not (tmp_path / MARK).exists()
    for command in (["check", path, "--run-programs"], ["run", path]):
        assert call(*command).exit_code == 2
        (tmp_path / MARK).unlink()  # it was started


def test_what_is_wrong_beside_a_program_is_told_without_it(tmp_path):
    path = with_program(tmp_path)
    path.write_text(path.read_text().replace("{box: {size: [1, 1, 1], cells: [2, 2, 2]}}", "{file: scene.yaml}"))
    done = call("check", path)
    assert done.exit_code == 2 and "scene.yaml:3: parts[0]" in done.output, done.output


def test_an_interpreter_is_asked_where_its_user_says_so_alone(tmp_path):
    (tmp_path / "solver.py").write_text(f"open({str(tmp_path / MARK)!r}, 'w')\nclass Solver: pass\n")
    path = written(tmp_path, blackbox=f"{{code: solver.py, python: {program(tmp_path)}}}")
    for command in ("check", "inspect"):
        assert call(command, path).exit_code == 0
    assert "not checked: whether" in call("check", path).output
    assert not (tmp_path / MARK).exists()
    assert call("check", path, "--run-programs").exit_code == 2
    (tmp_path / MARK).unlink()


def test_solvers_and_forms_are_not_run_by_check(tmp_path):
    (tmp_path / "solver.py").write_text(f"open({str(tmp_path / MARK)!r}, 'w')\n")
    (tmp_path / "form.idp").write_text(f'exec("touch {tmp_path / MARK}");\nmacro Stiffness(u, v) int3d(Th, mine)(dx(u#x)*dx(v#x)) // EOM\n')
    for blackbox in ("{code: solver.py}", "{code: 'solver:Solver'}", "{form: form.idp}"):
        for command in ("check", "inspect"):
            done = call(command, written(tmp_path, blackbox=blackbox))
            assert done.exit_code == 0 and ("not checked: whether FreeFEM" in done.output) == (
                "form" in blackbox and command == "check"), blackbox
    assert not (tmp_path / MARK).exists()
    call("check", written(tmp_path, blackbox="{form: form.idp}"), "--run-programs")
    (tmp_path / MARK).unlink()  # it does what it says


@pytest.mark.parametrize("text", [f"!!python/object/apply:os.system ['touch {MARK}']", f"!!python/object/new:os.system [touch {MARK}]",
                                  f"!<tag:yaml.org,2002:python/name:os.system> 'touch {MARK}'"])
@pytest.mark.parametrize("command", ["check", "inspect", "run"])
def test_yaml_makes_data_alone(tmp_path, text, command):
    assert call(command, written(tmp_path, f"mesh: {text}")).exit_code == 2


@pytest.mark.long
def test_modules_of_the_current_folder_are_not_ours(tmp_path):
    """Of ``python -m`` and ``-c`` they would come before numpy."""
    path = written(tmp_path, blackbox="{code: scikit-fem, workers: 1}")
    path.write_text(path.read_text().replace("figures: false", "figures: true"))
    for name in ("numpy", "pickle", "gc", "skfem", "sitecustomize", "usercustomize", "scipy", "gmsh", "matplotlib", "vtkmodules"):
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / MARK)!r}, 'w')\nraise ImportError\n")
    (tmp_path / "matplotlibrc").write_text("backend: module://gmsh\ntext.usetex: True\ntext.latex.preamble: \\input{/etc/passwd}\n")
    (tmp_path / "freefem++.pref").write_text('loadpath = "./stranger"\n')
    starts = os.path.join(os.path.dirname(sys.executable), "orchestrator")
    done = subprocess.run([starts, "run", path.name], capture_output=True, text=True)
    assert done.returncode == 0 and len(list(tmp_path.glob("results/stranger/figures/*.png"))) == 3, done.stderr


# ---- results folders

def test_checkpoints_and_fields_hold_no_objects(tmp_path):
    class Evil:
        def __reduce__(self):
            return os.system, (f"touch {tmp_path / MARK}",)

    path, results = written(tmp_path), tmp_path / "results" / "stranger"
    (results / "checkpoint").mkdir(parents=True)
    for name in ("fields.npz", "checkpoint/iteration-000001.npz"):
        np.savez(results / name, about=np.array([Evil()], dtype=object), nodes=np.array([Evil()], dtype=object))
    (results / "checkpoint" / "iteration-000002.npz").write_bytes(pickle.dumps(Evil()))
    (results / "summary.json").write_bytes(pickle.dumps(Evil()))
    assert call("report", results).exit_code == 2
    for more in (["--resume"], []):  # they are in the way
        done = call("run", path, *more)
        assert done.exit_code == 2 and "Traceback" not in done.output, done.output


def test_nothing_is_written_or_removed_through_links(tmp_path):
    treasure = tmp_path / "home"
    treasure.mkdir()
    (treasure / "letter").write_text(SECRET)
    results = tmp_path / "results" / "stranger"
    results.mkdir(parents=True)
    for name in (".probe.orchestrator-part", ".summary.json.orchestrator-part", ".history.csv.orchestrator-part"):
        (results / name).symlink_to(treasure / "letter")
    assert call("run", written(tmp_path)).exit_code == 0
    for name in ("summary.json", ".orchestrator/manifest", ".orchestrator/lock", ".orchestrator", "checkpoint"):
        (results / name).rename(results / "aside") if (results / name).exists() else None
        (results / name).symlink_to(treasure if name in (".orchestrator", "checkpoint") else treasure / "letter")
        call("run", tmp_path / "scene.yaml")
        assert (treasure / "letter").read_text() == SECRET, name
        (results / name).unlink(missing_ok=True)
        (results / "aside").rename(results / name) if (results / "aside").exists() else None
    linked = tmp_path / "linked"
    linked.symlink_to(results)
    ResultsFolder(linked)  # the folder itself may be one


# ---- what messages and pages tell

@pytest.fixture
def secret(tmp_path):
    """A file that is none of the configuration's: neither numbers nor cards."""
    path = tmp_path / "secret.txt"
    path.write_text(f"1, .3, 3, 4\n1, {SECRET}, 3, 4\n{SECRET}:x:0:0\n")
    return path


def deck(secret):
    nodes = "*NODE, NSET=J\n1,0,0,1\n2,1,0,1\n3,0,1,1\n*NODE\n4,0,0,2\n*ELEMENT, TYPE=C3D4, ELSET=E\n1,1,2,3,4\n"
    matter = "*MATERIAL, NAME=M\n*ELASTIC\n200e3, .3\n*SOLID SECTION, ELSET=E, MATERIAL=M\n*MATERIAL, NAME=N\n*ELASTIC\n"
    return nodes + matter + f"*INCLUDE, INPUT={secret}\n"


@pytest.mark.parametrize("door", ["mesh", "deck", "included", "nodes", "facets", "stiffness", "loads", "temperature", *FORGED])
def test_messages_do_not_quote_files(tmp_path, secret, door):
    """Behind a link or an *INCLUDE may be any file of the machine."""
    keys = {"nodes": "secret.txt", "facets": "secret.txt", "stiffness": "secret.txt", "loads": "secret.txt"}
    mesh, more = BOX, ""
    if door in FORGED:
        (tmp_path / door).symlink_to(secret)
        mesh = f"mesh: {{{'step' if door[-4:] in ('.stp', 'step', 'brep') else 'file'}: {json.dumps(door)}}}"
    elif door == "mesh":
        (tmp_path / "part.inp").write_text(f"*NODE\n1, 0, 0, {secret.read_text()}")
        mesh = "mesh: {file: part.inp}"
    elif door in ("deck", "included"):
        (tmp_path / "part.inp").write_text(deck(secret) if door == "deck" else f"*NODE\n1,0,0,0\n*NSET, NSET=J\n{SECRET}\n")
        mesh = ON_A_BOX.format("deck: {calculix: part.inp, joints: J}")
    elif door == "temperature":
        more = "loads: [{temperature: {file: secret.txt}}]\n"
    else:
        (tmp_path / "good.csv").write_text("1,0,0,1\n2,1,0,1\n3,0,1,1\n")
        (tmp_path / "faces.csv").write_text("1,3,2\n")
        (tmp_path / "good.mtx").write_text("%%MatrixMarket matrix coordinate real symmetric\n9 9 1\n1 1 1.0\n")
        given = {"nodes": "good.csv", "stiffness": "good.mtx", "facets": "faces.csv"} | {door: keys[door]}
        mesh = ON_A_BOX.format("matrix: " + json.dumps(given))
    path = written(tmp_path, mesh)
    path.write_text((path.read_text() + more).replace("poisson: 0.3}", "poisson: 0.3, expansion: 1.0e-5}"))
    done = call("check", path)
    assert door in FORGED or "part.inp" in done.output or "secret.txt" in done.output or "CalculiX says" in done.output
    assert done.exit_code == 2 and SECRET not in done.output.lower() and SECRET[:9] not in done.output.lower(), done.output


def test_decks_that_include_themselves_or_devices_end(tmp_path):
    for name, text in {"loop": "*INCLUDE, INPUT=loop.inp\n", "device": "*INCLUDE, INPUT=/dev/zero\n",
                       "twice": "*INC LUDE, INPUT=twice.inp\n" * 2}.items():
        (tmp_path / f"{name}.inp").write_text(text)
        with pytest.raises(InputError, match="without end|no such file"):
            read(tmp_path / f"{name}.inp")
    (tmp_path / "15.inp").write_text("** nothing\n")
    for level in range(15):  # each includes the next twice
        (tmp_path / f"{level}.inp").write_text(f"*INCLUDE, INPUT={level + 1}.inp\n" * 2)
    with pytest.raises(InputError, match="without end"):
        read(tmp_path / "0.inp")


@pytest.mark.parametrize("card", ["VIEWFACTOR, WRITEONLY, OUTPUT=letter", "SUB STRUCTURE GENERATE", "SUBMODEL, INPUT=letter"])
def test_cards_of_a_deck_name_no_files(tmp_path, card):
    (tmp_path / "part.inp").write_text(deck("rest.inp") + f"*{card}\n")
    (tmp_path / "rest.inp").write_text("** nothing\n")
    done = call("check", written(tmp_path, ON_A_BOX.format("deck: {calculix: part.inp, joints: J}")))
    assert done.exit_code == 2 and "files of its own" in done.output, done.output


@pytest.mark.parametrize("named", ["/dev/zero", "../x.h5:/points", "/etc/passwd"])
def test_numbers_of_xdmf_are_beside_it(tmp_path, named):
    (tmp_path / "x.xdmf").write_text(f'<Xdmf><Domain><Grid><Geometry GeometryType="XYZ"><DataItem Dimensions="4 3" Format="Binary">{named}'
                                     "</DataItem></Geometry></Grid></Domain></Xdmf>")
    with pytest.raises(InputError, match="not beside it"):
        read(tmp_path / "x.xdmf")


@pytest.mark.parametrize("name, content", [
    ("points.vtu", VTU.format("", "", '<Piece NumberOfPoints="1000000000000" NumberOfCells="1"/>', "")),
    late("cells.vtu", VTU.format("", "", "<Piece NumberOfPoints='4' NumberOfCells='900000000000'/>", "")),
    late("points.vtk", "# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 1000000000000 double\n0 0 0\n")])
def test_sizes_that_files_declare_are_not_taken_where_there_is_no_room(tmp_path, name, content):
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match="(?s)cannot be read.*GB of memory"):
        read(tmp_path / name)


@pytest.mark.parametrize("mode, coded", [("Appended", False), ("Appended", True), ("Binary", True)])
@pytest.mark.long
def test_arrays_of_vtk_are_no_larger_than_their_file_or_the_memory(tmp_path, mode, coded):
    """Blocks of compressed arrays: VTK ends the process that reads. Lengths of others it does not ask."""
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader, vtkXMLUnstructuredGridWriter

    name, points = tmp_path / "tet.vtu", np.vstack([np.zeros(3), np.eye(3)])
    meshio.Mesh(points, {"tetra": [[0, 1, 2, 3]]}).write(name)
    source, writer = vtkXMLUnstructuredGridReader(), vtkXMLUnstructuredGridWriter()
    source.SetFileName(str(name))
    source.Update()
    writer.SetInputData(source.GetOutput())
    writer.SetFileName(str(name))
    getattr(writer, f"SetDataModeTo{mode}")()
    writer.SetEncodeAppendedData(coded)
    writer.SetHeaderTypeToUInt64()
    for compressed in (True, False):
        if not compressed:
            writer.SetCompressorTypeToNone()
        writer.Write()
        assert len(read(name).cells) == 1
        sound, start = name.read_bytes(), rb"<AppendedData[^>]*>\s*_" if mode == "Appended" else rb"<DataArray[^>]*>\s*"
        at = re.search(start, sound).end()
        for words in [(2**60, 1 << 15, 0), (1, 2**60, 0), (1, 1 << 15, 2**60), (2**33, 2**33, 0)] if compressed else []:
            head = struct.pack(f"<{len(words)}Q", *words)
            head = base64.b64encode(head) if coded else head
            name.write_bytes(sound[:at] + head + sound[at + len(head):])
            with pytest.raises(InputError, match="(?s)cannot be read.*GB of memory"):
                read(name)


def test_fields_that_unpack_to_more_than_the_memory_are_refused(tmp_path, monkeypatch):
    np.savez_compressed(tmp_path / "fields.npz", nodes=np.zeros(10**6))
    monkeypatch.setattr("orchestrator.scene.mesh.checks.memory_left", lambda: 1e6)
    with pytest.raises(InputError, match="takes about 0.008 GB of memory"):
        read_npz(tmp_path)


@pytest.mark.parametrize("head", ["array real general\n100000000 100000000", "coordinate real symmetric\n3 3 100000000000"])
def test_matrices_likewise(tmp_path, head):
    (tmp_path / "good.csv").write_text("1,0,0,1\n2,1,0,1\n3,0,1,1\n")
    (tmp_path / "K.mtx").write_text(f"%%MatrixMarket matrix {head}\n")
    done = call("check", written(tmp_path, ON_A_BOX.format("matrix: {stiffness: K.mtx, nodes: good.csv, outward: [0, 0, -1]}")))
    assert done.exit_code == 2 and "GB of memory" in done.output, done.output


EVIL = ["\x1b[31mred\x1b]0;title\x07", "![x](/etc/passwd)</script><script>alert(1)</script>", "[bold]x[/bold]\u202egnp.exe"]


def test_names_are_text_wherever_they_are_shown(tmp_path):
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1.0], [2, 0, 1]])
    cells = np.array([[0, 1, 2, 3], [1, 2, 3, 4], [1, 5, 4, 3]])
    sets = {name: [np.array([i])] for i, name in enumerate(EVIL)}
    text = "*NODE\n" + "".join(f"{i},{x},{y},{z}\n" for i, (x, y, z) in enumerate(points.tolist(), 1)) + "".join(
        f"*ELEMENT, TYPE=C3D4, ELSET={name}\n{i},{','.join(str(n + 1) for n in cells[i])}\n" for i, name in enumerate(sets))
    (tmp_path / "names.inp").write_text(text)
    done = call("inspect", "names.inp")
    assert done.exit_code == 0 and "\\x1b[31mred" in done.output and "[bold]x[/bold]\\u202e" in done.output
    assert not set(done.output) & set("\x1b\x07\u202e")
    done = call("check", written(tmp_path, "mesh: {file: names.inp}\n" + '"\\e[31mkey": 1'))
    assert done.exit_code == 2 and "\x1b[31mkey" not in done.output and "\\x1b[31mkey" in done.output


def test_a_report_shows_the_runs_own_pictures_alone(tmp_path):
    (tmp_path / "secret.png").symlink_to("/etc/passwd")
    for place in ("/etc/passwd", "../secret.png", "/etc/../etc/passwd", "figures/../../x.png"):
        assert "base64" not in page(f"![x]({place})\n\n<script>alert(1)</script>", tmp_path, "<script>")
    assert "<script>" not in page("<script>alert(1)</script> [x](javascript:alert(1))", tmp_path, "<script>")


def test_every_line_of_the_threat_model_has_its_test():
    """And every test its line."""
    told = set(re.findall(r"`(test_\w+)`", (Path(__file__).parents[1] / "docs" / "security.md").read_text(encoding="utf-8")))
    there = {name for name in globals() if name.startswith("test_")} - {
        "test_the_script_is_one", "test_every_line_of_the_threat_model_has_its_test"}
    assert told == there
