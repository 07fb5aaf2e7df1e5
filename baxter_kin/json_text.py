"""JSON as text: strict in what is read, and written so that it can be compared."""

from __future__ import annotations

import json
import math
from collections import Counter
from typing import Any, TypeAlias

from baxter_kin.display import MAX_NAME, quoted, shortened
from baxter_kin.errors import BaxterError

Json: TypeAlias = "bool | int | float | str | list[Json] | dict[str, Json] | None"

LONGEST_INTEGER = 15
"""Digits of an integer; every such number is an exact float."""


class UnfitError(BaxterError):
    """What is wrong with data, to be said after its name."""


def as_text(data: Json, error: type[BaxterError]) -> str:
    """JSON on one line, ASCII, without needless spaces."""
    try:
        return json.dumps(data, allow_nan=False, separators=(",", ":"))
    except ValueError as cause:
        raise error(f"cannot be kept: {cause}") from cause


def as_lines(data: Json, indent: str = "\n") -> str:
    """JSON with a row of numbers to a line, so that files can be read and compared."""
    deeper = f"{indent} "
    if isinstance(data, dict) and data:
        lines = [f"{json.dumps(key)}: {as_lines(item, deeper)}" for key, item in data.items()]
        return f"{{{deeper}{f',{deeper}'.join(lines)}{indent}}}"
    if isinstance(data, list) and any(isinstance(item, (list, dict)) for item in data):
        lines = [as_lines(item, deeper) for item in data]
        return f"[{deeper}{f',{deeper}'.join(lines)}{indent}]"
    return json.dumps(data, allow_nan=False)


def from_text(text: str | bytes, error: type[BaxterError]) -> Json:
    """The data that JSON says, as text or in UTF-8."""
    hooks: dict[str, Any] = {"parse_float": _finite, "parse_constant": _finite, "parse_int": _short}
    try:
        whole = text if isinstance(text, str) else text.decode()
        data: Json = json.loads(whole, object_pairs_hook=_without_duplicates, **hooks)
    except RecursionError:
        raise error("is nested too deeply") from None
    except UnfitError as cause:
        raise error(str(cause)) from None
    except ValueError as cause:  # of the JSON, or of its UTF-8
        what = "is no complete JSON, so it is truncated, damaged or another kind of file"
        raise error(f"{what}: {cause}") from None
    return data


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise UnfitError(f"has {shortened(text, MAX_NAME)} where a finite number must be")
    return number


def _short(text: str) -> int:
    if len(text.lstrip("-")) > LONGEST_INTEGER:
        raise UnfitError(f"has an integer too large: {quoted(text, MAX_NAME)}")
    return int(text)


def _without_duplicates(pairs: list[tuple[str, Json]]) -> dict[str, Json]:
    entries = dict(pairs)
    if len(entries) < len(pairs):
        ((double, _),) = Counter(name for name, _ in pairs).most_common(1)
        raise UnfitError(f"has the entry {quoted(double, MAX_NAME)} twice")
    return entries
