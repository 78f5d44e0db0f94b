"""Variants of a configuration that are asked for, and their names."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product
from math import prod
from typing import Any

from orchestrator.config.paths import parse, shown
from orchestrator.config.text import parse_yaml
from orchestrator.errors import wrong

LONGEST = 60  # signs in the name of a variant
MOST = 10_000  # variants; a product of a few lists is soon more than anybody waits for


@dataclass(frozen=True)
class Variant:
    """One of the configurations of a sweep.

    name : of its folder
    values : key, as it was written → value
    """

    name: str
    values: dict[str, Any] = field(default_factory=dict)

    @property
    def overrides(self) -> list[str]:
        """Overrides as for ``load_config``."""
        return [f"{key}={json.dumps(value)}" for key, value in self.values.items()]

    @property
    def title(self) -> str:
        """Keys and values in words."""
        return ", ".join(f"{key} = {shown(value)}" for key, value in self.values.items())


def variants_of(asked: Sequence[str], zipped: bool = False) -> list[Variant]:
    """All variants, in the order of the values, the last key's changing fastest.

    asked : texts ``key=value,value,…``, values in YAML
    zipped : the first values together, then the second …; else every combination

    Raises InputError: no values, a key twice, lists of different lengths, a variant twice

    >>> [variant.name for variant in variants_of(["bolts.0.force=5e3,1e4"])]
    ['force=5000', 'force=10000']
    """
    if not asked:
        raise wrong((), "a sweep without --vary", "what is to vary",
                    "add --vary KEY=VALUE,VALUE, such as --vary bolts.0.force=5e3,1e4")
    varied: dict[str, list[Any]] = {}
    for text in asked:
        key, values = _read(text)
        if key in varied:
            raise wrong((), f"--vary {text}: {key} is varied already", "every key once",
                        "give all its values at once, with commas")
        varied[key] = values
    counts = {key: len(values) for key, values in varied.items()}
    if zipped and len(set(counts.values())) > 1:
        raise wrong((),
                    "--zip with " + ", ".join(f"{count} values of {key}"
                                              for key, count in counts.items()),
                    "as many values of each",
                    "leave --zip out for every combination")
    if not zipped and (count := prod(counts.values())) > MOST:
        raise wrong((), f"{count:,} combinations", f"at most {MOST:,}",
                    "vary fewer values, or together, by --zip")
    sets = list(zip(*varied.values()) if zipped else product(*varied.values()))
    names = _named([dict(zip(_labels(list(varied)), values)) for values in sets])
    found = [Variant(name, dict(zip(varied, values))) for name, values in zip(names, sets)]
    if twice := [variant.title for i, variant in enumerate(found)
                 if any(variant.values == other.values for other in found[:i])]:
        raise wrong((), f"twice {twice[0]}", "every variant once", "leave one of them out")
    return found


def _read(text: str) -> tuple[str, list[Any]]:
    """Key and values of one ``--vary``."""
    _, values = parse(text, lambda value: parse_yaml(f"[{value}]", f"--vary {text}")[0])
    if not values:
        raise wrong((), f"--vary {text}", "at least one value", "write KEY=VALUE,VALUE")
    return text.partition("=")[0].strip(), values


def _labels(keys: list[str]) -> list[str]:
    """The shortest ends of the keys that tell them apart."""
    for count in range(1, max(key.count(".") for key in keys) + 2):
        labels = [".".join(key.split(".")[-count:]) for key in keys]
        if len(set(labels)) == len(labels):
            return labels
    return keys


def _named(sets: list[dict[str, Any]]) -> list[str]:
    """Names for folders; those that are too long, or alike once they are fit for a folder, are
    numbers.
    """
    names = [
        re.sub(r"[^\w.,+=-]+", "_",
               ",".join(f"{label}={shown(value)}" for label, value in values.items()))
        for values in sets]
    plain = [len(name) <= LONGEST and names.count(name) == 1 for name in names]
    return [name if fit else f"variant_{number:03d}"
            for number, (name, fit) in enumerate(zip(names, plain), 1)]
