"""A lap joint as CAD draws it: ``init`` finds bolts, nuts, threads and clearances; element sizes, names and faces of parts."""


import pytest
from contact_case import contact
from benchmarks.problems.lap_joint import lap_joint
from yaml_case import call

from orchestrator import InputError
from orchestrator.config.load import load_config
from orchestrator.config.mesh import MeshEntry as Section
from orchestrator.results.summary.lines import summary_rows
from orchestrator.results.summary.summary import View
from orchestrator.results.summary.verdict import verdict
from orchestrator.scene.fits import bolts
from orchestrator.scene.mesh.sources import make_mesh


def section(**keys):
    return Section.model_validate(keys)


@pytest.mark.long
def test_init_finds_bolts_nuts_threads_and_room(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = call("init", "joint.yaml", *lap_joint(tmp_path, shift=0.1))
    assert done.exit_code == 0, done.output
    config = load_config(tmp_path / "joint.yaml").config
    assert [part.mesh.rename for part in config.parts] == [None, {f"solid_{k}": name for k, name in enumerate(
        ["bolt_1", "nut_1", "bolt_2", "nut_2"], 1)}]
    assert all(part.mesh.h.curvature == 12 and part.mesh.h.min < part.mesh.h.max for part in config.parts)
    assert [bolt.on for bolt in config.bolts] == ["bolts/bolt_1", "bolts/bolt_2"] and config.steps == 5
    contact, *threads = config.interfaces
    assert contact.law == "contact" and contact.between == "auto" and 0.6 < contact.within < 1  # 0.5 of room, 0.1 off the middle
    assert [(entry.law, entry.between) for entry in threads] == [("perfect", [f"bolts/bolt_{k}", f"bolts/nut_{k}"]) for k in (1, 2)]


def test_sizes_by_curvature_on_faces_and_names(tmp_path):
    plates, bolts = lap_joint(tmp_path)
    keys = {"step": str(plates), "conforming": False, "rename": {"solid_1": "lower"}}
    coarse, fine, refined = (make_mesh(section(**keys, **more))[0] for more in (
        {"h": 8.0}, {"h": {"*": 8.0, "lower": {"curvature": 24, "max": 8.0}}}, {"h": 8.0, "refine": [{"on": "lower:1", "h": 2.0}]}))
    assert coarse.volumes == ["lower", "solid_2"] and "lower:8" in coarse.surfaces
    sides = [len({int(n) for n in mesh.surfaces["lower:7"].ravel()} & {int(n) for n in mesh.surfaces["lower:3"].ravel()})
             for mesh in (coarse, fine)]
    assert sides[1] == 24 and sides[0] < 12
    assert len(refined.surfaces["lower:1"]) > 8 * len(coarse.surfaces["lower:1"])
    assert len(refined.surfaces["solid_2:1"]) == len(coarse.surfaces["solid_2:1"])
    with pytest.raises(InputError, match="curvature: 1000 makes about 3.1e.06 nodes"):
        make_mesh(section(**{**keys, "step": str(bolts)}, h={"curvature": 1000}))
    with pytest.raises(InputError, match="did you mean solid_2 or solid_1"):
        make_mesh(section(**{**keys, "rename": {"solid_l": "lower"}}))
    with pytest.raises(InputError, match="several volumes called lower"):
        make_mesh(section(**{**keys, "rename": {"solid_1": "lower", "solid_2": "lower"}}))
    with pytest.raises(InputError, match="no face and no solid is called 'upper'"):
        make_mesh(section(**keys, refine=[{"on": "upper", "h": 1.0}]))


def face(name: str, kind: str = "plane", normal=(1e4, 1e4), used=(0.1, 0.6), slips=None) -> dict:
    """Return a face of a summary with a friction of 0.2."""
    capacity = [0.2 * force for force in normal]
    return {"name": name, "kind": kind, "normal": list(normal), "capacity": capacity, "used": list(used), "slips": slips,
            "carried": [share * most for share, most in zip(used, capacity)], "bears": list(normal)}


def told(*faces: dict, **more: object) -> list[str]:
    return verdict(View({"converged": True, "tolerance": 1e-4, "contact_faces": faces, **more}))


def test_shanks_that_bear_are_told_above_the_tolerance():
    def of(*bears):
        return told(face("a | b"), face("bolt | plate (bore)", "bore", bears, (0.0, 0.0)))

    assert of(0.0, 0.5)[-1] == "no shank bears in its hole"
    assert of(0.0, 50.0)[-1] == "bolt | plate (bore) bears from load step 2, with up to 50"
    assert of(0.0, 0.0)[0] == "a | b holds, with at most 60% of its friction used (1,200 of 2,000, load step 2)"


def test_plates_are_told_before_heads_and_what_is_not_pressed_yet_holds_nothing():
    """Bolts that are tightened in a second round move in the first: their heads have not slipped."""
    late = [face(f"bolt_{k} | a (head)", "head", (13.0, 8000.0), (0.98, 0.01 * k)) for k in range(1, 7)]
    said = told(*late, face("a | b", used=(0.005, 0.004)))
    assert [line.partition(", with")[0] for line in said] == [
        "a | b holds", "bolt_1 | a (head) holds", "5 more heads hold; nearest to slipping is bolt_6 | a (head)"]
    assert said[-1].endswith("at most 6% of its friction used (96 of 1,600, load step 2)")


def test_faces_that_nothing_presses_any_more_part():
    assert told(face("a | b", normal=(10.0, 50.0, 0.3), used=(0.9, 0.1, 0.2))) == [
        "a | b parts at load step 3, when nothing presses it any more; "
        "until then it holds, with at most 90% of its friction used (1.8 of 2, load step 1)"]


def test_what_rounding_leaves_of_a_bolts_shear_is_nothing():
    bolt = {"name": "m10", "force": [8e3], "shear": [1.4e-12], "bending": [3e-10], "state": ["locked"], "shortening": [0.01]}
    rows = dict(summary_rows({"converged": True, "bolts": [bolt]}))
    assert rows["bolts"] == "m10: axial 8000, shear 0, bending 0, locked"


def test_a_face_that_slips_and_could_hold_more_is_told_with_how_much():
    """On a slope just below the angle of friction a block slips a little everywhere, aslant, and goes nowhere."""
    slips = {"step": 1, "on": None, "before": None, "load": None, "at": None}
    for used, rest in ((0.983, ", with 98% of what friction can hold"), (0.9999, "")):
        assert told(face("a | b", normal=(1.0,), used=(used,), slips=slips)) == [f"a | b slips from load step 1{rest}"]
