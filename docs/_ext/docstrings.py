"""Converts conventions of our docstrings into what Sphinx parses.

Fences (three backticks) become literal blocks. The description of an attribute or property stays
text, since Napoleon would parse the words before a colon as a type. A default factory is shown as
three dots.
"""

from __future__ import annotations

import re
from typing import Any

from sphinx.application import Sphinx
from sphinx.ext.napoleon import GoogleDocstring

FENCE = "```"
OF_VALUES = ("attribute", "data", "property")

ALIAS = re.compile(r"TypeAliasForwardRef\('(\w+)'\)")
"""The text of one of `autodoc_type_aliases` beside "|" in autodoc's signatures."""

_waiting: list[str] = []


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect the handlers that run before and after Napoleon."""
    app.connect("autodoc-process-docstring", unfence, priority=300)
    app.connect("autodoc-process-docstring", take, priority=400)
    app.connect("autodoc-process-docstring", give_back, priority=600)
    app.connect("autodoc-process-signature", shorten)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}


def unfence(
    _app: Sphinx, _what: str, _name: str, _of: object, _options: object, lines: list[str]
) -> None:
    """Turn fences into literal blocks."""
    unfenced: list[str] = []
    is_inside = False
    for line in lines:
        if line.strip().startswith(FENCE):
            is_inside = not is_inside
            unfenced += ["::", ""] if is_inside else [""]
        else:
            unfenced.append(f"    {line}" if is_inside and line else line)
    lines[:] = unfenced


def take(
    app: Sphinx, what: str, _name: str, of: object, _options: object, lines: list[str]
) -> None:
    """Withhold the text of a value from Napoleon, with its sections parsed."""
    if what in OF_VALUES:
        _waiting[:] = GoogleDocstring(lines, app.config, app, "method", "", of).lines()
        lines.clear()


def give_back(
    _app: Sphinx, what: str, _name: str, _of: object, _options: object, lines: list[str]
) -> None:
    """Restore the withheld text."""
    if what in OF_VALUES:
        lines[:] = _waiting


def shorten(
    _app: Sphinx,
    _what: str,
    _name: str,
    _of: object,
    _options: object,
    signature: str | None,
    returned: str | None,
) -> tuple[str | None, str | None] | None:
    """Remove text that is not Python from a signature."""
    return _plain(signature), _plain(returned)


def _plain(text: str | None) -> str | None:
    """Python source in place of its `repr`."""
    if text is None:
        return None
    return ALIAS.sub(r"\1", re.sub(r"<[^<>]*>", "...", text))
