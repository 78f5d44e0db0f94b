"""What the method refuses to solve. It knows no keys of the YAML: ``orchestrator.refused`` says where they are and what to do."""

from __future__ import annotations


class Refusal(Exception):
    """A problem that cannot be solved as it is asked.

    cause : one of ``refused.CAUSES``
    facts : what its sentences name
    """

    def __init__(self, cause: str, **facts: object):
        super().__init__(f"{cause}: {', '.join(f'{name} {value}' for name, value in facts.items())}")
        self.cause, self.facts = cause, facts

    def __reduce__(self):
        return _again, (self.cause, self.facts)


def _again(cause: str, facts: dict[str, object]) -> Refusal:
    return Refusal(cause, **facts)
