"""The configuration: what is accepted, what it becomes, and every way to get it wrong."""

from pathlib import Path

import pytest

from orchestrator.config.load import KeyPlaces, load_config
from orchestrator.errors import BAD_INPUT, InputError, Problem

# Each block is one line of the file, so that tests can name the line by the key.
GOOD = {
    "name": "name: bar",
    "mesh": "mesh: {box: {size: [4, 1, 1], cells: [8, 2, 2]}}",
    "subdomains": "subdomains: {slices: {axis: x, count: 4}}",
    "materials": "materials: [{young: 200e3, poisson: 0.3}]",
    "boundary": "boundary: [{on: {plane: x, at: 0}, displacement: [0, 0, 0]}, {on: {plane: x, at: 4}, traction: [1, 0, 0]}]",
    "histories": "histories: {ramp: [0.5, 1.0]}",
    "loads": "loads: []",
    "interfaces": "interfaces: [{between: ['*', '*'], law: perfect}]",
    "method": "method: {relaxation: auto}",
    "blackbox": "blackbox: {workers: 2}",
    "output": "output: {fields: false}",
}
LINE = {key: line for line, key in enumerate(GOOD, start=1)}


@pytest.fixture
def write(tmp_path):
    """A function that writes the good configuration with some lines replaced and returns its path."""
    def writer(**changes: str) -> Path:
        path = tmp_path / "bar.yaml"
        path.write_text("\n".join({**GOOD, **changes}.values()) + "\n")
        return path
    return writer


def problems_of(path, overrides=()) -> list[Problem]:
    with pytest.raises(InputError) as caught:
        load_config(path, overrides)
    assert caught.value.exit_code == BAD_INPUT == 2
    return caught.value.problems


def materials(text: str) -> dict:
    return {"materials": f"materials: [{{{text}}}]"}


def boundary(text: str) -> dict:
    return {"boundary": f"boundary: [{text}]"}


