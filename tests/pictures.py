"""What pictures show: figures are kept as they are saved, so that a test sees their curves and bars, and their pixels."""

import csv

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image


@pytest.fixture
def saved_figures(monkeypatch) -> list[Figure]:
    """All figures saved in a test, in their order."""
    found, save = [], Figure.savefig

    def savefig(figure, *arguments, **options):
        found.append(figure)
        return save(figure, *arguments, **options)

    monkeypatch.setattr(Figure, "savefig", savefig)
    return found


def pixels(path) -> np.ndarray:
    """(height, width, 3), 0 to 255."""
    return np.asarray(Image.open(path).convert("RGB"), float)


def is_drawn(path, figure: Figure) -> bool:
    """Whether a file holds a figure: as large, on a light ground, and not blank."""
    found = pixels(path)
    inches = np.array(found.shape[1::-1]) / figure.get_size_inches()
    return inches[0] == pytest.approx(inches[1], rel=0.01) and found.std() > 5 and np.median(found) == 255


def shows_matter(path) -> bool:
    """Whether a part of a picture is shaded in many colours, as bodies are and lines and text are not."""
    found = pixels(path)
    coloured = found[np.ptp(found, axis=2) > 40]
    return len(coloured) > 0.02 * found[..., 0].size and len(np.unique(coloured.round(-1), axis=0)) > 20


def share(picture: np.ndarray, colour: str, within: float = 12) -> float:
    """Of all pixels of a picture (height, width, 3), how many have a colour."""
    return float((np.abs(picture.astype(float) - 255 * np.array(to_rgb(colour))).max(axis=2) < within).mean())


def bars(figure: Figure) -> list[float]:
    """Lengths of all bars, in the order they were drawn."""
    return [float(value) for axes in figure.axes for container in axes.containers for value in container.datavalues]


def points(figure: Figure) -> np.ndarray:
    """(n, 2) data of all lines and markers."""
    return np.concatenate([np.column_stack(line.get_data()) for axes in figure.axes for line in axes.lines
                           if len(line.get_xdata())])


def missing_curves(figure: Figure, table, quantity: str) -> list[str]:
    """Cases of a study's curves.csv whose values of a quantity are no curve in the figure."""
    drawn = [np.asarray(line.get_ydata(), float) for axes in figure.axes for line in axes.lines]
    with open(table, encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    missing = []
    for case in dict.fromkeys(row["case"] for row in rows):
        values = np.array([float(row[quantity] or "nan") for row in rows if row["case"] == case])
        values = values[np.isfinite(values) & (values > 0)]
        if not any(len(y) == len(values) and np.allclose(y, values, rtol=1e-5, atol=0) for y in drawn):
            missing.append(case)
    return missing


def missing_points(figure: Figure, wanted) -> list[tuple[float, float]]:
    """Those of some points (x, y) that are not in the figure."""
    drawn = points(figure)
    return [(x, y) for x, y in wanted if not np.isclose(drawn, [x, y], rtol=1e-5, atol=0).all(axis=1).any()]
