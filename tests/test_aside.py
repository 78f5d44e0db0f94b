"""A scene that is put aside is empty while its parts are worked on, and then what it was; whatever happens."""

import numpy as np
import pytest
from ranks_case import CASES

from orchestrator.config.load import config_from
from orchestrator.scene.part import set_aside
from orchestrator.scene.build import build_scene


@pytest.mark.parametrize("case", ["perfect", "contact"])
def test_a_scene_comes_back(case):
    config = config_from({"name": "aside", **CASES[case]})
    scene, other = build_scene(config), build_scene(config)
    scene.sizes  # known already: it comes back too
    with pytest.raises(RuntimeError), set_aside(scene):
        assert not vars(scene)
        raise RuntimeError
    assert repr(scene) == repr(other) and (scene.mesh.nodes == other.mesh.nodes).all()
    assert all((a.free == b.free).all() and (a.cells == b.cells).all() for a, b in zip(scene.interfaces, other.interfaces))
    assert np.array_equal(scene.sizes, other.sizes)
    scene.mesh.nodes[0] += 1.0  # it is its owner's again
    assert (scene.mesh.nodes[0] == other.mesh.nodes[0] + 1.0).all()
    mesh = scene.mesh
    with set_aside(scene, wanted=False), set_aside(None):
        assert scene.mesh is mesh
