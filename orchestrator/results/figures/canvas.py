"""Draws views off screen, by VTK.

Where neither a display, EGL nor OSMesa is to be had, VTK ends its process with a segmentation fault instead of an
error: only a process apart from the run may open a canvas (see ``artist``).
"""

from __future__ import annotations

import os

import numpy as np
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkLookupTable
from vtkmodules.vtkRenderingCore import (
    vtkActor,
    vtkLight,
    vtkPolyDataMapper,
    vtkRenderer,
    vtkRenderWindow,
    vtkWindowToImageFilter,
)
import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  what windows and mappers are made of

from orchestrator.results.figures.painting import UNKNOWN
from orchestrator.results.figures.surface import segments, triangulated
from orchestrator.results.figures.view import View

_AMBIENT, _DIFFUSE = 0.65, 0.38
_SHADES = 256  # of a palette
# colour, width in pixels of a picture of 1000, opacity
_LINES = {"lines": ((0.0, 0.0, 0.0), 1.1, 0.45), "outline": ((0.35, 0.35, 0.35), 1.3, 1.0)}


class Canvas:
    """A window that is never shown; opened once, for many pictures."""

    def __init__(self) -> None:
        if not os.environ.get("DISPLAY"):  # otherwise VTK tries X first and complains
            os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
        self._window, self._renderer = vtkRenderWindow(), vtkRenderer()
        self._window.OffScreenRenderingOn()
        self._window.SetMultiSamples(8)
        self._window.SetSize(16, 16)
        self._renderer.SetBackground(1.0, 1.0, 1.0)
        self._renderer.GetActiveCamera().ParallelProjectionOn()
        self._renderer.AutomaticLightCreationOff()
        self._window.AddRenderer(self._renderer)
        self._window.Render()  # opens the window, which takes longer than a drawing

    def draw(self, view: View) -> np.ndarray:
        """(rows, columns, 3) uint8."""
        renderer, camera = self._renderer, view.camera
        renderer.RemoveAllViewProps()
        renderer.RemoveAllLights()
        light = vtkLight()
        light.SetLightTypeToHeadlight()
        renderer.AddLight(light)
        self._window.SetSize(*view.pixels)
        renderer.AddActor(_surface(view))
        thick = max(1.0, view.pixels[0] / 1000)
        for name, (colour, width, opacity) in _LINES.items():
            if len(ends := getattr(view, name)):
                renderer.AddActor(_drawn(ends, colour, thick * width, opacity))
        eye = renderer.GetActiveCamera()
        eye.SetPosition(*(camera.focus + camera.height * camera.toward))
        eye.SetFocalPoint(*camera.focus)
        eye.SetViewUp(*camera.up)
        eye.SetParallelScale(0.5 * camera.height)
        renderer.ResetCameraClippingRange()
        shot = vtkWindowToImageFilter()
        shot.SetInput(self._window)
        shot.SetInputBufferTypeToRGB()
        shot.ReadFrontBufferOff()
        shot.Update()  # draws
        image = shot.GetOutput()
        columns, rows, _ = image.GetDimensions()
        return vtk_to_numpy(image.GetPointData().GetScalars()).reshape(rows, columns, -1)[::-1].copy()

    def close(self) -> None:
        """Gives the window back."""
        self._window.Finalize()


def _surface(view: View) -> vtkActor:
    data = triangulated(view.points, view.triangles)
    values = np.ascontiguousarray(view.values, dtype=float)
    data.GetPointData().SetScalars(numpy_to_vtk(values, deep=True))
    table = vtkLookupTable()
    table.SetNumberOfTableValues(_SHADES)
    for shade, colour in enumerate(view.palette(np.linspace(0.0, 1.0, _SHADES)).tolist()):
        table.SetTableValue(shade, *colour)
    table.SetNanColor(UNKNOWN, UNKNOWN, UNKNOWN, 1.0)
    mapper = vtkPolyDataMapper()
    mapper.SetInputData(data)
    mapper.SetLookupTable(table)
    mapper.SetScalarRange(*view.limits)
    mapper.InterpolateScalarsBeforeMappingOn()
    actor = vtkActor()
    actor.SetMapper(mapper)
    look = actor.GetProperty()
    look.SetBackfaceCulling(view.closed)  # what bodies hide themselves would cost as much again
    look.SetInterpolationToFlat()
    look.SetLighting(view.shaded)
    if view.shaded:
        look.SetAmbient(_AMBIENT)
        look.SetDiffuse(_DIFFUSE)
    return actor


def _drawn(ends: np.ndarray, colour: tuple[float, float, float], width: float, opacity: float) -> vtkActor:
    """Lines from (e, 2, 3) ends, a hair nearer than the faces they lie on."""
    mapper = vtkPolyDataMapper()
    mapper.SetInputData(segments(ends))
    mapper.SetResolveCoincidentTopologyToPolygonOffset()
    mapper.SetRelativeCoincidentTopologyLineOffsetParameters(-2.0, -2.0)
    actor = vtkActor()
    actor.SetMapper(mapper)
    look = actor.GetProperty()
    look.LightingOff()
    look.SetColor(*colour)
    look.SetLineWidth(width)
    look.SetOpacity(opacity)
    return actor