HELD = "{on: {plane: x, at: 0}, displacement: [0, 0, 0]}"
WRONG = {  # what: (changed lines, key path, words of the message)
    "unknown key": (materials("yuong: 1, young: 1, poisson: 0.3"), ("materials", 0, "yuong"), "did you mean 'young'?"),
    "unknown top key": ({"method": "methods: {}"}, ("methods",), "did you mean 'method'?"),
    "unknown deep key": ({"method": "method: {sole: {modulus-ratio: 1}}"}, ("method", "sole", "modulus-ratio"),
                         "did you mean 'modulus_ratio'?"),
    "wrong type": (materials("young: stiff, poisson: 0.3"), ("materials", 0, "young"), "a number"),
    "text for number": ({"blackbox": "blackbox: {timeout: '600'}"}, ("blackbox", "timeout"), "a number"),
    "number for mapping": ({"method": "method: {sole: 3}"}, ("method", "sole"), "a mapping"),
    "list for mapping": ({"method": "method: [anderson]"}, ("method",), "a mapping"),
    "fraction for count": ({"subdomains": "subdomains: {metis: 2.5}"}, ("subdomains", "metis"), "a whole number"),
    "true for number": (materials("young: true, poisson: 0.3"), ("materials", 0, "young"), "a number"),
    "poisson 0.5": (materials("young: 1, poisson: 0.5"), ("materials", 0, "poisson"), "< 0.5"),
    "poisson -1": (materials("young: 1, poisson: -1"), ("materials", 0, "poisson"), "> -1"),
    "young 0": (materials("young: 0, poisson: 0.3"), ("materials", 0, "young"), "> 0"),
    "young negative": (materials("young: -2e5, poisson: 0.3"), ("materials", 0, "young"), "> 0"),
    "nan": (materials("young: .nan, poisson: 0.3"), ("materials", 0, "young"), "a finite number"),
    "infinity": (materials("young: .inf, poisson: 0.3"), ("materials", 0, "young"), "a finite number"),
    "overflow": (materials("young: 1e400, poisson: 0.3"), ("materials", 0, "young"), "a finite number"),
    "no materials": ({"materials": "materials: []"}, ("materials",), "at least 1 entry"),
    "missing key": (materials("young: 1"), ("materials", 0, "poisson"), "add poisson"),
    "friction negative": ({"interfaces": "interfaces: [{law: contact, friction: -0.1}]"}, ("interfaces", 0, "friction"), ">= 0"),
    "friction without contact": ({"interfaces": "interfaces: [{friction: 0.1}]"}, ("interfaces", 0, "friction"), "law: contact"),
    "jump without a jump": ({"interfaces": "interfaces: [{law: jump}]"}, ("interfaces", 0, "jump"), "three numbers"),
    "unknown law": ({"interfaces": "interfaces: [{law: contcat, friction: 0.1}]"}, ("interfaces", 0, "law"), "did you mean 'contact'?"),
    "within without geometry": ({"interfaces": "interfaces: [{law: contact, within: 1}]"}, ("interfaces", 0, "within"),
                                "gap: geometry only"),
    "a law's key misspelt": ({"interfaces": "interfaces: [{frction: 0.1}]"}, ("interfaces", 0, "frction"), "did you mean 'friction'?"),
    "between three": ({"interfaces": "interfaces: [{between: [a, b, c]}]"}, ("interfaces", 0, "between"), "names of two parts"),
    "relaxation 0": ({"method": "method: {relaxation: 0}"}, ("method", "relaxation"), "> 0"),
    "relaxation above 1": ({"method": "method: {relaxation: 1.2}"}, ("method", "relaxation"), "<= 1"),
    "auto misspelt": ({"method": "method: {relaxation: atuo}"}, ("method", "relaxation"), "auto, or a number > 0 and <= 1"),
    "unknown word": ({"method": "method: {acceleration: andersen}"}, ("method", "acceleration"), "did you mean 'anderson'?"),
    "memory beside gmres": ({"method": "method: {acceleration: gmres, memory: 5}"}, ("method", "memory"), "anderson only"),
    "memory beside none": ({"method": "method: {acceleration: none, memory: 5}"}, ("method", "memory"), "anderson only"),
    "kplus with contact": ({"method": "method: {search_direction: {kplus: full}}", "interfaces": "interfaces: [{law: contact}]"},
                           ("method", "search_direction", "kplus"), "remove kplus"),
    "no iterations": ({"method": "method: {max_iterations: 0}"}, ("method", "max_iterations"), ">= 1"),
    "tolerance 0": ({"method": "method: {tolerance: {error: 0}}"}, ("method", "tolerance", "error"), "> 0"),
    "two tolerances": ({"method": "method: {tolerance: {error: 1e-3, indicator: 1e-5}}"}, ("method", "tolerance", "indicator"),
                       "exactly one"),
    "no tolerance": ({"method": "method: {tolerance: {}}"}, ("method", "tolerance"), "exactly one"),
    "ratio too small": ({"method": "method: {sole: {modulus_ratio: 1e-4}}"}, ("method", "sole", "modulus_ratio"), "0.001 to 100"),
    "ratio too large": ({"method": "method: {sole: {modulus_ratio: 101}}"}, ("method", "sole", "modulus_ratio"), "0.001 to 100"),
    "ratio 0": ({"method": "method: {sole: {modulus_ratio: 0}}"}, ("method", "sole", "modulus_ratio"), "> 0"),
    "two sources": ({"mesh": "mesh: {beam: {size: [1, 1, 1], h: 1}, box: {size: [1, 1, 1], cells: [1, 1, 1]}}"}, ("mesh", "box"),
                    "beam and box together"),
    "no source": ({"mesh": "mesh: {scale: 2}"}, ("mesh",), "exactly one of them"),
    "no such mesh": ({"mesh": "mesh: {file: part.msh}"}, ("mesh", "file"), "part.msh"),
    "no such step": ({"mesh": "mesh: {step: part.stp, h: 1}"}, ("mesh", "step"), "part.stp"),
    "fraction beside a fixed error": ({"method": "method: {tolerance: {error: 1.0e-6, fraction: 0.1}}"},
                                      ("method", "tolerance", "fraction"), "fraction beside error: auto only"),
    "h without step": ({"mesh": "mesh: {box: {size: [1, 1, 1], cells: [1, 1, 1]}, h: 1}"}, ("mesh", "h"), "h beside step only"),
    "scale 0": ({"mesh": "mesh: {scale: 0, box: {size: [1, 1, 1], cells: [1, 1, 1]}}"}, ("mesh", "scale"), "> 0"),
    "cells 0": ({"mesh": "mesh: {box: {size: [1, 1, 1], cells: [1, 0, 1]}}"}, ("mesh", "box", "cells", 1), ">= 1"),
    "two numbers": ({"mesh": "mesh: {box: {size: [1, 1], cells: [1, 1, 1]}}"}, ("mesh", "box", "size"), "at least 3 entries"),
    "count 0": ({"subdomains": "subdomains: {slices: {axis: x, count: 0}}"}, ("subdomains", "slices", "count"), ">= 1"),
    "grid 0": ({"subdomains": "subdomains: {grid: [2, 0, 2]}"}, ("subdomains", "grid", 1), ">= 1"),
    "metis 0": ({"subdomains": "subdomains: {metis: 0}"}, ("subdomains", "metis"), ">= 1"),
    "two cuts": ({"subdomains": "subdomains: {metis: 4, grid: [2, 2, 2]}"}, ("subdomains", "grid"), "exactly one"),
    "unknown cut": ({"subdomains": "subdomains: grupos"}, ("subdomains",), "a mapping"),
    "axis": ({"subdomains": "subdomains: {slices: {axis: r, count: 2}}"}, ("subdomains", "slices", "axis"), "one of x, y, z"),
    "two conditions": (boundary("{on: a, displacement: [0, 0, 0], traction: [0, 0, 1]}"), ("boundary", 0, "traction"), "exactly one"),
    "no condition": (boundary("{on: a}"), ("boundary", 0), "exactly one"),
    "plane without at": (boundary("{on: {plane: x}, pressure: 1}"), ("boundary", 0, "on"), "plane and at together"),
    "plane and box": (boundary("{on: {plane: x, at: 0, box: [[0, 0, 0], [1, 1, 1]]}, pressure: 1}"), ("boundary", 0, "on"),
                      "or a box alone"),
    "box upside down": (boundary("{on: {box: [[0, 0, 2], [1, 1, 1]]}, pressure: 1}"), ("boundary", 0, "on", "box"), "lower corner first"),
    "on a number": (boundary("{on: 3, pressure: 1}"), ("boundary", 0, "on"), "surface group"),
    "two components": (boundary("{on: a, traction: [0, 1]}"), ("boundary", 0, "traction"), "three numbers"),
    "free traction": (boundary("{on: a, traction: [0, 1, null]}"), ("boundary", 0, "traction", 2), "a number"),
    "nothing prescribed": (boundary("{on: a, displacement: [null, null, null]}"), ("boundary", 0, "displacement"), "at least one number"),
    "sometimes free": (boundary("{on: a, displacement: [[0, 0, null], [0, 0, 1]]}"), ("boundary", 0, "displacement"), "component z"),
    "contradiction": (boundary(f"{HELD}, {{on: {{at: 0.0, plane: x}}, displacement: [null, 1, null]}}"), ("boundary", 1, "displacement"),
                      "boundary[0]"),
    "undefined history": (boundary("{on: a, pressure: 1, history: rmap}"), ("boundary", 0, "history"), "one of ramp"),
    "history and list": (boundary("{on: a, traction: [[0, 0, 1], [0, 0, 2]], history: ramp}"), ("boundary", 0, "history"),
                         "one of the two"),
    "lengths differ": (boundary("{on: a, pressure: 1, history: ramp}, {on: b, traction: [[0, 0, 1], [0, 0, 2], [0, 0, 3]]}"),
                       ("boundary", 1, "traction"), "2 load steps"),
    "empty history": ({"histories": "histories: {ramp: []}"}, ("histories", "ramp"), "at least 1 entry"),
    "history of a load": ({"loads": "loads: [{body_force: [0, 0, -1], history: up}]"}, ("loads", 0, "history"), "not defined"),
    "no grains": ({"mesh": "mesh: {polycrystal: {grains: 0, size: 1, h: 0.1}}"}, ("mesh", "polycrystal", "grains"), ">= 1"),
    "grains in two lengths": ({"mesh": "mesh: {polycrystal: {grains: 9, size: [1, 1], h: 0.1}}"}, ("mesh", "polycrystal", "size"),
                              "or three of them"),
    "grains of a word": ({"mesh": "mesh: {polycrystal: {grains: 9, size: big, h: 0.1}}"}, ("mesh", "polycrystal", "size"), "a number > 0"),
    "seed below 0": ({"mesh": "mesh: {polycrystal: {grains: 9, size: 1, h: 0.1, seed: -1}}"}, ("mesh", "polycrystal", "seed"), ">= 0"),
    "split_above": ({"subdomains": "subdomains: {groups: true, split_above: 11}"}, ("subdomains", "split_above"), ">= 12"),
    "split_above of a word": ({"subdomains": "subdomains: {groups: true, split_above: big}"}, ("subdomains", "split_above"), "auto"),
    "split_above alone": ({"subdomains": "subdomains: {metis: 2, split_above: 20}"}, ("subdomains", "split_above"), "beside groups only"),
    "stabilisation negative": ({"method": "method: {contact: {stabilisation: -1.0e-5}}", "interfaces": "interfaces: [{law: contact}]"},
                               ("method", "contact", "stabilisation"), ">= 0"),
    "stabilisation too strong": ({"method": "method: {contact: {stabilisation: 0.2}}", "interfaces": "interfaces: [{law: contact}]"},
                                 ("method", "contact", "stabilisation"), "<= 0.1"),
    "stabilisation of a word": ({"method": "method: {contact: {stabilisation: weak}}", "interfaces": "interfaces: [{law: contact}]"},
                                ("method", "contact", "stabilisation"), "a number from 0 to 0.1"),
    "stabilisation of joints": ({"method": "method: {contact: {stabilisation: 1.0e-5}}"}, ("method", "contact", "stabilisation"),
                                "may open or slide"),
    "gmres and contact": ({"method": "method: {acceleration: gmres}", "interfaces": "interfaces: [{law: contact}]"},
                          ("method", "acceleration"), "use anderson"),
    "other code": ({"blackbox": "blackbox: {code: aster}"}, ("blackbox", "code"), "freefem"),
    "name of a folder": ({"name": "name: ../bar"}, ("name",), "letters, digits"),
    "empty entry": ({"histories": "histories:"}, ("histories",), "a mapping"),
}


