"""A lap joint as CAD draws it: ``init`` finds bolts, nuts, threads and clearances; element sizes, names and faces of parts."""


import pytest
from contact_case import contact
from benchmarks.problems.lap_joint import lap_joint
from yaml_case import call

from orchestrator import InputError
from orchestrator.config.load import load_config
from orchestrator.config.mesh import Mesh as Section
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


def test_shanks_that_bear_are_told_above_the_tolerance():
    def told(bears):
        bore = {"name": "bolt | plate (bore)", "kind": "bore", "bears": bears, "normal": bears, "capacity": bears, "used": [0.0, 0.0],
                "slips": None}
        plane = {**bore, "name": "a | b", "kind": "plane", "normal": [1e4, 1e4], "capacity": [2e3, 2e3], "used": [0.1, 0.6]}
        return verdict({"converged": True, "tolerance": 1e-4, "contact_faces": [plane, bore]})

    assert told([0.0, 0.5])[-1] == "no shank bears in its hole"
    assert told([0.0, 50.0])[-1] == "bolt | plate (bore) bears from load step 2, with up to 50"
    assert told([0.0, 0.0])[0] == "nothing slips: of what friction can hold at most 60% is used, by a | b at load step 2"


def test_a_face_that_slips_and_could_hold_more_is_told_with_how_much():
    """On a slope just below the angle of friction a block slips a little everywhere, aslant, and goes nowhere."""
    plane = {"name": "a | b", "kind": "plane", "normal": [1.0], "capacity": [0.3], "used": [0.983],
             "slips": {"step": 1, "on": None, "before": None, "load": None, "at": None}}
    for used, rest in ((0.983, ", with 98% of what friction can hold"), (0.9999, "")):
        assert verdict({"converged": True, "contact_faces": [{**plane, "used": [used]}]}) == [f"a | b slips from load step 1{rest}"]
