"""Finding things by name: shell wildcards and suggestions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from fnmatch import fnmatchcase

from orchestrator.errors import KeyPath, Problems, some

# In names of what is in a part, between the part's and its own: base/rod, base/zmin.
INSIDE = "/"


def matching(pattern: str, names: Iterable[str]) -> list[str]:
    """The names that a pattern means, in their order.

    A name means itself, whatever characters it has; else what is in the part of that name: base for
    base/rod. What is neither is a shell wildcard, with which parts stand for what is in them, too.
    A lone * means everything.

    names : all that there are: among fewer, a name that is not there would be taken for a wildcard
    """
    names = list(names)
    if pattern == "*":
        return names
    inside = pattern + INSIDE
    return [name for name in names if name == pattern] or [name for name in names
                                                           if name.startswith(inside)] or \
        [name for name in names if fnmatchcase(name, pattern) or fnmatchcase(name, inside + "*")]


def patterns_of(on: str | Iterable[str] | None) -> list[str]:
    """A name, a list of names, or nothing (everything) as a list of patterns."""
    if on is None:
        return ["*"]
    return [on] if isinstance(on, str) else list(on)


def suggestion(pattern: str, names: Iterable[str], what: str) -> str:
    """A sentence naming the nearest of the known names.

    what : of what these are the names, in the singular ("surface")
    """
    names = list(dict.fromkeys(names))
    if not names:
        return f"the mesh has no named {what}"
    near = get_close_matches(pattern.strip("*?"), names, n=3, cutoff=0.5)
    shown = ", ".join(names[:12]) + (f", … ({len(names)} in all)" if len(names) > 12 else "")
    return (f"did you mean {' or '.join(near)}? " if near else "") + f"Known: {shown}"


def renamed(names: list[str], rename: Mapping[str, str] | None, path: KeyPath) -> list[str]:
    """The names, those that ``rename`` has as it says.

    path : of ``rename`` in the YAML
    Raises InputError: names that there are not, or two of one name afterwards
    """
    problems = Problems()
    for name in rename or {}:
        if name not in names:
            problems.add((*path, name), f"no volume is called {name!r}",
                         "names as inspect lists them", suggestion(name, names, "volume"))
    made = [(rename or {}).get(name, name) for name in names]
    if twice := [name for name, count in Counter(made).items() if count > 1]:
        problems.add(path, f"several volumes called {some(twice)}", "a name for each",
                     "give them different names")
    problems.raise_if_any()
    return made


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