@pytest.mark.parametrize("changes, key, words", WRONG.values(), ids=WRONG)
def test_wrong_entry_names_key_line_and_cure(write, changes, key, words):
    path = write(**changes)
    problems = [p for p in problems_of(path) if p.path == key and words in str(p)]
    line = next(LINE[k] for k in LINE if changes.get(k, "").startswith(f"{key[0]}:"))
    assert [(p.file, p.line) for p in problems] == [(str(path), line)]
    assert problems[0].found and problems[0].expected and problems[0].cure


@pytest.mark.parametrize("text, line, words", [
    ("name: a\nname: b\n", 2, 'duplicate key "name"'),
    ('histories:\n  1: [1.0]\n  "1": [2.0]\n', 3, 'duplicate key "1", on lines 2 and 3'),
    ('histories: {true: [1.0], "true": [2.0]}\n', 1, 'duplicate key "true", on lines 1 and 1'),
    ('histories:\n  null: [1.0]\n\n  "null": [2.0]\n', 4, 'duplicate key "null", on lines 2 and 4'),
    ('a:\n  2026-01-01: 1\n  "2026-01-01": 2\n', 3, "duplicate key"),
    ("a: &a {x: 1}\nb: &b {x: 2}\nc:\n  <<: *a\n  <<: *b\n", 5, 'duplicate key "<<", on lines 4 and 5'),
    ("a: &k 1\nb: {1: 2, *k : 3}\n", 1, 'duplicate key "1"'),
    ("histories: {[a, b]: [1.0]}\n", 1, "a list or a mapping for a key"),
    ("name: a\nmesh: {box: [1, 2\nmethod: 1\n", 3, "correct YAML"),
    ("name: a\n\tmesh: 1\n", 2, "correct YAML"),
    ("", 1, "nothing"),
    ("# only a comment\n", 1, "nothing"),
    ("- a\n- b\n", 1, "a mapping"),
])
def test_file_that_is_no_configuration(tmp_path, text, line, words):
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    [problem] = problems_of(path)
    assert (problem.file, problem.line) == (str(path), line) and words in str(problem)


