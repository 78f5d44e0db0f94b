"""A part that is a box of bricks, for tests of several parts."""

from collections.abc import Sequence


def boxed(name: str, size: Sequence[float] = (1, 1, 1), cells: Sequence[int] = (2, 2, 2), at: Sequence[float] | None = None, **more: object) -> dict:
    """An entry of ``parts``; ``at``: its lowest corner, the origin unless told otherwise."""
    return {"name": name, "mesh": {"box": {"size": list(size), "cells": list(cells)}}, **({"move": {"translate": list(at)}} if at else {}), **more}
