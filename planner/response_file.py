"""How an arm was found to follow its set-points, in a JSON file.

`python -m sim.ros1.check --identify` writes it; `--response FILE` of `sim.ros1.execute` and of
`planner.verification` reads it.
"""

from __future__ import annotations

from dataclasses import dataclass

from baxter_kin.errors import FileError, shown_path
from baxter_kin.files import PathLike, open_to_read, replace_file
from baxter_kin.json_data import from_json, shown, to_json
from baxter_kin.json_text import as_lines, from_text
from planner.errors import ResponseError
from planner.motion.response import Response

FORMAT = "baxter-kin response"
VERSION = 1
LARGEST_BYTES = 1_000_000


@dataclass(frozen=True, slots=True)
class _Document:
    format: str
    version: int
    limb: str
    lag_s: tuple[tuple[float, float], ...]
    settled_error_rad: tuple[float, ...]


def save_response(response: Response, limb: str, path: PathLike) -> None:
    """Write how an arm follows; speed and lead are not kept.

    Raises:
        ResponseError: when the file cannot be written.
    """
    lags = tuple((float(least), float(most)) for least, most in response.lag_s)
    errors = tuple(response.settled_error_rad.tolist())
    document = _Document(FORMAT, VERSION, limb, lags, errors)
    data = to_json(document, _Document, "response", ResponseError)
    try:
        replace_file(path, as_lines(data).encode() + b"\n")
    except FileError as cause:
        raise ResponseError(f"{shown_path(path)} cannot be written: {cause.reason}") from cause


def load_response(path: PathLike, limb: str) -> Response:
    """How an arm follows its set-points.

    Raises:
        ResponseError: when the file cannot be read, holds something else, is of the other arm, or a
            number in it makes no sense.
    """
    try:
        with open_to_read(path) as stream:
            content = stream.read(LARGEST_BYTES)
    except (FileError, OSError) as cause:
        raise ResponseError(f"the response cannot be read: {cause}") from cause
    try:
        return _read(content, limb)
    except ResponseError as cause:
        raise ResponseError(f"{shown_path(path)} {cause}") from cause


def _read(content: bytes, limb: str) -> Response:
    data = from_text(content, ResponseError)
    stated = data.get("format") if isinstance(data, dict) else None
    if stated != FORMAT:
        said = "not stated" if stated is None else shown(stated)
        raise ResponseError(
            f"holds no response, as its format is {said}; python -m sim.ros1.check "
            "--identify left --output FILE writes one"
        )
    document: _Document = from_json(data, _Document, "response", ResponseError)
    if document.limb != limb:
        raise ResponseError(f"is of the {document.limb} arm, not of the {limb} one")
    return Response(document.lag_s, document.settled_error_rad)
