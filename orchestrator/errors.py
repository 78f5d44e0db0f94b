"""The errors a user can meet, each with the exit code it ends the program with.

Every message says what was found, where, what was expected and how to mend it. Turns of phrase that
messages share are here too.
"""

from __future__ import annotations

import errno
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

# exit codes; the last is the shell's for an interrupt
CONVERGED, NOT_CONVERGED, BAD_INPUT, BLACKBOX_FAILED, INTERRUPTED = 0, 1, 2, 3, 130

KeyPath = tuple[str | int, ...]


def dotted(path: KeyPath) -> str:
    """Keys as they are written: boundary[1].on."""
    return "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in path).lstrip(".")


@dataclass(frozen=True)
class Problem:
    """One thing wrong with the input.

    path : keys of the YAML entry concerned, e.g. ``("boundary", 1, "on")``; empty when none is
    found : what was there
    expected : what would have been accepted
    cure : what to do about it
    file, line : where, once known (the configuration fills them in from ``path``)
    """

    path: KeyPath
    found: str
    expected: str
    cure: str = ""
    file: str = ""
    line: int | None = None

    def __str__(self) -> str:
        where = self.file + (f":{self.line}" if self.line is not None else "")
        head = ": ".join(filter(None, (where, dotted(self.path))))
        lines = [head] if head else []
        lines += [f"  found:    {self.found}", f"  expected: {self.expected}"]
        if self.cure:
            lines.append(f"  cure:     {self.cure}")
        return "\n".join(lines)


# How threads, shared libraries, gmsh and numba's compiler say that memory is wanting.
_WANTING = ("can't start new thread", "cannot allocate memory", "failed to map segment",
            "bad_alloc", "not enough memory")


def lacks_memory(error: BaseException | None) -> bool:
    """Whether memory was wanting, whoever noticed: said by the error, or by one that it was raised
    from.
    """
    while error is not None:
        if isinstance(error, MemoryError) or getattr(error, "errno", None) == errno.ENOMEM or (
                not isinstance(error, OrchestratorError)
                and any(words in str(error).lower() for words in _WANTING)):
            return True
        error = error.__cause__ or error.__context__
    return False


class OrchestratorError(Exception):
    """Base of all errors that end a run with a message instead of a traceback."""

    exit_code = NOT_CONVERGED


class InternalError(OrchestratorError):
    """Something that nobody has foreseen.

    what : the error, its kind first; where : the traceback is
    saved : whether there is something to resume from; memory : whether memory was wanting
    """

    def __init__(self, what: str, where: str, saved: bool, memory: bool):
        self._given = what, where, saved, memory
        if memory:
            self.exit_code = BLACKBOX_FAILED  # nothing is wrong with the method
        cure = (
            "there is too little memory: fewer load steps at once (method.increment), fewer "
            "workers, a coarser mesh, more ranks on more nodes, or a higher limit (ulimit "
            "-v)" if memory else
                "this is a fault of the program: please report it, with the file named above and "
                "the configuration")
        kept = "  kept:      what had been computed; --resume goes on from there\n" if saved else ""
        super().__init__(f"{what}\n  traceback: {where}\n{kept}  cure:      {cure}")

    def __reduce__(self):
        return InternalError, self._given


class InputError(OrchestratorError):
    """Bad configuration, mesh or output folder: everything found, at once."""

    exit_code = BAD_INPUT

    def __init__(self, problems: Problem | list[Problem]):
        self.problems = [problems] if isinstance(problems, Problem) else list(problems)
        super().__init__("\n".join(str(p) for p in self.problems))

    def __reduce__(self):
        return InputError, (self.problems,)  # errors travel between ranks


def wrong(path: KeyPath, found: str, expected: str, cure: str = "") -> InputError:
    """The error to raise for one problem."""
    return InputError(Problem(path, found, expected, cure))


@dataclass
class Problems:
    """Collects problems so that a user sees all of them in one go."""

    found: list[Problem] = field(default_factory=list)
    # sentences on what is no error but may be meant otherwise
    warnings: list[str] = field(default_factory=list)

    def add(self, path: KeyPath, found: str, expected: str, cure: str = "") -> None:
        self.found.append(Problem(tuple(path), found, expected, cure))

    def raise_if_any(self) -> None:
        """Raises InputError with all that was collected."""
        if self.found:
            raise InputError(self.found)


class BlackBoxError(OrchestratorError):
    """The black box died, hung or answered nonsense.

    what : what happened, in one sentence
    subdomain : name of the subdomain being worked on, if known
    exit_code_meaning : the code's own exit code explained, if it ended
    log_tail : last lines of the code's log
    """

    exit_code = BLACKBOX_FAILED

    def __init__(self, what: str, subdomain: str = "", exit_code_meaning: str = "",
                 log_tail: str = ""):
        self.what, self.subdomain = what, subdomain
        self.exit_code_meaning, self.log_tail = exit_code_meaning, log_tail
        self._given = what, subdomain, exit_code_meaning, log_tail
        parts = [what]
        if subdomain:
            parts.append(f"  subdomain: {subdomain}")
        if exit_code_meaning:
            parts.append(f"  exit code: {exit_code_meaning}")
        if log_tail:
            parts.append("  log tail:\n" + "\n".join("    | " + row
                                                     for row in log_tail.splitlines()))
        super().__init__("\n".join(parts))

    def __reduce__(self):
        return BlackBoxError, self._given


def told_from(where: str, error: BaseException) -> BaseException:
    """The error as others tell it: where it was met, another machine say, comes first."""
    if isinstance(error, InputError):
        return InputError([replace(problem, found=f"{where}: {problem.found}")
                           for problem in error.problems])
    if isinstance(error, BlackBoxError):
        what, *more = error._given
        return BlackBoxError(f"{where}: {what}", *more)
    return error


class Refusal(Exception):
    """A problem that the method does not solve as asked. It knows no keys of the YAML: ``refused``
    says where they are and what to do.

    cause : one of ``refused.CAUSES``
    facts : what its sentences name
    """

    def __init__(self, cause: str, **facts: object):
        super().__init__(
            f"{cause}: {', '.join(f'{name} {value}' for name, value in facts.items())}")
        self.cause, self.facts = cause, facts

    def __reduce__(self):
        return partial(Refusal, self.cause, **self.facts), ()


LITTLE = 0.01  # share of a whole whose lack, loss or error is passed over without a word
SHOWN, LISTED = 4, 50  # names in a sentence, rows of a table: more are told by their number
# What moves a terminal's cursor, colours it, or turns the order of what follows; not the end of a
# line.
_UNSEEN = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")


def visible(text: str) -> str:
    """The text with signs that a terminal would obey written as \\x1b: names come from files, and
    files from anybody.
    """
    return _UNSEEN.sub(lambda sign: sign[0].encode("unicode_escape").decode(), text)


def some(names: Sequence[str], shown: int = SHOWN) -> str:
    """The first of many names, and how many more there are."""
    return ", ".join(names[:shown]) + (f" and {len(names) - shown} more" if len(names) > shown
                                       else "")
