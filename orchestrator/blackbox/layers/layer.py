"""A black box around another one: what it does not do itself is left to the inner one."""

from __future__ import annotations


class Layer:
    """Base of layers that save the inner black box work.

    Parameters
    ----------
    inner : a black box
    """

    def __init__(self, inner):
        self.inner = inner

    def __getattr__(self, name: str):
        return getattr(self.inner, name)

    def __enter__(self):
        self.inner.__enter__()
        return self

    def __exit__(self, *exc) -> None:
        self.inner.__exit__(*exc)
