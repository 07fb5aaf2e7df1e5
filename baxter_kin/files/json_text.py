"""JSON text: read strictly, written so that files can be compared."""

from __future__ import annotations

import json
import math
from collections import Counter
from typing import Any, TypeAlias

from baxter_kin.display import MAX_NAME, quoted, shortened
from baxter_kin.errors import BaxterError

Json: TypeAlias = "bool | int | float | str | list[Json] | dict[str, Json] | None"


class UnfitError(BaxterError):
    """An error in JSON data; the message continues a sentence that begins with the data's name."""


def as_text(data: Json, error: type[BaxterError]) -> str:
    """Compact JSON on one line, in ASCII."""
    try:
        return json.dumps(data, allow_nan=False, separators=(",", ":"))
    except ValueError as cause:
        raise error(f"cannot be saved: {cause}") from cause


def as_lines(data: Json, indent: str = "\n") -> str:
    """JSON with one row of numbers on a line, for readable and comparable files."""
    deeper = f"{indent} "
    if isinstance(data, dict) and data:
        lines = [f"{json.dumps(key)}: {as_lines(item, deeper)}" for key, item in data.items()]
        return f"{{{deeper}{f',{deeper}'.join(lines)}{indent}}}"
    if isinstance(data, list) and any(isinstance(item, (list, dict)) for item in data):
        lines = [as_lines(item, deeper) for item in data]
        return f"[{deeper}{f',{deeper}'.join(lines)}{indent}]"
    return json.dumps(data, allow_nan=False)


def from_text(text: str | bytes, error: type[BaxterError]) -> Json:
    """Parse JSON, given as text or UTF-8 bytes; duplicate keys and NaN are refused."""
    hooks: dict[str, Any] = {"parse_float": _finite, "parse_constant": _finite}
    try:
        whole = text if isinstance(text, str) else text.decode()
        data: Json = json.loads(whole, object_pairs_hook=_without_duplicates, **hooks)
    except RecursionError:
        raise error("is nested too deeply") from None
    except UnfitError as cause:
        raise error(str(cause)) from None
    except ValueError as cause:  # of the JSON, or of its UTF-8
        what = "is not complete JSON; it is truncated, damaged or another kind of file"
        raise error(f"{what}: {cause}") from None
    return data


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise UnfitError(f"has {shortened(text, MAX_NAME)} where a finite number must be")
    return number


def _without_duplicates(pairs: list[tuple[str, Json]]) -> dict[str, Json]:
    entries = dict(pairs)
    if len(entries) < len(pairs):
        ((double, _),) = Counter(name for name, _ in pairs).most_common(1)
        raise UnfitError(f"has the entry {quoted(double, MAX_NAME)} twice")
    return entries
