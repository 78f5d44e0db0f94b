"""Draws triangulated surfaces with VTK, without a window; run as a program of its own.

    python offscreen.py < JOBS > PICTURES

Where neither a display nor EGL is to be had, VTK ends its process with a segmentation fault
instead of an error: a process apart keeps that away from the run. It imports nothing of the
orchestrator, and only the parts of VTK it needs, which halves the time to start. JOBS is a pickled
list of jobs (see ``draw``), PICTURES a pickled list of arrays.
"""

from __future__ import annotations

import os
import pickle
import resource
import sys

import numpy as np


def new_window() -> object:
    """An open window that is never shown."""
    import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  registers the renderer
    from vtkmodules.vtkRenderingCore import vtkRenderWindow

    window = vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetMultiSamples(8)
    window.Render()
    return window


def draw(job: dict[str, np.ndarray], window: object) -> np.ndarray:
    """Renders one picture in a window.

    Parameters
    ----------
    job : points (n, 3), triangles (k, 3), value (n,) in [0, 1], palette (c, 3) in [0, 1];
        lines (e, 2, 3) drawn dark on the surface, outline (e, 2, 3) drawn grey;
        focus, toward, up (3,), height (model units), pixels (2,) width and height, shaded bool

    Returns
    -------
    (rows, columns, 3) uint8
    """
    from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkLookupTable
    from vtkmodules.vtkRenderingCore import vtkRenderer, vtkWindowToImageFilter

    columns, rows = (int(p) for p in job["pixels"])
    table = vtkLookupTable()
    table.SetNumberOfTableValues(len(job["palette"]))
    for i, colour in enumerate(job["palette"]):
        table.SetTableValue(i, *colour, 1.0)
    table.SetRange(0.0, 1.0)

    renderer = vtkRenderer()
    renderer.SetBackground(1.0, 1.0, 1.0)
    surface, mapper = _actor(job["points"], job["triangles"], lines=False)
    values = numpy_to_vtk(np.ascontiguousarray(job["value"], float), deep=True)
    mapper.GetInput().GetPointData().SetScalars(values)
    mapper.SetLookupTable(table)
    mapper.SetScalarRange(0.0, 1.0)
    mapper.InterpolateScalarsBeforeMappingOn()
    surface.GetProperty().SetInterpolationToFlat()
    surface.GetProperty().SetAmbient(0.65)
    surface.GetProperty().SetDiffuse(0.38)
    surface.GetProperty().SetLighting(bool(job["shaded"]))
    renderer.AddActor(surface)
    scale = max(1.0, columns / 1000)
    for name, colour, width, opacity in (("lines", 0.0, 1.1, 0.45), ("outline", 0.35, 1.3, 1.0)):
        if len(job[name]):
            ends = job[name].reshape(-1, 3)
            actor, mapper = _actor(ends, np.arange(len(ends)).reshape(-1, 2), lines=True)
            # drawn a hair nearer than the faces they lie on
            mapper.SetResolveCoincidentTopologyToPolygonOffset()
            mapper.SetRelativeCoincidentTopologyLineOffsetParameters(-2.0, -2.0)
            actor.GetProperty().SetColor(colour, colour, colour)
            actor.GetProperty().SetLineWidth(width * scale)
            actor.GetProperty().SetOpacity(opacity)
            actor.GetProperty().LightingOff()
            renderer.AddActor(actor)

    camera = renderer.GetActiveCamera()
    camera.ParallelProjectionOn()
    camera.SetFocalPoint(*job["focus"])
    camera.SetPosition(*(job["focus"] + job["toward"] * float(job["height"])))
    camera.SetViewUp(*job["up"])
    camera.SetParallelScale(0.5 * float(job["height"]))
    renderer.ResetCameraClippingRange()

    window.SetSize(columns, rows)
    window.AddRenderer(renderer)
    window.Render()
    grab = vtkWindowToImageFilter()
    grab.SetInput(window)
    grab.ReadFrontBufferOff()
    grab.ShouldRerenderOff()  # it has just been rendered
    grab.Update()
    window.RemoveRenderer(renderer)
    pixels = vtk_to_numpy(grab.GetOutput().GetPointData().GetScalars())
    return pixels.reshape(rows, columns, 3)[::-1].copy()


def _actor(points: np.ndarray, cells: np.ndarray, lines: bool) -> tuple[object, object]:
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
    from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper

    coordinates, array, data = vtkPoints(), vtkCellArray(), vtkPolyData()
    coordinates.SetData(numpy_to_vtk(np.ascontiguousarray(points, float), deep=True))
    ids = np.ascontiguousarray(cells, np.int64)
    offsets = np.arange(0, ids.size + 1, ids.shape[1], dtype=np.int64)
    array.SetData(numpy_to_vtkIdTypeArray(offsets, deep=True), numpy_to_vtkIdTypeArray(ids.ravel(), deep=True))
    data.SetPoints(coordinates)
    data.SetLines(array) if lines else data.SetPolys(array)
    mapper, actor = vtkPolyDataMapper(), vtkActor()
    mapper.SetInputData(data)
    actor.SetMapper(mapper)
    return actor, mapper


def main() -> None:
    """Opens the window first: that takes longer than drawing, and there may be nothing to draw yet."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # its end is expected: no core dump
    answer = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print is no picture
    window = new_window()
    try:
        jobs = pickle.load(sys.stdin.buffer)
    except EOFError:  # nothing will be drawn
        return
    with answer:
        pickle.dump([draw(job, window) for job in jobs], answer, pickle.HIGHEST_PROTOCOL)


if __name__ == "__main__":
    main()