def test_missing_file_folder_and_binary_file(tmp_path):
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00")
    for path, words in ((tmp_path / "none.yaml", "no such file"), (tmp_path, "a folder"), (tmp_path / "binary.yaml", "UTF-8")):
        [problem] = problems_of(path)
        assert words in str(problem) and problem.file == str(path)


def test_missing_top_level_keys_are_all_reported(tmp_path):
    path = tmp_path / "short.yaml"
    path.write_text("name: a\n")
    assert {p.path for p in problems_of(path)} == {("mesh",), ("subdomains",), ("materials",), ("boundary",)}


def test_lines_are_those_of_nested_keys(tmp_path):
    path = tmp_path / "block.yaml"
    path.write_text("name: bar\nmesh:\n  box:\n    size: [4, 1, 1]\n    cells:\n      - 8\n      - 0\n      - 2\n"
                    "subdomains: groups\nmaterials:\n  - young: 1\n    poisson: 0.3\n  - young: -1\n    poisson: 0.7\n"
                    "    colour: red\nboundary: []\n")
    found = {p.path: p.line for p in problems_of(path)}
    assert found == {("mesh", "box", "cells", 1): 7, ("materials", 1, "young"): 13,
                     ("materials", 1, "poisson"): 14, ("materials", 1, "colour"): 15}


