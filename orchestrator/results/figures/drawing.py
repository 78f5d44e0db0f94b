"""Pictures drawn by VTK in another process, see ``offscreen``."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from threading import Thread

import numpy as np

from orchestrator.results.figures.deformed import DPI, View

_PROGRAM = Path(__file__).with_name("offscreen.py")
_PATIENCE = 120.0  # seconds after which the drawing process is given up


class Drawing:
    """VTK, made ready in a process of its own, which draws while this one does something else."""

    def __init__(self) -> None:
        environment = dict(os.environ)
        if not environment.get("DISPLAY"):  # otherwise VTK tries X first and complains
            environment.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
        self._process: subprocess.Popen[bytes] | None = None
        self._pictures: list[np.ndarray] | None = None
        try:
            self._process = subprocess.Popen([sys.executable, "-P", str(_PROGRAM)], env=environment,
                                             stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        except OSError:  # matplotlib needs no process
            pass

    def begin(self, views: Sequence[View]) -> Drawing:
        """Hands over what is to be drawn; returns this drawing."""
        work = pickle.dumps([_job(view) for view in views], pickle.HIGHEST_PROTOCOL)
        self._thread = Thread(target=self._draw, args=[work], daemon=True)
        self._thread.start()
        return self

    def finish(self) -> list[np.ndarray] | None:
        """(rows, columns, 3) uint8 each, or None when VTK could not draw here."""
        self._thread.join()
        return self._pictures

    def _draw(self, work: bytes) -> None:
        if self._process is None:
            return
        try:
            answer, _ = self._process.communicate(work, timeout=_PATIENCE)
            if self._process.returncode == 0:
                self._pictures = pickle.loads(answer)
        except (subprocess.TimeoutExpired, OSError):
            pass
        finally:
            self.close()

    def close(self) -> None:
        """Ends the process if it still runs."""
        if self._process is not None:
            self._process.kill()
            self._process.communicate()


def _job(view: View) -> dict[str, object]:
    """What ``offscreen`` needs to know of a view."""
    camera, (low, high), columns = view.camera, view.limits, int(view.inches * DPI)
    return dict(points=view.points, triangles=view.triangles, palette=view.palette,
                value=np.clip((view.stress - low) / (high - low), 0, 1), lines=view.lines,
                outline=view.outline, focus=camera.focus, toward=camera.toward, up=camera.up,
                height=camera.height, shaded=view.shaded,
                pixels=(columns, round(columns * camera.height / camera.width)))
