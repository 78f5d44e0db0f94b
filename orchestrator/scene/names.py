"""Finding things by name: shell wildcards and suggestions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from difflib import get_close_matches
from fnmatch import fnmatchcase

from orchestrator.config.parts import INSIDE


def matching(pattern: str, names: Iterable[str]) -> list[str]:
    """The names that equal the pattern or match it as a shell wildcard, in their order.

    The name of a part stands for all that is in it: base for base/rod.
    """
    inside = pattern + INSIDE + "*"
    return [name for name in names if name == pattern or fnmatchcase(name, pattern) or fnmatchcase(name, inside)]


def patterns_of(on: str | Iterable[str] | None) -> list[str]:
    """A name, a list of names, or nothing (everything) as a list of patterns."""
    if on is None:
        return ["*"]
    return [on] if isinstance(on, str) else list(on)


def suggestion(pattern: str, names: Iterable[str], what: str) -> str:
    """A sentence naming the nearest of the known names.

    Parameters
    ----------
    what : of what these are the names, in the singular ("surface")
    """
    names = list(dict.fromkeys(names))
    if not names:
        return f"the mesh has no named {what}"
    near = get_close_matches(pattern.strip("*?"), names, n=3, cutoff=0.5)
    shown = ", ".join(names[:12]) + (f", … ({len(names)} in all)" if len(names) > 12 else "")
    return (f"did you mean {' or '.join(near)}? " if near else "") + f"Known: {shown}"


def unique_names(names: list[str]) -> list[str]:
    """Repeated names numbered from 1: nut, bolt, nut → nut_1, bolt, nut_2."""
    count = Counter(names)
    taken, result, numbers = {name for name in names if count[name] == 1}, [], Counter[str]()
    for name in names:
        if count[name] > 1:
            numbers[name] += 1
            while f"{name}_{numbers[name]}" in taken:
                numbers[name] += 1
            name = f"{name}_{numbers[name]}"
            taken.add(name)
        result.append(name)
    return result