@pytest.mark.parametrize("text, value", [("1e-6", 1e-6), ("1.0e-6", 1e-6), (".5", 0.5), ("1E-3", 1e-3)])
def test_numbers_as_people_write_them(write, text, value):
    assert load_config(write(method=f"method: {{tolerance: {{error: {text}}}}}")).config.method.tolerance.error == value


def test_overrides(write):
    path = write(method="method: {tolerance: {error: 1e-6}}")
    config = load_config(path, ["method.tolerance.indicator=1e-5", "materials.0.young=1", "subdomains.metis=3",
                                "boundary.1.pressure=2", "boundary.1.on=top", "output.directory=there",
                                "method.sole.allow_extreme=true", "method.sole.modulus_ratio=1e-6"]).config
    assert config.method.tolerance.indicator == 1e-5 and config.method.tolerance.error is None
    assert config.materials[0].young == 1 and config.subdomains.metis == 3 and config.subdomains.slices is None
    assert config.boundary[1].pressure == 2 and config.boundary[1].on == "top" and config.output.directory == "there"
    assert config.method.sole.modulus_ratio == 1e-6
    assert load_config(path, ["subdomains=groups", "subdomains.metis=2"]).config.subdomains.metis == 2


@pytest.mark.parametrize("override, key, words", [
    ("method.relaxation=0", ("method", "relaxation"), "> 0"),
    ("mesh.beam={size: [1, 1, 1], h: 1}", ("mesh", "beam"), "exactly one of"),
    ("materials.5.young=1", ("materials", 5), "an index from 0 to 0"),
    ("materials.first.young=1", ("materials", "first"), "an index from 0 to 0"),
    ("method.sole.stiff=1", ("method", "sole", "stiff"), "unknown key"),
    ("method.relaxation", (), "key=value"),
    ("=3", (), "key=value"),
    ("name=[1", (), "correct YAML"),
])
def test_problems_of_overrides_show_the_override(write, override, key, words):
    [problem] = problems_of(write(), [override])
    assert problem.path == key and problem.file == f"--set {override}" and words in str(problem)


def test_a_default_is_not_blamed_on_an_override_beside_it():
    """As when a run resumes from a folder that only the name of the configuration says; what an override left out is."""
    source = KeyPlaces("it.yaml", {}, {("output", "fields"): "output.fields=false", ("mesh", "box", "size"): "mesh.box.size=[1,1,1]"})
    assert source.locate(("output", "directory")) == ("it.yaml", 1)
    assert source.locate(("mesh", "box", "cells")) == ("--set mesh.box.size=[1,1,1]", None)
