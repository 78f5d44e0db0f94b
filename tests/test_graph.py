"""``inspect --graph``: parts, codes, interfaces, supports and loads of a configuration, as text and as a picture."""

import json

import numpy as np
import pytest
from yaml_case import blocks, call

from orchestrator.results.figures.graph import layout
from orchestrator.scene.graph import MOST, Edge, Graph, Node


def rows(text):
    return [line.split("  ") for line in text.splitlines()]


def test_two_blocks(tmp_path):
    done = call("inspect", blocks(tmp_path), "--graph", tmp_path / "graph.png")
    assert done.exit_code == 0, done.output
    told = [[cell.strip() for cell in row if cell.strip()] for row in rows(done.stdout)]
    assert ["slice 0", "1", "in_process.py", "P1", "81", "1", "-", "displacement on z = 0"][:2] == told[3][:2]
    assert told[3][3:] == ["P1", "81", "1", "-", "displacement on z = 0"] and told[4][-1] == "displacement on z = 1"
    assert told[-1] == ["slice 0 | slice 1", "contact", "friction 0.2", "matching", "1", "9"]
    assert (tmp_path / "graph.png").read_bytes().startswith(b"\x89PNG")
    assert call("inspect", blocks(tmp_path), "--graph", "-").stdout == done.stdout


def test_loads_in_volumes_and_what_contact_alone_holds(tmp_path):
    path = blocks(tmp_path, boundary=[{"on": {"plane": "z", "at": 0.0}, "displacement": [0, 0, 0]}], loads=[{"body_force": [0, 0, -1]}])
    told = call("inspect", path, "--graph", "-").stdout.splitlines()
    assert told[3].endswith("-      displacement on z = 0; body_force") and told[4].endswith("1      body_force")


def test_grounds_are_nodes(tmp_path):
    path = blocks(tmp_path, boundary=[{"on": {"plane": "z", "at": 0.0}, "foundation": {"normal": 1e4, "tangential": 1e4}}])
    assert "support" in call("inspect", path, "--graph", "-").stdout


@pytest.mark.parametrize("words, said", [
    (["blocks.yaml", "--graph", "graph.jpg"], "ends in .png"), (["blocks.yaml", "--graph", "g.png", "--html", "g.html"], "one of them"),
    (["mesh.msh", "--graph", "g.png"], "neither codes nor laws")])
def test_what_is_refused(tmp_path, monkeypatch, words, said):
    blocks(tmp_path)
    monkeypatch.chdir(tmp_path)
    done = call("inspect", *words)
    assert done.exit_code == 2 and said in done.stderr


def test_a_program_is_not_started_unasked(tmp_path):
    path = tmp_path / "post.yaml"
    path.write_text(json.dumps({"name": "post", "parts": [{"name": "post", "program": {"run": "post.sh", "outward": [0, 0, -1]},
                                                           "material": {"young": 1.0, "poisson": 0.3}}],
                                "subdomains": "groups", "boundary": []}))
    (tmp_path / "post.sh").write_text(f"#!/bin/sh\ntouch {tmp_path}/started\n")
    (tmp_path / "post.sh").chmod(0o755)
    done = call("inspect", path, "--graph", "-")
    assert done.exit_code == 2 and "--run-programs" in done.stderr and not (tmp_path / "started").exists()


def many(names, codes=("a",)):
    nodes = [Node(name, 1, 1, 0, np.array([k, 0, 0.0]), codes[k % len(codes)], "P1", 3) for k, name in enumerate(names)]
    return Graph("many", nodes, [Edge((k, k + 1), "contact", "", "matching", 1, 4) for k in range(len(names) - 1)])


def test_a_thousand_bodies_become_a_few_nodes():
    """Nothing is lost: bodies, dofs, interfaces and points are those of all."""
    alike = many([f"grain_{k}" for k in range(1000)] + ["plate"]).readable()
    assert [(n.name, n.bodies, n.dofs) for n in alike.nodes] == [("grain_*", 1000, 3000), ("plate", 1, 3)]
    assert {(e.ends, e.interfaces, e.points) for e in alike.edges} == {((0, 0), 999, 3996), ((0, 1), 1, 4)}
    letters = ["".join(chr(97 + (k // 26**p) % 26) for p in range(3)) for k in range(MOST + 1)]
    by_code = many(letters, ("a", "b")).readable()
    assert [(n.name, n.code) for n in by_code.nodes] == [("*", "a"), ("*", "b")] and sum(e.interfaces for e in by_code.edges) == MOST
    assert many(letters[:MOST]).readable().together == ""


@pytest.mark.parametrize("places", [np.zeros((12, 3)), np.eye(3)[np.arange(20) % 3] * np.arange(20)[:, None], np.arange(30)[:, None] * [1.0, 0, 0]],
                         ids=["in one place", "along axes", "a chain"])
def test_nodes_do_not_overlap(places):
    size = np.tile([2.0, 0.5], (len(places), 1))
    at = layout(places, 1.3 * size)
    apart = np.abs(at[:, None] - at[None])
    assert ((apart >= size[0]).any(axis=2) | np.eye(len(places), dtype=bool)).all()
