"""Draws views off screen: VTK through pyvista.

Where neither a display, EGL nor OSMesa is to be had, VTK ends its process with a segmentation fault instead of an
error: only a process apart from the run may open a canvas (see ``artist``).
"""

from __future__ import annotations

import os

import numpy as np
import pyvista

from orchestrator.results.figures.view import View

_LIGHT = dict(ambient=0.65, diffuse=0.38)
_LINES = {"lines": dict(color="black", line_width=1.1, opacity=0.45),
          "outline": dict(color=(0.35, 0.35, 0.35), line_width=1.3)}


class Canvas:
    """A window that is never shown; opened once, for many pictures."""

    def __init__(self) -> None:
        if not os.environ.get("DISPLAY"):  # otherwise VTK tries X first and complains
            os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
        self._plotter = pyvista.Plotter(off_screen=True, lighting="none", window_size=[16, 16])
        self._plotter.background_color = "white"
        self._plotter.enable_anti_aliasing("msaa", multi_samples=8)
        self._plotter.enable_parallel_projection()
        self._plotter.screenshot(return_img=True)  # opens the window, which takes longer than a drawing

    def draw(self, view: View) -> np.ndarray:
        """(rows, columns, 3) uint8."""
        plotter, camera = self._plotter, view.camera
        plotter.clear()
        plotter.render_window.SetSize(*view.pixels)  # as an attribute of the plotter, it would draw at once
        plotter.add_light(pyvista.Light(light_type="headlight"))
        plotter.add_mesh(pyvista.PolyData.from_regular_faces(view.points, view.triangles), scalars=view.values,
                         cmap=view.palette, clim=view.limits, show_scalar_bar=False, interpolate_before_map=True,
                         lighting=view.shaded, render=False, **(_LIGHT if view.shaded else {}))
        thick = max(1.0, view.pixels[0] / 1000)
        for name, look in _LINES.items():
            if len(ends := getattr(view, name)):
                segments = pyvista.line_segments_from_points(ends.reshape(-1, 3))
                actor = plotter.add_mesh(segments, lighting=False, render=False,
                                         **look | {"line_width": thick * look["line_width"]})
                # drawn a hair nearer than the faces they lie on
                actor.mapper.SetResolveCoincidentTopologyToPolygonOffset()
                actor.mapper.SetRelativeCoincidentTopologyLineOffsetParameters(-2.0, -2.0)
        eye = plotter.camera
        eye.position, eye.focal_point, eye.up = camera.focus + camera.height * camera.toward, camera.focus, camera.up
        eye.parallel_scale = 0.5 * camera.height
        plotter.reset_camera_clipping_range()
        plotter.render()
        return plotter.screenshot(return_img=True)

    def close(self) -> None:
        """Gives the window back."""
        self._plotter.close()
