"""Every way a black box can fail, as a real fault: one clear error, and nothing left behind."""

import os
import resource
import shutil
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest
from quick import quick
from blackbox_case import box, forces, settings
from processes import begin, gone

from orchestrator import folders
from orchestrator.blackbox.start import make_blackbox
from orchestrator.blackbox.transport.worker import Worker
from orchestrator.errors import BlackBoxError, InputError

TRANSPORTS = ["pipe", "file"]


@pytest.fixture(autouse=True)
def temporary(tmp_path, monkeypatch):
    """A temporary folder of the test's own, which must be empty at its end."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    monkeypatch.setenv("TMPDIR", str(folder))
    yield folder
    assert list(folder.iterdir()) == []


def wrapper(folder: Path, body: str) -> str:
    """An executable that stands in front of FreeFEM; ``$REAL`` is FreeFEM, the last argument the replies' path."""
    path = folder.parent / "wrapped-freefem"
    path.write_text(f"#!/bin/bash\nREAL={shutil.which('FreeFem++')}\nREPLIES=${{@: -1}}\n{body}\n")
    path.chmod(0o755)
    return str(path)


# ---- faults of the process --------------------------------------------------------------------


def test_a_killed_process():
    models = [box(name="first"), box(name="second", seed=3)]
    with make_blackbox(settings(workers=2)) as blackbox:
        blackbox.load(models)
        pids = blackbox.usage.pids()
        os.kill(pids[blackbox.inner._home[1]], signal.SIGKILL)
        with pytest.raises(BlackBoxError) as caught:
            blackbox.traces({i: forces(m) for i, m in enumerate(models)})
        assert caught.value.subdomain == "second"
        assert "SIGKILL" in caught.value.exit_code_meaning
        assert caught.value.exit_code == 3
        assert gone(pids), "the other process must end too"
        with pytest.raises(BlackBoxError, match="ended after a failure"):
            blackbox.traces({0: forces(models[0])})


def test_a_process_that_hangs(monkeypatch):
    model = box(name="sleepy")
    with make_blackbox(settings()) as blackbox:
        blackbox.load([model])
        pids = blackbox.usage.pids()
        os.kill(pids[0], signal.SIGSTOP)
        monkeypatch.setattr(Worker, "deadline", lambda self: time.monotonic() + 0.3)  # what loading has is no matter of speed
        with pytest.raises(BlackBoxError, match="no answer within") as caught:
            blackbox.traces({0: forces(model)})
        assert caught.value.subdomain == "sleepy"
    assert gone(pids)


@pytest.mark.parametrize("transport", TRANSPORTS)
def test_a_hang_while_loading(temporary, monkeypatch, transport):
    monkeypatch.setenv("ORCHESTRATOR_FREEFEM", wrapper(temporary, "exec sleep 30"))
    with pytest.raises(BlackBoxError, match="no answer within"):
        with make_blackbox(settings(timeout=0.3, transport=transport)) as blackbox:
            blackbox.load([box()])


@pytest.mark.parametrize("transport", TRANSPORTS)
def test_a_reply_cut_short(temporary, monkeypatch, transport):
    scissors = {
        "pipe": '(dd bs=1 count=300 > "$REPLIES" 2> /dev/null; kill -KILL 0)',  # ends the whole group
        "file": 'head -c 300 > "$REPLIES"',  # ends with exit code 0
    }
    body = '"$REAL" "${@:1:$#-1}" /dev/stdout | ' + scissors[transport]
    monkeypatch.setenv("ORCHESTRATOR_FREEFEM", wrapper(temporary, body))
    model = box(name="cut")
    with make_blackbox(settings(transport=transport)) as blackbox:
        with pytest.raises(BlackBoxError, match="complete") as caught:
            blackbox.load([model])
            blackbox.traces({0: forces(model)})
        assert caught.value.subdomain == "cut"


@pytest.mark.parametrize("transport", TRANSPORTS)
def test_a_reply_of_rubbish(temporary, monkeypatch, transport):
    rubbish = r"""printf '\xff\xff\xff\xff\xff\xff\xff\xffrubbish' > "$REPLIES" """
    monkeypatch.setenv("ORCHESTRATOR_FREEFEM", wrapper(temporary, rubbish))
    with pytest.raises(BlackBoxError, match="an array of -1 entries"):
        with make_blackbox(settings(transport=transport)) as blackbox:
            blackbox.load([box()])


