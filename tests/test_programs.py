"""Programs of the user's own as parts: in FreeFEM, C and Python; and every way in which one may be wrong."""

import shutil
import subprocess
import sys
import tempfile
import threading
import time
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from foreign_case import write_deck
from in_process import IN_PROCESS
from ruamel.yaml import YAML
from yaml_case import call

from orchestrator.blackbox.transport.runs import AlgebraWorker
from orchestrator.blackbox.codes.calculix.deck import DeckCode
from orchestrator.blackbox.codes.parts import finish_parts
from orchestrator.blackbox.codes.parts import ProgramCode
from orchestrator.config.load import config_from
from orchestrator.config.mesh import DeckPart, ProgramPart
from orchestrator.errors import InputError
from orchestrator.results.folder import ResultsFolder
from orchestrator.run import solve
from orchestrator.scene.mesh.sources import bricks

EXAMPLES = Path(__file__).parents[1] / "examples" / "programs"


def example(name, **program):
    """The data of an example, its program's files found, some keys of its program changed."""
    data = YAML(typ="safe").load((EXAMPLES / f"{name}.yaml").read_text())
    own = data["parts"][1]["program"]
    own |= {"run": str(EXAMPLES / own["run"]), **program}
    return data


@pytest.mark.long
def test_a_script_in_freefem_with_its_own_mesh_matter_and_loads(tmp_path):
    """Against the same mesh in one of ours: displacements to 1e-9, a bound, and a result that it has written itself."""
    feet = bricks(np.ones(3), np.array([3, 3, 3]), "post").surfaces["zmin"]
    (tmp_path / "facets.csv").write_text("\n".join(" ".join(map(str, row)) for row in feet))
    data = {**example("post", facets=str(tmp_path / "facets.csv")), "blackbox": IN_PROCESS}
    del data["parts"][1]["program"]["outward"]
    made = config_from(data)
    found = solve(made)
    ours = solve(config_from({**data, "parts": [data["parts"][0], {**data["parts"][1], "program": None,
                                                                   "mesh": {"file": str(EXAMPLES / "post.mesh")}}],
                              "loads": [{"on": "post", "body_force": [4, 0, -9], "history": "grow"}], "histories": {"grow": [1, 2, 3]}}))
    assert found.converged and found.error_bound <= 1e-10 and not found.summary["warnings"][1:]
    nodes = ours.scene.mesh.nodes[ours.scene.subdomains[1].nodes]
    joint = nodes[:, 2] < 1 + 1e-9
    size = np.abs(ours.parts[1]).max()
    assert np.abs(found.parts[1][:, :16] - ours.parts[1][:, joint]).max() <= 1e-9 * size
    assert np.abs(found.parts[0] - ours.parts[0]).max() <= 1e-9 * size
    assert np.abs(found.joints[1][:, :16].sum(axis=1) - np.outer([1, 2, 3], [-4, 0, 9])).max() < 1e-6
    assert finish_parts(made.codes, found.scene.subdomains, found.parts, found.joints, ResultsFolder(tmp_path).of_part) == []
    top = np.loadtxt(tmp_path / "parts" / "post" / "top.txt")[:, 1:]
    np.testing.assert_allclose(top, ours.parts[1][:, np.argmax(nodes.sum(axis=1))], rtol=1e-5, atol=1e-5 * size)


@pytest.mark.skipif(shutil.which("cc") is None, reason="no compiler")
@pytest.mark.long
def test_a_program_in_c(tmp_path):
    """It keeps the protocol; its stiffness is the one that its bars have; it carries a block in frictional contact."""
    lattice = str(tmp_path / "lattice")
    subprocess.run(["cc", "-O2", "-o", lattice, EXAMPLES / "lattice.c", "-lm"], check=True)
    shown = call("conformance", lattice)
    assert shown.exit_code == 0 and "write held: true" in shown.stdout and "16 nodes" in shown.stdout
    data = {**example("lattice", run=lattice), "blackbox": IN_PROCESS, "method": {"tolerance": {"error": 1e-4}}}
    made = config_from(data)
    S = ProgramCode(made.codes[-1]).condensed().stiffness
    exact = bars()
    assert np.abs(S - exact).max() < 1e-9 * np.abs(exact).max()
    found = solve(made)
    assert found.converged and found.summary["status_counts"]["slip"][1] > 0
    np.testing.assert_allclose(found.joints[1].sum(axis=1)[:, 2], -12, rtol=1e-3)


