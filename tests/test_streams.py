"""Standard streams that are closed, full or of another alphabet, and interrupts that come during imports: real processes."""

import json
import os
import subprocess
import sys

import pytest
from test_bad_input import GOOD
from quick import quick

PATIENCE = 120  # seconds


@pytest.fixture
def bar(tmp_path):
    path = tmp_path / "bär.yaml"
    path.write_text("\n".join({**GOOD, "name": "name: bär"}.values()) + "\n", encoding="utf-8")
    return path


def shell(line, *arguments, **environment):
    """The program as ``$0``, with redirections as a shell makes them."""
    program = f'"{sys.executable}" -m orchestrator '
    return subprocess.run(["sh", "-c", program + line, "sh", *map(str, arguments)], capture_output=True, text=True,
                          timeout=PATIENCE, env={**os.environ, **environment})


@pytest.mark.parametrize("redirection, told", [(">&-", ""), (">&- 2>&- <&-", ""), ("2>/dev/full >/dev/full", ""),
                                               (">/dev/full", "No space left on device"), ("2>&1 | true", None)])
@pytest.mark.long
def test_a_run_needs_nobody_who_listens(bar, redirection, told):
    """Its results are whole, its exit code is its own; where that can be said, it is said that words were lost."""
    done = shell(f'run "$1" --output "$2" {redirection}', bar, bar.parent / "out")
    assert done.returncode == 0 and "Traceback" not in done.stderr and "Exception" not in done.stderr, done.stderr
    assert told is None or (told in done.stderr and bool(told) == bool(done.stderr)), done.stderr
    assert json.loads((bar.parent / "out" / "summary.json").read_text())["converged"]


def test_verdicts_keep_their_exit_code(bar):
    assert shell('check "$1" 2>/dev/full', bar.parent / "none.yaml").returncode == 2


@pytest.mark.parametrize("environment", [{"PYTHONIOENCODING": "ascii"},
                                         {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}], ids=["io", "locale"])
@pytest.mark.long
def test_alphabets_that_lack_signs(bar, environment):
    """They are written by their numbers."""
    done = shell('check "$1"', bar, **environment)
    assert (done.returncode, done.stderr) == (0, "") and r"b\xe4r" in done.stdout
    missing = shell('check "$1"', bar.parent / "fehlt-ä.yaml", **environment)
    assert missing.returncode == 2 and "no such file" in missing.stderr and "Traceback" not in missing.stderr


SWALLOWS = """import os, signal, time
try:
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(0.1)
except BaseException:
    pass
"""


def test_an_interrupt_during_an_import_is_not_lost(tmp_path):
    """A library that swallows all exceptions while it is imported: the interrupt comes right after."""
    (tmp_path / "swallows.py").write_text(SWALLOWS)
    program = ("import signal, time; from orchestrator.ending import interrupt\n"
               "signal.signal(signal.SIGINT, interrupt)\n"
               "try:\n    import swallows\n    time.sleep(60)\nexcept KeyboardInterrupt:\n    print('heard')")
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=50,
                          env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])})
    assert done.stdout == "heard\n", done.stderr


@pytest.mark.parametrize("library", quick(["typer", "gmsh"], "typer"))
def test_an_interrupt_while_the_program_starts_ends_it_with_130(bar, tmp_path, library):
    """Whichever library is being imported when Ctrl-C comes; the signal comes from the import itself, so it cannot miss."""
    (tmp_path / "sitecustomize.py").write_text(
        "import os, signal, sys\n"
        "class Finder:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        f"        if name == {library!r}:\n"
        "            sys.meta_path.remove(self)\n"
        "            os.kill(os.getpid(), signal.SIGINT)\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "sys.meta_path.insert(0, Finder())\n")
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    bar.write_text(bar.read_text(encoding="utf-8").replace("box: {size: [4, 1, 1], cells: [8, 2, 2]}",
                                                           "step: 'gmsh:step_header_data.stp'"), encoding="utf-8")
    done = shell('check "$1"', bar, PYTHONPATH=path)
    assert done.returncode == 130 and "Traceback" not in done.stderr, (done.returncode, done.stdout, done.stderr)


def test_an_interrupt_before_the_command_has_begun():
    """After the imports, before anything waits for it."""
    program = ("import os, signal, orchestrator.__main__, orchestrator.cli\n"
               "orchestrator.cli.main = lambda: os.kill(os.getpid(), signal.SIGINT)\n"
               "orchestrator.__main__.main()")
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=PATIENCE)
    assert (done.returncode, done.stderr) == (130, "Interrupted.\n")