@pytest.mark.parametrize("transport", TRANSPORTS)
def test_an_executable_that_ends_at_once(temporary, monkeypatch, transport):
    monkeypatch.setenv("ORCHESTRATOR_FREEFEM", wrapper(temporary, "echo 'no licence today'; exit 8"))
    with pytest.raises(BlackBoxError) as caught:
        with make_blackbox(settings(transport=transport)) as blackbox:
            blackbox.load([box()])
    assert "runtime error" in caught.value.exit_code_meaning
    assert "no licence today" in caught.value.log_tail


# ---- faults of the models ---------------------------------------------------------------------


@pytest.mark.parametrize("transport", TRANSPORTS)
def test_an_inverted_tet(transport):
    model = box(name="inside out")
    model.cells[5] = model.cells[5][[1, 0, 2, 3]]
    with make_blackbox(settings(transport=transport)) as blackbox:
        with pytest.raises(BlackBoxError) as caught:
            blackbox.load([box(), model])
    assert caught.value.subdomain == "inside out"
    assert caught.value.exit_code_meaning.startswith("6:")
    assert caught.value.log_tail


@pytest.mark.parametrize("transport", TRANSPORTS)
@pytest.mark.parametrize("fault", ["free", "hinged", "no stiffness"])
def test_a_model_that_is_not_held(transport, fault):
    model = box(name="loose", hold=False)
    if fault == "hinged":
        model.fixed[:2] = True
    if fault == "no stiffness":
        model = box(name="loose")
        model.materials[:, 0] = 0.0
    with make_blackbox(settings(transport=transport)) as blackbox:
        with pytest.raises(BlackBoxError, match="singular") as caught:
            blackbox.load([box(), model])
    assert caught.value.subdomain == "loose"
    assert "not held" in str(caught.value)


@pytest.mark.parametrize("transport", TRANSPORTS)
def test_forces_that_are_not_finite(transport):
    models = [box(name="fine"), box(name="poisoned")]
    with make_blackbox(settings(transport=transport)) as blackbox:
        blackbox.load(models)
        f = {i: forces(m) for i, m in enumerate(models)}
        f[1][0, 0] = np.nan
        with pytest.raises(BlackBoxError, match="not finite") as caught:
            blackbox.traces(f)
    assert caught.value.subdomain == "poisoned"


def test_a_node_without_tet_is_the_callers_mistake():
    model = box()
    model.nodes = np.concatenate([model.nodes, [[9.0, 9, 9]]])
    model.fixed = np.concatenate([model.fixed, [[False] * 3]])
    with make_blackbox(settings()) as blackbox:
        with pytest.raises(ValueError, match="belongs to no tet"):
            blackbox.load([model])


# ---- faults of the installation and of the disk -------------------------------------------------


def test_freefem_is_missing(monkeypatch):
    monkeypatch.setenv("PATH", "")
    with pytest.raises(InputError, match="no FreeFem\\+\\+ in the path") as caught:
        make_blackbox(settings())
    assert caught.value.exit_code == 2
    assert "apt-get install freefem++" in str(caught.value)


def test_the_named_executable_is_missing(monkeypatch):
    monkeypatch.setenv("ORCHESTRATOR_FREEFEM", "/nowhere/FreeFem++")
    with pytest.raises(InputError, match="/nowhere/FreeFem"):
        make_blackbox(settings())


@pytest.mark.parametrize("transport", TRANSPORTS)
def test_plugins_are_missing_or_broken(tmp_path, monkeypatch, transport):
    monkeypatch.setenv("FF_LOADPATH", str(tmp_path))
    with pytest.raises(InputError, match="without its plugin") as caught:
        make_blackbox(settings(transport=transport))
    assert "libfreefem++" in str(caught.value)
    (tmp_path / "bfstream.so").write_bytes(b"not a library")
    with pytest.raises(InputError, match="without its plugin"):
        with make_blackbox(settings(transport=transport)) as blackbox:
            blackbox.load([box()])


def test_settings_that_do_not_exist():
    with pytest.raises(InputError) as caught:
        settings(code="abacus", transport="pigeon", workers=0)
    assert [problem.path for problem in caught.value.problems] == [("code",), ("transport",), ("workers",)]


@pytest.mark.parametrize("transport", TRANSPORTS)
def test_no_room_for_a_mesh(transport, temporary):
    with make_blackbox(settings(transport=transport)) as blackbox:
        limits = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (2000, limits[1]))
        try:
            with pytest.raises(InputError, match="MB in") as caught:
                blackbox.load([box()])
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert str(temporary) in str(caught.value) and "TMPDIR" in str(caught.value)


# ---- the end of the program ---------------------------------------------------------------------


def test_an_exception_of_the_callers(temporary):
    with pytest.raises(ZeroDivisionError):
        with make_blackbox(settings(workers=2)) as blackbox:
            blackbox.load([box()])
            pids = blackbox.usage.pids()
            assert list(temporary.iterdir())
            1 / 0
    assert gone(pids)
    blackbox.close()