def bars():
    """(48, 48) what the joint of the lattice opposes to displacements."""
    x = np.array([[i, j, k] for k in range(4) for j in range(4) for i in range(4)]) / 3
    K = np.zeros((192, 192))
    for i in range(64):
        for j in range(i):
            d = x[j] - x[i]
            if (length := np.linalg.norm(d)) * 3 <= 1.8:
                k = 4e3 * np.outer(d, d) / length**3
                for a, b, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
                    K[3 * a : 3 * a + 3, 3 * b : 3 * b + 3] += sign * k
    K[np.arange(48), np.arange(48)] += 1e9
    inner, joint = K[:144, :144], K[144:, 144:]
    return joint - K[144:, :144] @ np.linalg.solve(inner, K[:144, 144:])


# Six points joined by bars, four of them the joint, in plain Python: it starts quickly. What is wrong with it is put in by each case.
SOUND = """
import os, sys, time
POINTS = {{1: (0., 0., 1.), 2: (1., 0., 1.), 3: (0., 1., 1.), 4: (1.1, .9, 1.), 5: (.4, .3, 2.), 6: (.6, .8, 1.7)}}
def stiffness():
    ids = list(POINTS)
    K = [[0.] * 18 for _ in range(18)]
    for i in range(6):
        for j in range(i):
            d = [a - b for a, b in zip(POINTS[ids[i]], POINTS[ids[j]])]
            size = sum(x * x for x in d)
            for a in range(3):
                for b in range(3):
                    k = 100. * d[a] * d[b] / size
                    K[3*i+a][3*i+b] += k; K[3*j+a][3*j+b] += k; K[3*i+a][3*j+b] -= k; K[3*j+a][3*i+b] -= k
    return K
def solve(K, b):
    K, b = [row[:] for row in K], b[:]
    for i in range(len(b)):
        pivot = max(range(i, len(b)), key=lambda r: abs(K[r][i]))
        K[i], K[pivot], b[i], b[pivot] = K[pivot], K[i], b[pivot], b[i]
        for r in range(i + 1, len(b)):
            f = K[r][i] / K[i][i]
            K[r] = [x - f * y for x, y in zip(K[r], K[i])]; b[r] -= f * b[i]
    u = [0.] * len(b)
    for i in reversed(range(len(b))):
        u[i] = (b[i] - sum(K[i][j] * u[j] for j in range(i + 1, len(b)))) / K[i][i]
    return u
joint = [(i, *POINTS[i]) for i in (1, 2, 3, 4)]
K = stiffness()
{stiffness}
words = open('springs.txt').read().split()
n = int(words[0]); at = 1
for i in range(n):
    for c in range(3): K[3*i+c][3*i+c] += float(words[at + 1 + c])
    at += 4
words = open('forces.txt').read().split()
n, cases = int(words[0]), int(words[1]); at = 2
rows = []
for case in range(cases):
    own = int(words[at]); at += 1
    b = [0.] * 18; ids = []
    {loads}
    for i in range(n):
        ids.append(int(words[at]))
        for c in range(3): b[3*i+c] += float(words[at + 1 + c])
        at += 4
    u = solve(K, b)
    {answers}
    rows += [(ids[i], *u[3*i:3*i+3]) for i in range(n)]
{end}
open('joint.txt', 'w').writelines(' '.join(str(x) for x in row) + '\\n' for row in joint)
open('displacements.txt', 'w').writelines(' '.join(str(x) for x in row) + '\\n' for row in rows)
"""


