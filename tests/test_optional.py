"""Packages that not everybody has: what does without them runs, what does not names each with the command that brings it."""

import json
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from orchestrator.errors import InputError
from orchestrator.optional import absent, check_there, command, DRAWING, Late, need, WANTED

ROOT = Path(__file__).parents[1]
# Python as it is where none of the packages of the extras is installed.
BLOCKED = f"""
import sys
for name in {(*WANTED,)!r}:
    sys.modules[name] = None
"""
BARE = {"name": "bar", "mesh": {"box": {"size": [4, 1, 1], "cells": [4, 1, 1]}}, "subdomains": {"slices": {"axis": "x", "count": 2}},
        "materials": [{"young": 1.0, "poisson": 0.3}], "blackbox": {"code": str(ROOT / "orchestrator/blackbox/codes/template.py")},
        "boundary": [{"on": "xmin", "displacement": [0, 0, 0]}, {"on": "xmax", "traction": [1e-3, 0, 0]}]}
CONTACT = {**BARE, "interfaces": [{"law": "contact"}]}
GRAPH = {**BARE, "subdomains": {"metis": 2}}
CAD = {**BARE, "mesh": {"step": "gmsh:as1-tu-203.stp", "h": 20}, "subdomains": "groups"}


def blocked(code: str) -> str:
    """What a program prints that finds none of the packages."""
    done = subprocess.run([sys.executable, "-c", BLOCKED + textwrap.dedent(code)], capture_output=True, text=True, cwd=ROOT, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.long
def test_the_core_runs_alone_and_the_rest_is_asked_for_by_name(tmp_path):
    """A bonded bar is solved and written; contact, METIS, CAD files, VTK's files, a report, pages and ranks are refused, each with its cure."""
    (tmp_path / "mesh.vtu").write_text('<VTKFile type="UnstructuredGrid"></VTKFile>')
    (tmp_path / "bar.json").write_text(json.dumps(BARE))  # which YAML is too
    said = json.loads(blocked(f"""
        import json, pathlib
        from typer.testing import CliRunner
        from orchestrator import InputError, build_scene, config_from, solve
        from orchestrator.cli import app
        from orchestrator.optional import need
        from orchestrator.results.report.report import report
        from orchestrator.scene.mesh.readers.vtk import read_vtk
        said = {{}}
        def refused(name, call):
            try:
                call()
            except InputError as error:
                said[name] = str(error)
        refused("contact", lambda: solve(config_from({CONTACT!r})))
        refused("graph", lambda: build_scene(config_from({GRAPH!r})))
        refused("cad", lambda: build_scene(config_from({CAD!r})))
        refused("vtu", lambda: read_vtk(pathlib.Path({str(tmp_path / 'mesh.vtu')!r})))
        refused("report", lambda: report({str(tmp_path)!r}))
        done = CliRunner().invoke(app, ["run", {str(tmp_path / 'bar.json')!r}, "--output", {str(tmp_path / 'results')!r}])
        print(json.dumps({{**said, "run": done.exit_code, "printed": " ".join((done.stdout + str(done.exception or '')).split())}}))
        """))
    for name, extra in (("contact", "fast"), ("graph", "mesh"), ("cad", "mesh"), ("vtu", "figures"), ("report", "figures")):
        assert f"pip install 'latin-orchestrator[{extra}]'" in said[name], name
    assert said["run"] == 0 and "no figures: matplotlib, pyvista, vtkmodules not installed" in said["printed"], said["printed"]
    assert (tmp_path / "results" / "fields" / "fields.pvd").is_file()


def test_what_stands_for_a_package_is_that_package():
    assert Late("json").dumps([1]) == "[1]" and not absent("json")
    with pytest.raises(AttributeError):
        Late("json").nothing


def test_what_is_broken_is_not_called_absent(tmp_path, monkeypatch):
    """A package that lacks one of its own is a fault to be seen."""
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setitem(WANTED, "halfway", ("mesh", "it is a test"))
    (tmp_path / "halfway.py").write_text("import no_such_package_anywhere\n")
    with pytest.raises(ModuleNotFoundError, match="no_such_package_anywhere"):
        need("halfway")
    check_there("halfway")
    monkeypatch.setitem(WANTED, "nowhere", ("mesh", "it is a test"))
    with pytest.raises(InputError, match="latin-orchestrator\\[mesh\\]"):
        check_there("nowhere")


def test_extras_are_those_of_the_package():
    """Whatever is asked for by name is in the extra that is named."""
    import tomllib

    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    for name, (extra, _) in WANTED.items():
        package = {"vtkmodules": "vtk"}.get(name, name)
        assert any(entry.partition(">")[0] == package for entry in extras[extra]), name
    assert set(DRAWING) <= WANTED.keys() and command("gmsh") == "pip install 'latin-orchestrator[mesh]'"
