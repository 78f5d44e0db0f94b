"""The shipped configurations, shortened where they are long: each converges and shows what it is there for."""

import json
import tempfile
from copy import deepcopy

import numpy as np
import pytest
from processes import nothing_left
from quick import quick
from yaml_case import call

from orchestrator.scene.mesh import solids

pytestmark = pytest.mark.xdist_group("shipped")  # one process reads the CAD model for all

def tightened(summary, fields):
    """Each bolt pulls from its step on, ten times as much as before; the neck's pull adds a few per cent, not its share."""
    forces = -np.array(summary["reactions"][1:9])[:, :, 2]
    before, after = np.tril(np.ones((8, 8)), -1) == 1, np.triu(np.ones((8, 8))) == 1
    usual, neck = forces[:, :8][after].mean(), summary["reactions"][0][-1][2]
    return (np.abs(forces[:, :8][after] / usual - 1).max() < 0.02 and np.abs(forces[:, :8][before] / usual - 0.1).max() < 0.01
            and 0.01 < forces[:, 8].sum() / (8 * usual) - 1 < 0.1 * neck / (8 * usual))


SHIPPED = {  # configuration: what shortens it, iterations at most
    "traction_beam": (["mesh.beam.h=2.5", "subdomains.slices.count=16"], 9),
    "assembly": (["mesh.h=10", "output.fields=false"], 25),
    "metis_box": ([], 25),
    "bending_beam_p2": ([], 14),
}
SHIPPED_CONTACT = {  # what shortens it, iterations at most, what its results show; of bonds, those whose meshes do not match
    "accuracy_l": (["method.accuracy=0.08"], 10, lambda s, f: s["accuracy"]["met"] and 2 <= len(s["accuracy"]["meshes"]) <= 4
                   and s["accuracy"]["reached"] > 0.08 / 3),
    "two_blocks": ([], 40, lambda s, f: statuses(s, "stick")[0] == statuses(s, "slip")[1] == statuses(s, "open")[3] == 81),
    "sliding_block": ([], 40, lambda s, f: abs(s["reactions"][1][2][0] - 20) < 1e-3 and statuses(s, "slip") == [0, 0, 81]),
    "press_fit": ([], 20, lambda s, f: np.abs(f["pressure"] / 200.0 - 1).max() < 1e-5),
    "hertz": ([], 60, lambda s, f: abs(f["pressure"][-1].max() / hertz_pressure(s["reactions"][0][-1][2]) - 1) < 0.03),
    "rigid_ball": (["mesh.box.cells=[8, 8, 4]"], 60, lambda s, f: abs(s["reactions"][1][0][2] + 800) < 0.1 and statuses(s, "slip")[1] > 0
                   and statuses(s, "stick")[1] > 0 and -0.12 < s["tools"][0]["displacement"][0][2] < -0.06),
    "assembly_contact": (["mesh.h=10", "method.tolerance.error=1e-3"], 150, lambda s, f: s["interfaces"] == 32 and all(
        700 < abs(i["resultant"][0][2]) < 1200 for i in s["interface_resultants"] if set(i["name"].split()[::2]) & {"plate"}
        and "nut" in i["name"])),
    "flange": (["method.tolerance.error=1e-3"], 25, tightened),
    "bolts": (["method.tolerance.error=1e-3"], 25, lambda s, f: all(
        b["state"][1:] == ["tightened" if b["force"][0] < 100 else "locked", "locked"] and 8000 < b["force"][2] < 9000
        for b in s["bolts"])),
    "stack": (["method.tolerance.error=1e-3"], 30, lambda s, f: s["detached"] == [[]] * 4 and statuses(s, "stick")[0] > 0
              and abs(s["reactions"][0][1][2] + s["reactions"][1][1][2]) < 1),
    "portal": ([], 50, lambda s, f: abs(s["reactions"][0][2][2] - 3.5) < 1e-4 and statuses(s, "slip")[2] > 0
               and {"deck file", "matrix file"} < {f"{c['code']} {c['transport']}" for c in s["codes"]}),
    "five_doors": (["method.tolerance.error=1e-3"], 35, lambda s,
                   f: np.abs(np.array(s["reactions"][0][2]) - [-3.272, 0, 7.912]).max() < 1e-2 and sum(statuses(s, "stick"))
                   and {f"{c['code']} {c['transport']}" for c in s["codes"]} == {
                       "freefem pipe", "beam.py pipe", "deck file", "matrix file", "program file"}),
    "polycrystal_10": (["mesh.polycrystal.h=0.2"], 120, lambda s, f: statuses(s, "open")[3] > statuses(s, "open")[1]),
    "polycrystal_100": (["mesh.polycrystal.grains=8", "mesh.polycrystal.h=0.25"], 150,
                        lambda s, f: statuses(s, "slip")[2] > 0),
}


SHIPPED_CODES = {  # what shortens it, iterations at most, its codes and transports
    "two_codes": (["mesh.box.cells=[16, 4, 4]"], 15, ["freefem pipe", "calculix file"]),
    "four_codes": (["mesh.box.cells=[10, 2, 2]"], 20,
                   ["freefem pipe", "freefem file", "calculix file", "scikit-fem pipe", "template.py pipe"]),
    "assembly_codes": (["mesh.h=10", "output.fields=false"], 30, ["freefem pipe", "calculix file"]),
    "punch": ([], 50, ["freefem pipe", "calculix file"]),
    "tube_in_frame": (["histories.expand=[0.5, 1.0, 0.0]", "method.tolerance.error=1e-4"], 60, ["freefem pipe", "elastoplastic.py pipe"]),
    "slider": (["parts.1.mesh.box.cells=[6, 6, 5]"], 60, ["freefem pipe", "scikit-fem pipe"]),
}


