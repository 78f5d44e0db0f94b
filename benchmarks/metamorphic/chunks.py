"""Scenes by the number of their seed: the same on every machine, and found again alone."""

from __future__ import annotations

import random
from typing import Any, NamedTuple

from hypothesis import HealthCheck, Phase, given, seed, settings

from benchmarks.metamorphic.ordinary import ordinary
from benchmarks.metamorphic.relations import DOORS, RELATIONS
from benchmarks.metamorphic.scenes import scenes

EXAMPLES = 25  # drawn per seed; of those that hypothesis makes of each other, one is kept
# Those that have something to say of ordinary scenes, some of whose parts are no boxes.
SUITED = ["turned by quarters", "turned askew", "other units", "sides swapped", "solved otherwise", "solved roughly", "in two sittings",
          "batched", "step repeated", "reordered", "cancelled"]
CODES = ["in-process"] * 7 + ["freefem"] * 2 + ["scikit-fem"]


class Trial(NamedTuple):
    """A scene, its features and the relations to try on it; number: of the seed, and which of its scenes."""

    number: tuple[int, int]
    data: dict[str, Any]
    words: list[str]
    relations: list[str]

    @property
    def drawn(self) -> int:
        """What relations draw with."""
        return 1000 * self.number[0] + self.number[1]


def chunk(number: int, relations: int = 3) -> list[Trial]:
    """The scenes of one seed: an even one's are ordinary, an odd one's over all features."""
    drawn: list[tuple[dict, list[str]]] = []

    @seed(number)
    @settings(max_examples=EXAMPLES, database=None, phases=[Phase.generate], deadline=None, suppress_health_check=list(HealthCheck))
    @given(scenes() if number % 2 else ordinary())
    def draw(scene):
        drawn.append(scene)

    draw()
    kept: dict[tuple, tuple[dict, list[str]]] = {}
    for data, words in drawn:
        kept.setdefault((*(p["name"] for p in data["parts"]), *([] if number % 2 else words)), (data, words))
    return [_trial((number, index), *scene, relations) for index, scene in enumerate(kept.values())]


def _trial(number: tuple[int, int], data: dict, words: list[str], count: int) -> Trial:
    chosen = random.Random(number[0] * 1000 + number[1])
    code = chosen.choice(CODES)
    if "blackbox" not in data or "form" not in data["blackbox"]:
        data = {**data, "blackbox": {"code": code, "workers": 1, **({"element": "P2"} if "P2" in words else {})}}
    kinds = [word for word in words if word.startswith("kind ")]
    relations = chosen.sample(SUITED if kinds else [name for name in RELATIONS if name not in DOORS], count)
    if "kind symmetry" in kinds:
        relations.append("mirrored")
    if not kinds and chosen.random() < 0.5:
        relations.append(chosen.choice(list(DOORS)))
    return Trial(number, data, [*words, f"code {data['blackbox']['code']}"], relations)