PROGRAM = textwrap.dedent("""
    import sys
    sys.path[:0] = {paths!r}
    from blackbox_case import box, forces, settings
    from orchestrator.blackbox.start import make_blackbox
    model = box((6, 6, 6))
    blackbox = make_blackbox(settings(transport={transport!r}, workers=2))
    blackbox.load([model, model])
    print(*blackbox.usage.pids(), flush=True)
    while not {once}:
        blackbox.traces({{0: forces(model, 20), 1: forces(model, 20)}})
""")


def program(transport="pipe", once=False):
    """A program in the middle of its solves, and the pids of its FreeFEM processes."""
    paths = [str(Path(__file__).parent), str(Path(__file__).parents[1])]
    source = PROGRAM.format(paths=paths, transport=transport, once=once)
    child = begin(sys.executable, "-c", source, stderr=subprocess.DEVNULL)
    pids = [int(pid) for pid in child.stdout.readline().split()]
    return child, pids


@pytest.mark.parametrize("transport", TRANSPORTS)
@pytest.mark.parametrize("blow", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.long
def test_the_program_is_interrupted(blow, transport, temporary):
    child, pids = program(transport)
    time.sleep(0.1)
    child.send_signal(blow)
    assert child.wait(60) == -blow
    assert gone(pids) and gone(processes_in(temporary))


@pytest.mark.parametrize("transport", quick(TRANSPORTS, "pipe"))
def test_the_program_is_killed(transport, temporary):
    child, pids = program(transport)
    time.sleep(0.1)
    child.kill()
    child.wait(60)
    assert gone(pids) and gone(processes_in(temporary))
    assert list(temporary.iterdir()), "nobody was left to remove the folder"
    with make_blackbox(settings()):
        assert len(list(temporary.iterdir())) == 1, "the next one sweeps it"


@pytest.mark.long
def test_the_program_forgets_to_close(temporary):
    child, pids = program(once=True)
    assert child.wait(60) == 0
    assert gone(pids)


OWNER = """
import sys
from orchestrator import folders
if len(sys.argv) > 1:
    boot = folders.here()[1]
    folders.here = lambda: (sys.argv[1], boot)
print(folders.make(), flush=True)
sys.stdin.read()
"""


def owner(*host: str) -> tuple[subprocess.Popen, Path]:
    """Another process that holds a folder until its stdin is closed, perhaps in a container with a name of its own."""
    child = begin(sys.executable, "-c", OWNER, *host, stdin=subprocess.PIPE)
    return child, Path(child.stdout.readline().strip())


@pytest.mark.parametrize("host", [(), ("another_container",)], ids=["here", "another container"])
def test_folders_of_the_living_are_left_alone(temporary, host):
    """Those of another process live as long as it does, whatever its container is called; then they are swept."""
    mine = folders.make()
    child, theirs = owner(*host)
    assert theirs.parent == temporary and (not host or f"-{host[0]}-" in theirs.name)
    folders.sweep()
    assert mine.is_dir() and theirs.is_dir()
    child.kill()
    child.wait()
    folders.sweep()
    assert mine.is_dir() and not theirs.exists()
    folders.remove(mine)


def test_folders_of_other_hosts_are_left_alone(temporary):
    """Nobody can tell from here whether their owners live; a host that was started anew has no owner left."""
    host, boot = folders.here()
    foreign = temporary / f"orchestrator-{host}x-0123456789ab-1-abc"
    before = temporary / f"orchestrator-{host}-0123456789ab-1-abc"
    for path in (foreign, before):
        path.mkdir()
    folders.sweep()
    assert foreign.is_dir() and not before.exists()
    foreign.rmdir()


@pytest.mark.long
def test_whoever_sweeps_while_folders_are_made_takes_none(temporary):
    """Between its making and its lock a folder looks abandoned."""
    sweeping = begin(sys.executable, "-c", "from orchestrator import folders; import time\n"
                     "end = time.monotonic() + 2\nprint(flush=True)\nwhile time.monotonic() < end: folders.sweep()")
    sweeping.stdout.readline()
    made = [folders.make() for _ in range(300)]
    assert sweeping.wait(timeout=120) == 0
    assert all((path / "owner").exists() for path in made)
    for path in made:
        folders.remove(path)


def processes_in(folder: Path) -> list[int]:
    """Processes whose working directory is below a folder."""
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            if str(folder) in os.readlink(path / "cwd"):
                found.append(int(path.name))
        except OSError:
            pass
    return found
