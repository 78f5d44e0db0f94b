"""Bodies of different moduli in contact: a contrast costs no iterations, whichever side is softer."""

import numpy as np
import pytest
from contact_case import BOTTOM, TOP, contact, converged, two_boxes, written

from orchestrator.scene.build import build_scene
from orchestrator.scene.soles.facets import facets_of

CONTRAST, FACTOR = 1000.0, 1.3
PATH = [[0.0, 0.0, -0.005], [0.01, 0.0, -0.005], [-0.005, 0.0, -0.005]]


@pytest.fixture(scope="module")
def boxes(tmp_path_factory):
    return written(tmp_path_factory.mktemp("boxes") / "boxes.msh", two_boxes())


def blocks(boxes, lower, upper, **law):
    """Two irregularly meshed blocks, pressed and sheared both ways."""
    return contact(0.2, error=1e-6, mesh=boxes, subdomains="groups", **law, boundary=[BOTTOM, {"on": TOP, "displacement": PATH}],
                   materials=[{"young": lower, "poisson": 0.3}, {"young": upper, "poisson": 0.3, "on": "upper"}])


def test_contrast_costs_no_iterations(boxes):
    """Soles of the larger modulus would take nine times as many."""
    equal, *others = (converged(blocks(boxes, *moduli)).iterations for moduli in (
        (200e3, 200e3), (200e3 / CONTRAST, 200e3), (200e3, 200e3 / CONTRAST)))
    assert max(others) <= FACTOR * equal, (equal, others)


def test_sides_that_deform_as_one_keep_the_larger_modulus(boxes):
    """Bonded, or with a jump that is given whatever the force."""
    for law, modulus in (("perfect", 1000.0), ("jump", 1000.0), ("contact", (2 / (1 + CONTRAST**-0.5)) ** 2)):
        made = blocks(boxes, 1.0, CONTRAST, law=[{"law": law, **({"jump": [0, 0, 0.001]} if law == "jump" else {})}])
        scene = build_scene(made)
        facets = facets_of(scene, scene.interfaces[0], made.method.sole.model_copy(
            update={"modulus_ratio": 1.0, "contact_ratio": 1.0}), "layer")
        reach = (0.5 ** (1 / 3) * facets.thickness) ** 0.5  # of bodies of half a unit of volume
        ratio = 1.0 if law == "perfect" else (facets.thickness / reach)[facets.triangles].mean(axis=1)
        assert np.allclose(facets.young / ratio, modulus, rtol=1e-12), law