def program(folder, head=f"#!{sys.executable} -S", **bodies):
    path = folder / "mine"
    path.write_text(head + SOUND.format(**{"stiffness": "", "loads": "", "answers": "", "end": "", **bodies}))
    path.chmod(0o755)
    return str(path)


def condensed(run, **part):
    """The part on its joints, as it is brought there."""
    own = ProgramPart(**{"run": run, "outward": [0, 0, -1], **part})
    return ProgramCode(ProgramCode.Settings(code="program", part=own, name="it", place=("parts", 1, "program"), factors=(1.0, 3.0),
                                            young=100.0)).made()


@cache
def exact():
    """(12, 12) of the sound program."""
    scope = {}
    exec(SOUND.split("joint =")[0].format(), scope)
    K = np.array(scope["stiffness"]())
    return K[:12, :12] - K[:12, 12:] @ np.linalg.solve(K[12:, 12:], K[12:, :12])


def test_a_sound_program_whatever_its_units_and_loads(tmp_path):
    """Springs are chosen by what it answers: of any size, S is exact; loads are those of each load step."""
    run = program(tmp_path, loads="b[17] = -2. * own")
    part = condensed(run, loads=True)
    assert np.abs(part.stiffness - exact()).max() < 1e-12 * 100
    np.testing.assert_allclose(part.loads.reshape(2, 4, 3).sum(axis=1), [[0, 0, -2], [0, 0, -4]], atol=1e-10)
    small = condensed(program(tmp_path, stiffness="K = [[1e-9 * k for k in row] for row in K]"))
    assert np.abs(small.stiffness - 1e-9 * exact()).max() < 1e-10 * 1e-7
    digits = condensed(program(tmp_path, answers="u = [float('%.8e' % x) for x in u]"))
    assert 1e-10 < digits.floor < 1e-6 and part.floor == 0


WRONG = {  # what is put in → words of the message
    "exit code": ({"end": "print('no licence'); sys.exit(7)"}, "ended with exit code 7: no licence"),
    "killed": ({"end": "os.kill(os.getpid(), 11)"}, "killed by signal 11"),
    "no displacements": ({"end": "open('joint.txt', 'w').write('1 0 0 1\\n2 1 0 1\\n3 0 1 1\\n4 1.1 .9 1\\n'); sys.exit(0)"},
                         "left no displacements.txt"),
    "no joint": ({"end": "sys.exit(0)"}, "left no joint.txt"),
    "empty joint": ({"end": "joint = []"}, "joint.txt is empty"),
    "joint without heights": ({"end": "joint = [row[:3] for row in joint]"}, "joint.txt, line 1"),
    "node twice": ({"end": "joint.append(joint[0])"}, "node 1 a second time"),
    "nodes at one place": ({"end": "joint.append((9, *joint[0][1:]))"}, "nodes 1 and 9 at one place"),
    "joint off its plane": ({"end": "joint.append((5, .4, .3, 2.))"}, "off a plane"),
    "rows missing": ({"end": "rows = rows[:-1]"}, "displacements.txt has"),
    "not a number": ({"answers": "u[3] = float('nan')"}, "numbers that are finite"),
    "too narrow": ({"end": "rows = [(row[0], '****', 0, 0) for row in rows]"}, "numbers that are finite"),
    "order of nodes": ({"end": "rows = rows[::-1]"}, "where 1 was asked"),
    "own loads always": ({"loads": "b[17] = 3."}, "without any load its joint moves"),
    "the second time": ({"answers": "u = [x * (1 + 1e-9 * (cases == 1)) for x in u]"}, "otherwise the second time"),
    "large displacements": ({"answers": "u = [x + x * abs(x) for x in u]"}, "twice the force is not twice the displacement"),
    "unsymmetric": ({"stiffness": "K[0][4] += 9."}, "not reciprocal"),
    "negative": ({"stiffness": "K = [[-k for k in row] for row in K]"}, "moves its joint backwards|gives way"),
    "forces forgotten": ({"answers": "u = [0.] * 18"}, "forces on its joint do not move it"),
    "springs forgotten": ({"end": "", "stiffness": "K = [[k + 1e-6 * (i == j) for j, k in enumerate(row)] for i, row in enumerate(K)]; "
                           "open('springs.txt', 'w').write('0')"}, "gives way|supports that hold it|backwards"),
    "hidden supports": ({"stiffness": "for i in (15, 16, 17): K[i][i] += 1e6"}, "supports that hold it are inside"),
    "wrong units of its nodes": ({"end": "joint = [(i, x, 7 * y, z) for i, x, y, z in joint]"}, "rotations cost force"),
}


