"""Turns of phrase that messages of several rooms share."""

from __future__ import annotations

import re
from collections.abc import Sequence

SHOWN = 4  # names in a sentence
# What moves a terminal's cursor, colours it, or turns the order of what follows; not the end of a line.
_UNSEEN = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")


def visible(text: str) -> str:
    """The text with signs that a terminal would obey written as \\x1b: names come from files, and files from anybody."""
    return _UNSEEN.sub(lambda sign: sign[0].encode("unicode_escape").decode(), text)


def some(names: Sequence[str], shown: int = SHOWN) -> str:
    """The first of many names, and how many more there are."""
    return ", ".join(names[:shown]) + (f" and {len(names) - shown} more" if len(names) > shown else "")
