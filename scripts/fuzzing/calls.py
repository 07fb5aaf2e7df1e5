"""Calls: chosen by numbers alone, made, and judged."""

from __future__ import annotations

import contextlib
import inspect
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from itertools import islice
from typing import Any

import numpy as np

from baxter_kin import BaxterError
from fuzzing.hostile import FILLER, HOSTILE
from fuzzing.stage import Stage
from fuzzing.targets import Target, properties_of
from fuzzing.values import valid_value

VALID = "valid"

HOSTILE_COUNTS, HOSTILE_SHARES = (1, 2, 100), (0.7, 0.2, 0.1)
"""How many arguments of a call are hostile, and how often; 100 stands for all."""

OMITTED = 0.6
"""Share of the arguments with a default that are left to it."""

WRONG_CALLS = 0.02
"""Share of the calls that lack an argument, or have one too many."""

LONGEST_MESSAGE = 3_000
"""A message says what came in 200 characters, and what is allowed, which may be a list of names."""

QUOTED = 200

READ = 3
"""How many results are taken of an iterator."""


class Verdict(str, Enum):
    """What came of a call."""

    RETURNED = "returned"
    REFUSED = "refused"
    NOT_CALLED = "TypeError at the call"
    OTHER = "other"


@dataclass(frozen=True, slots=True)
class Call:
    """A call before it is made.

    Attributes:
        target: what is called.
        arguments: by the name of each parameter that of its value; those that are missing keep
            their default.
        is_crooked: whether an argument comes that nobody asked for.
    """

    target: Target
    arguments: dict[str, str]
    is_crooked: bool

    def __str__(self) -> str:
        given = [f"{name}=<{value}>" for name, value in self.arguments.items()]
        extra = ["surprise=5"] if self.is_crooked else []
        return f"{self.target.name}({', '.join([*given, *extra])})"


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a call.

    Attributes:
        verdict: in a word.
        error: the class of what was raised; empty when nothing was.
        text: the last line of the traceback and where it was raised; empty unless it is a fault.
    """

    verdict: Verdict
    error: str = ""
    text: str = ""


def chosen(targets: tuple[Target, ...], seed: int, number: int) -> Call:
    """The call of that number: the same for the same seed, whatever was called before."""
    rng = np.random.default_rng([seed, number])
    target = targets[int(rng.integers(len(targets)))]
    names = [parameter.name for parameter in target.parameters]
    count = int(rng.choice(HOSTILE_COUNTS, p=HOSTILE_SHARES))
    hostile = set(rng.permutation(names)[:count].tolist()) if names else set()
    labels = list(HOSTILE)
    arguments = {}
    for parameter in target.parameters:
        is_needed = parameter.default is parameter.empty
        if parameter.name in hostile:
            arguments[parameter.name] = labels[int(rng.integers(len(labels)))]
        elif is_needed or rng.random() > OMITTED:
            arguments[parameter.name] = VALID
    is_crooked = bool(names) and rng.random() < WRONG_CALLS
    if is_crooked and rng.random() < 0.5:
        arguments.pop(names[0], None)
        return Call(target, arguments, is_crooked=False)
    return Call(target, arguments, is_crooked)


@dataclass(frozen=True, slots=True)
class Prepared:
    """A call with all that it needs.

    Attributes:
        function: what to call; without arguments, what to read.
        several: positional arguments.
        given: named ones.
    """

    function: Callable[..., Any]
    several: tuple[Any, ...]
    given: dict[str, Any]

    @classmethod
    def of(cls, call: Call, stage: Stage) -> Prepared:
        """Make the objects."""
        target, given, several = call.target, dict[str, Any](), []
        for parameter in target.parameters:
            if parameter.name in call.arguments:
                value = _value(call, parameter, stage)
                if parameter.kind is parameter.VAR_POSITIONAL:
                    several.append(value)
                else:
                    given[parameter.name] = value
        if call.is_crooked:
            given["surprise"] = 5
        if target.owner is None:
            return cls(target.function, tuple(several), given)
        receiver = stage[target.owner.__name__]
        if target.function is None:
            return cls(lambda: getattr(receiver, target.attribute), (), {})
        return cls(getattr(receiver, target.attribute), tuple(several), given)


def made(prepared: Prepared) -> Outcome:
    """Make the call; of what it returns, read everything that can be read."""
    try:
        _read(prepared.function(*prepared.several, **prepared.given))
    except BaxterError as error:
        return _refused(error)
    except Exception as error:  # whatever comes is what is looked for
        return _unexpected(error)
    return Outcome(Verdict.RETURNED)


def _value(call: Call, parameter: inspect.Parameter, stage: Stage) -> Any:
    label = call.arguments[parameter.name]
    return valid_value(call.target, parameter, stage) if label == VALID else HOSTILE[label]()


def _read(found: Any) -> None:
    """Use what was returned: an object that exists is valid."""
    if isinstance(found, Iterator):
        for _ in islice(found, READ):
            pass
    elif type(found).__module__.startswith(("baxter_kin", "planner", "sim")):
        for name in properties_of(type(found)):
            getattr(found, name)
        repr(found)
        str(found)


def _refused(error: BaxterError) -> Outcome:
    name, message = type(error).__name__, str(error)
    with contextlib.suppress(UnicodeEncodeError):
        message.encode()
        if len(message) <= LONGEST_MESSAGE and FILLER * (QUOTED + 1) not in message:
            return Outcome(Verdict.REFUSED, name)
    shown = message[:QUOTED].encode("unicode_escape").decode()
    text = f"a message of {len(message)} characters, or one that cannot be printed: {shown}"
    return Outcome(Verdict.OTHER, name, f"{text} ({_place(error)})")


def _unexpected(error: Exception) -> Outcome:
    frames = traceback.extract_tb(error.__traceback__)
    if isinstance(error, TypeError) and len(frames) == 1:
        return Outcome(Verdict.NOT_CALLED, "TypeError")
    message = str(error)[:QUOTED].encode("unicode_escape").decode()
    return Outcome(Verdict.OTHER, type(error).__name__, f"{message} ({_place(error)})")


def _place(error: Exception) -> str:
    """Where in the toolkit it was raised: file, line and function."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [f for f in frames if "site-packages" not in f.filename and "fuzzing" not in f.filename]
    last = (ours or frames)[-1]
    return f"{'/'.join(last.filename.split('/')[-2:])}:{last.lineno}, {last.name}"