@pytest.mark.parametrize("kind", WRONG)
def test_wrong_programs_are_told(tmp_path, kind):
    """Each by its own message, with the part's name and the place in the YAML; nothing is left running, no folder either."""
    bodies, words = WRONG[kind]
    with pytest.raises(InputError, match=words) as caught:
        condensed(program(tmp_path, **bodies))
    assert caught.value.problems[0].path[:3] == ("parts", 1, "program")


def test_wrong_entries_of_programs_are_told(tmp_path):
    run = program(tmp_path)
    for part, words in (({"outward": None}, "neither facets nor outward"), ({"held": True}, "rigid motions cost nothing")):
        with pytest.raises(InputError, match=words):
            condensed(run, **part)
    with pytest.raises(InputError, match="cannot be started"):
        condensed(program(tmp_path, head="#!/nowhere/python"))
    with pytest.raises(InputError, match="no answer within 0.2 s"):
        condensed(program(tmp_path, end="time.sleep(60)"), timeout=0.2)
    Path(run).chmod(0o644)
    with pytest.raises(InputError, match="may not be executed"):
        condensed(run)
    with pytest.raises(InputError, match="two joints"):
        (tmp_path / "facets.csv").write_text("1 3 2\n")
        condensed(program(tmp_path, end="joint = [(*row, name) for row, name in zip(joint, ('a', 'a', 'b', 'b'))]"),
                  facets=str(tmp_path / "facets.csv"), outward=None)


@pytest.mark.parametrize("kind", ["program", "deck"])
def test_whoever_interrupts_a_run_does_not_wait_for_a_program(tmp_path, monkeypatch, kind):
    """Its pool ends what it has started, from another thread; no folder is left."""
    run, begun = program(tmp_path, end="open(%r, 'w').close(); time.sleep(60)" % str(tmp_path / "begun")), time.monotonic()
    if kind == "program":
        of, part = ProgramCode, ProgramPart(run=run, outward=[0, 0, -1])
    else:  # a CalculiX that takes its time
        write_deck(tmp_path)
        sleeper = tmp_path / "ccx"
        sleeper.write_text(f"#!/bin/sh\n: > {tmp_path / 'begun'}\nsleep 60\n")
        sleeper.chmod(0o755)
        monkeypatch.setenv("ORCHESTRATOR_CALCULIX", str(sleeper))
        of, part = DeckCode, DeckPart(calculix=str(tmp_path / "part.inp"), joints=["FLANGE"])
    code = of(of.Settings(code=kind, part=part, name="it", place=("parts", 1, kind), factors=(1.0,)))
    failures, folder = [], tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))

    def ask():
        try:
            code.made()
        except InputError as error:
            failures.append(str(error))

    asking = threading.Thread(target=ask)
    asking.start()
    while not (tmp_path / "begun").exists() and time.monotonic() - begun < 30:
        time.sleep(0.01)
    worker = AlgebraWorker(code, tmp_path, 0)
    worker.kill()
    worker.release()
    asking.join(timeout=30)
    assert not asking.is_alive() and {"program": "killed by signal 9", "deck": "killed by SIGKILL"}[kind] in failures[0]
    assert not list(folder.iterdir())
