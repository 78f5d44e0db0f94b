"""The command line: exit codes, messages on stderr, and what it hands to the rooms."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest
from processes import begin, gone, running
from yaml_case import call

from orchestrator import cli
from orchestrator.errors import BlackBoxError, InputError, Problem

ROOT = Path(__file__).parents[1]
BEAM = str(ROOT / "configs" / "traction_beam.yaml")


@pytest.fixture
def room(monkeypatch):
    """A function that puts a stand-in with the given contents in the place of a module."""
    def stand_in(name: str, **contents) -> None:
        module = ModuleType(name)
        vars(module).update(contents)
        monkeypatch.setitem(sys.modules, name, module)
    return stand_in


@pytest.mark.long
def test_bad_configuration_from_the_shell():
    done = subprocess.run([sys.executable, "-m", "orchestrator", "check", BEAM, "--set", "materials.0.poisson=0.5",
                           "--set", "method.relaxtion=1"], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 2 and done.stdout == "" and "Traceback" not in done.stderr
    assert done.stderr.startswith("2 problems in the input")
    assert "--set materials.0.poisson=0.5: materials[0].poisson" in done.stderr
    assert "did you mean 'relaxation'?" in done.stderr


@pytest.mark.parametrize("command", ["check", "run"])
def test_file_and_line_are_shown(tmp_path, command):
    path = tmp_path / "bad.yaml"
    path.write_text(Path(BEAM).read_text().replace("young: 200e3", "young: -1"))
    line = next(i for i, text in enumerate(path.read_text().splitlines(), 1) if "young" in text)
    done = call(command, str(path))
    assert done.exit_code == 2
    assert f"{path}:{line}: materials[0].young\n  found:    -1\n  expected: a number > 0\n" in done.stderr


def test_missing_configuration():
    done = call("run", "nowhere.yaml")
    assert done.exit_code == 2 and "nowhere.yaml\n  found:    no such file" in done.stderr


def test_check_shows_the_scene_or_its_problems():
    done = call("check", BEAM, "--set", "mesh.beam.h=5")
    assert done.exit_code == 0 and done.stdout.startswith("OK") and "32 subdomains" in done.stdout

    done = call("check", BEAM, "--set", "mesh.beam.h=5", "--set", "boundary.1.on.at=161")
    line = next(i for i, text in enumerate(Path(BEAM).read_text().splitlines(), 1) if "at: 160" in text)
    assert done.exit_code == 2 and f"{BEAM}:{line}: boundary[1].on\n  found:    no boundary face lies on the plane x = 161" in done.stderr


@pytest.mark.parametrize("change, words", [
    ("interfaces=[{law: contact, friction: 20}]", "with friction 20: above 1, which few surfaces have"),
    ("output.units={length: m, force: N}", "young: 200000 is 0.0002 GPa with units N and m"),
    ("boundary.1={on: xmin, traction: [1, 0, 0]}", "goes straight into the support and moves nothing"),
    ("boundary.1={on: xmax, displacement: [0, 0, 0]}", "nothing loads the scene"),
    ("output={directory: out}", "units: extent 160 × 10 × 10; a modulus of 200000 looks like N/mm², so that lengths are in mm, and then is 200 GPa")])
def test_check_tells_what_hardly_is_meant(change, words):
    done = call("check", BEAM, "--set", "mesh.beam.h=5", "--set", "subdomains.slices.count=2", "--set", change)
    assert done.exit_code == 0 and words in " ".join(done.stdout.split()), done.stdout


def test_check_refuses_an_element_that_the_code_does_not_have(tmp_path):
    """With the words of ``run``."""
    own = ["--set", "blackbox.code=calculix", "--set", "blackbox.element=P2", "--set", "mesh.beam.h=5"]
    checked, started = call("check", BEAM, *own), call("run", BEAM, *own, "--output", str(tmp_path))
    assert checked.exit_code == started.exit_code == 2 and checked.stdout == ""
    assert "blackbox.element\n  found:    \"P2\"\n  expected: P1" in checked.stderr
    assert checked.stderr == started.stderr


MEANS = {"Means": lambda *given, verbose: given, "Ranks": lambda team: team}  # what a stand-in for ``orchestrator.run`` has beside ``run``


@pytest.mark.parametrize("error, code, words", [
    (BlackBoxError("FreeFEM died", "slice 3", "8: runtime error", "last words"), 3, "subdomain: slice 3"),
    (KeyboardInterrupt(), 130, "Interrupted"),
    (InputError(Problem(("output", "directory"), "read only", "a writable folder")), 2, f"{BEAM}:"),
])
def test_errors_of_a_run_become_exit_codes(room, error, code, words):
    def run(loaded, **options):
        raise error

    room("orchestrator.run", run=run, **MEANS)
    done = call("run", BEAM)
    assert done.exit_code == code and words in done.stderr and "Traceback" not in done.stderr


def test_what_tests_start_hears_interrupts():
    """Also where a script has started the tests in the background, which makes them and their children deaf."""
    child = "import signal; print(signal.getsignal(signal.SIGINT) is signal.default_int_handler)"
    deaf = ("import signal, sys; signal.signal(signal.SIGINT, signal.SIG_IGN); sys.path.insert(0, sys.argv[1])\n"
            "import conftest, processes; print(processes.begin(sys.executable, '-c', sys.argv[2]).communicate()[0])")
    done = subprocess.run([sys.executable, "-c", deaf, str(ROOT / "tests"), child], capture_output=True, text=True)
    assert done.stdout.strip() == "True"


def test_what_tests_start_ends_with_them():
    """Also where they are killed: nothing of theirs goes on for ever."""
    program = ("import sys, time; sys.path.insert(0, sys.argv[1]); import processes\n"
               "print(processes.begin('sleep', '1000').pid, flush=True); time.sleep(1000)")
    tests = begin(sys.executable, "-c", program, str(ROOT / "tests"))
    pid = int(tests.stdout.readline())
    assert running(pid)
    tests.kill()
    assert gone([pid])


def test_sigterm_interrupts_in_order(room):
    room("orchestrator.run", run=lambda loaded, **options: os.kill(os.getpid(), signal.SIGTERM) or 0, **MEANS)
    before = signal.getsignal(signal.SIGTERM)
    assert call("run", BEAM).exit_code == 130
    assert signal.getsignal(signal.SIGTERM) is before


def test_doctor(monkeypatch):
    """What every run needs and is missing ends with exit code 2; other codes are optional."""
    monkeypatch.setattr(cli, "compiled_once", lambda: "loops of contact: compiled")  # that takes as long as twenty of these tests
    whole = call("doctor")
    assert whole.exit_code == 0 and "FreeFEM: /" in whole.stdout and "calculix: 2" in whole.stdout
    monkeypatch.setenv("ORCHESTRATOR_CALCULIX", "/nowhere/ccx")
    lacking = call("doctor")
    assert lacking.exit_code == 0 and "no calculix (optional): apt-get install calculix-ccx" in lacking.stdout
    monkeypatch.setenv("ORCHESTRATOR_FREEFEM", "/nowhere/FreeFem++")
    broken = call("doctor")
    assert broken.exit_code == 2 and "missing FreeFEM: apt-get install freefem++" in broken.stdout
