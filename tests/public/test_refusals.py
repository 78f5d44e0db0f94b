"""Bad input: exit code 2, one message with file and line, what was found, expected, and a cure."""

import pytest
from helpers import call

LINES = {
    "name": "name: bar",
    "mesh": "mesh: {box: {size: [4, 1, 1], cells: [8, 2, 2]}}",
    "subdomains": "subdomains: {slices: {axis: x, count: 4}}",
    "materials": "materials: [{young: 200e3, poisson: 0.3}]",
    "held": "boundary: [{on: {plane: x, at: 0}, displacement: [0, 0, 0]},",
    "loaded": "  {on: {plane: x, at: 4}, traction: [1, 0, 0]}]",
    "interfaces": "interfaces: [{between: ['*', '*'], law: perfect}]",
    "method": "method: {tolerance: {error: 1e-3}}",
    "blackbox": "blackbox: {code: freefem}",
    "output": "output: {fields: false, figures: false}",
}
WRONG = {  # what is wrong: the line that is changed, what stands there, a word of the message
    "a misspelt key": ("method", "method: {tolerence: {error: 1e-3}}", "did you mean 'tolerance'"),
    "a word for a number": ("materials", "materials: [{young: stiff, poisson: 0.3}]", "a number"),
    "a decimal comma": ("materials", "materials: [{young: 1, poisson: 0,3}]", "write poisson: 0.3"),
    "incompressible": ("materials", "materials: [{young: 1, poisson: 0.5}]", "< 0.5"),
    "no such face": ("loaded", "  {on: xmaks, traction: [1, 0, 0]}]", "did you mean xmax"),
    "a plane outside": ("loaded", "  {on: {plane: x, at: 5}, traction: [1, 0, 0]}]", "x = 5"),
    "two components": ("loaded", "  {on: xmax, traction: [1, 0]}]", "three numbers"),
    "no such history": ("loaded", "  {on: xmax, pressure: 1, history: up}]", "'up'"),
    "contradiction": ("loaded", "  {on: xmin, displacement: [0, 0, 1]}]", "contradict"),
    "free to move": ("held", "boundary: [{on: xmin, displacement: [0, null, null]},", "rigid body"),
    "no such mesh": ("mesh", "mesh: {file: none.msh}", "none.msh"),
    "too many slices": ("subdomains", "subdomains: {slices: {axis: x, count: 50}}",
                        "without any tet"),
    "no such law": ("interfaces", "interfaces: [{law: glued}]", "glued"),
    "no such part": ("interfaces", "interfaces: [{between: ['bolt*', '*'], law: perfect}]", "bolt"),
    "friction below 0": ("interfaces", "interfaces: [{law: contact, friction: -1}]", ">= 0"),
    "no such code": ("blackbox", "blackbox: {code: abacus}", "abacus"),
    "below rounding": ("method", "method: {tolerance: {error: 1e-11}}", "rounding alone"),
}


@pytest.mark.parametrize("command", ["run", "check"])
@pytest.mark.parametrize("what", WRONG)
def test_refused_with_file_and_line(what, command, tmp_path, monkeypatch):
    changed, text, word = WRONG[what]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bar.yaml").write_text("\n".join({**LINES, changed: text}.values()))
    done = call(command, "bar.yaml")
    told = " ".join(done.err.split())
    assert done.code == 2 and "Traceback" not in told
    assert f"bar.yaml:{1 + list(LINES).index(changed)}" in told, told
    assert word in told and all(part in told for part in ("found:", "expected:", "cure:")), told


def test_all_problems_at_once(tmp_path):
    """Each with its line, in the order of the file."""
    path = tmp_path / "bar.yaml"
    lines = {**LINES,
             **{key: text for key, text, _ in (WRONG["incompressible"], WRONG["no such law"])}}
    path.write_text("\n".join(lines.values()))
    done = call("check", path)
    places = [done.err.find(f"bar.yaml:{1 + list(LINES).index(key)}") for key in ("materials",
                                                                                  "interfaces")]
    assert done.code == 2 and 0 < places[0] < places[1], done.err


def test_an_override_is_named(tmp_path):
    path = tmp_path / "bar.yaml"
    path.write_text("\n".join(LINES.values()))
    done = call("check", path, "--set", "method.max_iterations=0")
    assert done.code == 2 and "--set method.max_iterations=0" in done.err, done.err
