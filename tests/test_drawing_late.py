"""Figures hold up neither a run nor its end: fields and summary come first, and who draws is not waited for for ever."""

import json
import os
import signal
import threading
import time

import pytest
from in_process import IN_PROCESS
from method_case import config
from processes import gone

from orchestrator.config.load import Loaded
from orchestrator.results.figures import artist as artists
from orchestrator.results.figures.artist import Artist
from orchestrator.run import run

BAR = {"blackbox": IN_PROCESS, "output": {"fields": True, "figures": True}}


@pytest.fixture
def stopped(monkeypatch, request):
    """Those who draw stand still; a parameter says for how long they are waited for."""
    made = []

    class Still(Artist):
        def __init__(self):
            super().__init__()
            made.append(self._process.pid)
            os.kill(self._process.pid, signal.SIGSTOP)

        def finish(self):
            return super().finish(getattr(request, "param", 300.0))

    monkeypatch.setattr(artists, "Artist", Still)
    yield
    assert made and gone(made)


@pytest.mark.long
@pytest.mark.parametrize("stopped", [0.5], indirect=True)
def test_a_process_that_stands_still_is_given_up(tmp_path, stopped):
    """Exit code, fields and summary are those of the run, charts are drawn here; the summary says what is missing, and how to get it."""
    assert run(Loaded(config(**BAR)), output=tmp_path, quiet=True) == 0
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["converged"] and (tmp_path / "fields.npz").exists()
    assert "no pictures of the structure: the process that draws was not done after 0.5 s" in summary["warnings"][-1]
    assert f"orchestrator report {tmp_path} draws them" in summary["warnings"][-1]
    assert not (tmp_path / "checkpoint").exists()
    assert sorted(path.name for path in tmp_path.glob("figures/*")) == ["convergence.png", "time.png"]


def test_while_it_is_waited_for_all_else_is_there(tmp_path, stopped):
    """An interrupt then ends the run at once, and what has been computed stays as it is."""
    def interrupt():
        end = time.monotonic() + 60
        while not (tmp_path / "summary.json").exists() and time.monotonic() < end:
            time.sleep(0.01)
        time.sleep(0.5)
        os.kill(os.getpid(), signal.SIGINT)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    sender = threading.Thread(target=interrupt, daemon=True)
    sender.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            run(Loaded(config(**BAR)), output=tmp_path, quiet=True)
    finally:
        sender.join()
        signal.signal(signal.SIGINT, before)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["converged"] and summary["stop_reason"] == "converged" and (tmp_path / "fields.npz").exists()