def statuses(summary, kind):
    return summary["status_counts"][kind]


def hertz_pressure(force):
    """Closed form for half a cylinder of radius 2 on a slice 0.02 thick, from the force on it."""
    per_length, effective = 2 * force / 0.02, 200e3 / (2 * (1 - 0.3**2))
    return np.sqrt(per_length * effective / (np.pi * 2))


@pytest.fixture(autouse=True, scope="module")
def cad_is_read_once():
    """Three configurations share a CAD model: gmsh joins its 18 solids once."""
    with pytest.MonkeyPatch.context() as patch:
        read, known = solids.conforming, {}

        def load(*arguments):
            if (key := repr(arguments)) not in known:
                known[key] = read(*arguments)
            return deepcopy(known[key])

        patch.setattr(solids, "conforming", load)
        yield


@pytest.fixture(autouse=True)
def nothing_is_left(tmp_path, monkeypatch):
    """Every run has a temporary folder of its own; it leaves that empty, and no process in it."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    yield
    assert nothing_left(folder)


def of_command(path, out, changes, *options):
    """Summary and stdout of ``orchestrator run``, called in this process; it converged."""
    settings = [word for change in [*changes, "output.figures=false"] for word in ("--set", change)]
    done = call("run", path, "--output", out, *options, *settings)
    assert done.exit_code == 0, done.stderr
    return json.loads((out / "summary.json").read_text()), done.stdout


def test_every_shipped_configuration_is_run(configs_dir):
    """No example without a test."""
    assert {path.stem for path in configs_dir.glob("*.yaml")} == {*SHIPPED, *SHIPPED_CONTACT, *SHIPPED_CODES}


@pytest.mark.parametrize("name", quick(SHIPPED, "bending_beam_p2"))
def test_shipped_configurations(name, tmp_path, configs_dir):
    """Converged, with a true error below a bound below 1e-6, within the stages expected; supports carry the loads."""
    changes, iterations = SHIPPED[name]
    summary, _ = of_command(configs_dir / f"{name}.yaml", tmp_path / "out", changes, "--reference", "--quiet")
    assert summary["true_error"] <= summary["error_bound"] <= 1e-6 and summary["iterations"] <= iterations
    if name != "metis_box":  # weight is no entry of the boundary
        reactions = np.array(summary["reactions"])
        assert np.abs(reactions.sum(axis=0)).max() <= 1e-9 * np.abs(reactions).max()


@pytest.mark.parametrize("name", quick(SHIPPED_CONTACT, "hertz", "polycrystal_10", "press_fit"))
def test_shipped_contact_configurations(name, tmp_path, configs_dir):
    """Converged within the stages expected, to the energy error or the law residual asked for; each shows what it is there for."""
    changes, iterations, shows = SHIPPED_CONTACT[name]
    summary, _ = of_command(configs_dir / f"{name}.yaml", tmp_path / "out", changes, "--quiet")
    assert summary["iterations"] <= iterations
    asked = summary["config"]["method"]["tolerance"]
    reached = summary["residuals"]["law_residual"] if "law" in asked else summary["error_bound"]
    assert reached <= asked["law" if "law" in asked else "error"]
    with np.load(tmp_path / "out" / "fields.npz") as fields:
        assert shows(summary, fields)


@pytest.mark.parametrize("name", quick(SHIPPED_CODES, "two_codes"))
def test_shipped_configurations_of_several_codes(name, tmp_path, configs_dir):
    """Converged, with every code at work; supports carry the loads; nothing is left by any code."""
    changes, iterations, codes = SHIPPED_CODES[name]
    summary, shown = of_command(configs_dir / f"{name}.yaml", tmp_path / "out", changes, "--verbose")
    assert summary["iterations"] <= iterations
    assert [f"{entry['code']} {entry['transport']}" for entry in summary["codes"]] == codes
    assert all(entry["seconds"]["total"] > 0 and entry["subdomains"] for entry in summary["codes"])
    assert 0 < summary["orchestrator_seconds"] < summary["timing"]["total"] and all(
        f"{entry['code']} ({entry['transport']}): " in shown for entry in summary["codes"])
    reactions = np.array(summary["reactions"])
    assert np.abs(reactions.sum(axis=0)).max() <= 1e-5 * np.abs(reactions).max()
    if name == "punch":  # sticks in part, sticks more, slides, sticks again
        assert statuses(summary, "slip")[2] == statuses(summary, "stick")[3] == 88
        assert abs(reactions[0][2][0] / reactions[0][2][2]) == pytest.approx(0.3, rel=0.03)
    elif name == "slider":  # dragged there and back, all of it, nearly all along the way
        assert statuses(summary, "stick")[0] > 0 and statuses(summary, "stick")[1:] == [0, 0]
        assert all(0.298 < np.hypot(*step[:2]) / step[2] <= 0.3 for step in reactions[0][1:])
    elif name == "tube_in_frame":  # what has flown stays pressed on the frame when the pressure is gone
        assert statuses(summary, "open") == [0, 0, 0] and summary["nonlinear"]["subdomains"] == ["tube"]
        assert abs(summary["interface_resultants"][0]["resultant"][2][0]) > 1000
    else:
        assert summary["error_bound"] <= 1e-6
