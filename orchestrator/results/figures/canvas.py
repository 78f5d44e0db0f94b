"""Draws views off screen, by pyvista.

Where neither a display, EGL nor OSMesa is to be had, VTK ends its process with a segmentation fault instead of an error: only a
process apart from the run may draw here (see ``artist``).
"""

from __future__ import annotations

import os
from functools import cache

import numpy as np
import pyvista

from orchestrator.results.figures.view import WIDTH, View

UNKNOWN = (0.75, 0.75, 0.75)  # of what has no value
# colour, width in pixels of a picture of 1000, opacity
_LINES = {"lines": ("black", 1.1, 0.45), "outline": ("#595959", 1.3, 1.0)}


@cache
def _window() -> pyvista.Plotter:
    """A window that is never shown, for all pictures of this process: to open it takes longer than to draw."""
    if not os.environ.get("DISPLAY"):  # otherwise VTK tries X first and complains
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    plotter = pyvista.Plotter(off_screen=True, lighting="none", window_size=(16, 16), theme=pyvista.themes.DocumentTheme())
    plotter.enable_anti_aliasing("msaa", multi_samples=8)
    plotter.add_light(pyvista.Light(light_type="headlight"))
    plotter.enable_parallel_projection()
    plotter.show(auto_close=False)
    return plotter


def draw(view: View, inches: float = WIDTH) -> np.ndarray:
    """(rows, columns, 3) uint8, the picture of a view in a width."""
    plotter, camera, pixels = _window(), view.camera, view.pixels(inches)
    plotter.clear_actors()
    plotter.render_window.SetSize(*pixels)
    plotter.add_mesh(
        pyvista.PolyData.from_regular_faces(view.points, view.triangles), scalars=np.asarray(view.values, float), cmap=view.palette,
        clim=view.limits, nan_color=UNKNOWN, interpolate_before_map=True, show_scalar_bar=False, lighting=view.shaded,
        ambient=0.65 if view.shaded else 1.0, diffuse=0.38 * view.shaded, culling="back" if view.closed else None,
        reset_camera=False, render=False)
    for name, (colour, width, opacity) in _LINES.items():
        if len(ends := getattr(view, name)):
            actor = plotter.add_mesh(pyvista.line_segments_from_points(ends.reshape(-1, 3)), color=colour, opacity=opacity, lighting=False,
                                     line_width=max(1.0, pixels[0] / 1000) * width, reset_camera=False, render=False)
            actor.mapper.resolve = "polygon_offset"  # a hair nearer than the faces they lie on
            actor.mapper.SetRelativeCoincidentTopologyLineOffsetParameters(-2.0, -2.0)
    plotter.camera.position = camera.focus + camera.height * camera.toward
    plotter.camera.focal_point = camera.focus
    plotter.camera.up = camera.up
    plotter.camera.parallel_scale = 0.5 * camera.height
    plotter.reset_camera_clipping_range()
    plotter.render()
    return plotter.screenshot(return_img=True)
