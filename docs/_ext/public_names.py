"""The reference: names under the front door that users import them from, and links to them.

`.. documents:: planner` documents the names listed below it, one per line. A name of two front
doors is documented at the first one, and the other links to it. `.. errors-of:: planner.errors`
documents the exceptions of a module, except those of its front door. A full name that a page shows
as code becomes a link; in the reference, its last part suffices.
"""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.domains.python import PyObject
from sphinx.environment import BuildEnvironment
from sphinx.transforms import SphinxTransform
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

from scripts.check_site import FRONT_DOORS

PACKAGES = ("baxter_kin", "planner", "sim")
FOREIGN = ("Figure", "np", "pin")
"""Names of other packages that occur in signatures."""
LOGGER = logging.getLogger(__name__)


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directives and the links."""
    app.add_directive("documents", Documents)
    app.add_directive("errors-of", ErrorsOf)
    app.add_transform(LinkedNames)
    app.connect("missing-reference", leave_unlinked)
    app.connect("html-page-context", lead_back)
    for field in PyObject.doc_field_types:
        if field.name == "variable":
            field.label = "Attributes"
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}


@cache
def homes() -> dict[str, str]:
    """The name under which each full public name is documented."""
    documented: dict[int, str] = {}
    return {
        full: documented.setdefault(id(value), full)
        for full, value in zip(_public_names(), _public_values(), strict=True)
    }


def _public_names() -> list[str]:
    return [f"{door}.{name}" for door in FRONT_DOORS for name in import_module(door).__all__]


def _public_values() -> list[object]:
    doors = map(import_module, FRONT_DOORS)
    return [getattr(door, name) for door in doors for name in door.__all__]


@cache
def short_names() -> dict[str, str]:
    """The name under which the last part of each public name is documented."""
    return {home.rpartition(".")[2]: home for home in homes().values()}


class Documents(SphinxDirective):
    """Documents names of a front door, one per line."""

    required_arguments = 1
    has_content = True

    def run(self) -> list[nodes.Node]:
        """The output of autodoc, or a link to it."""
        door = self.arguments[0]
        names = [name for line in self.content for name in line.split()]
        return [node for name in names for node in self._documented(f"{door}.{name}")]

    def _documented(self, full: str) -> list[nodes.Node]:
        home = homes().get(full)
        if home is None:
            LOGGER.warning("%s is not a public name", full, location=self.get_location())
            return []
        if home != full:
            return self._elsewhere(full, home)
        value = getattr(import_module(full.rpartition(".")[0]), full.rpartition(".")[2])
        return self.parse_text_to_nodes(_directive(full, value))

    def _elsewhere(self, full: str, home: str) -> list[nodes.Node]:
        """A line with its own link target."""
        anchor = nodes.make_id(full)
        kind = "class" if full.rpartition(".")[2][0].isupper() else "function"
        domain: Any = self.env.get_domain("py")
        domain.note_object(full, kind, full, aliased=True, location=self.get_location())
        text = f"``{full.rpartition('.')[2]}``: the same as :py:obj:`{home}`.\n"
        (paragraph,) = self.parse_text_to_nodes(text)
        assert isinstance(paragraph, nodes.paragraph), anchor
        paragraph["ids"].append(full)
        return [paragraph]


class ErrorsOf(SphinxDirective):
    """Documents the exceptions and warnings of a module that are on no front door."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """The output of autodoc."""
        public = {id(value) for value in _public_values()}
        module = import_module(self.arguments[0])
        text = [
            _directive(f"{module.__name__}.{name}", value)
            for name, value in vars(module).items()
            if inspect.isclass(value)
            and issubclass(value, Exception)
            and value.__module__ == module.__name__
            and id(value) not in public
        ]
        return self.parse_text_to_nodes("\n".join(text))


def _directive(full: str, value: object) -> str:
    """The autodoc directive of an object."""
    if not inspect.isclass(value):
        return f".. autofunction:: {full}\n"
    kind = "autoexception" if issubclass(value, BaseException) else "autoclass"
    shown = {id(base) for base in (*_public_values(), ValueError, TypeError, ImportError)}
    has_known_base = any(id(base) in shown for base in value.__bases__)
    inheritance = "   :show-inheritance:\n" if has_known_base else ""
    return f".. {kind}:: {full}\n   :members:\n{inheritance}"


class LinkedNames(SphinxTransform):
    """Turns public names in code into links."""

    default_priority = 400

    def apply(self, **_options: Any) -> None:
        """Wrap each name in a reference."""
        in_reference = self.env.docname.startswith("reference/")
        for literal in list(self.document.findall(nodes.literal)):
            target = target_of(literal.astext(), is_short_enough=in_reference)
            parent = literal.parent
            if target is None or isinstance(parent, (nodes.reference, addnodes.pending_xref)):
                continue
            link = addnodes.pending_xref(
                "", refdomain="py", reftype="obj", reftarget=target, refexplicit=True
            )
            link["refdoc"], link["is_code"] = self.env.docname, True
            literal.replace_self(link)
            link += literal


def target_of(text: str, *, is_short_enough: bool) -> str | None:
    """The documented name that code refers to, without the brackets of a call."""
    name = text.removesuffix("()")
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        head, member = ".".join(parts[:count]), "".join(f".{part}" for part in parts[count:])
        if head in homes():
            return homes()[head] + member
        if is_short_enough and count == 1 and head in short_names():
            return short_names()[head] + member
    return None


def leave_unlinked(
    app: Sphinx, env: BuildEnvironment, node: addnodes.pending_xref, content: nodes.Node
) -> nodes.Node | None:
    """Keep existing names that are not in the reference as text; warn about others."""
    if node.get("refdomain") != "py":
        return None
    target = str(node["reftarget"])
    first, _, _ = target.partition(".")
    if node.get("is_code"):  # a member without an entry of its own
        owner = target.rpartition(".")[0]
        domain: Any = env.get_domain("py")
        return domain.resolve_xref(
            env, node["refdoc"], app.builder, "obj", owner, node, content
        ) or (content if owner else None)
    is_foreign = first in FOREIGN or (first in sys.modules and first not in PACKAGES)
    return content if is_foreign or target.rpartition(".")[2] in _known() else None


@cache
def _known() -> frozenset[str]:
    """All names in the loaded modules of our packages."""
    return frozenset(_names())


def _names() -> Iterator[str]:
    homes()
    for name, module in list(sys.modules.items()):
        if name.partition(".")[0] in PACKAGES:
            yield from vars(module)


BACK = re.compile(r'<a class="viewcode-back" href="[^"]*#([^"]*)">\[docs\]</a>')


def lead_back(
    app: Sphinx, page: str, _template: str, context: dict[str, Any], _tree: object
) -> None:
    """Link sources to the entry of each name in the reference.

    Viewcode takes all names of a module for names of the same front door.
    """
    if not page.startswith("_modules/") or "body" not in context:
        return
    module = page.removeprefix("_modules/").replace("/", ".")
    objects = app.env.domaindata["py"]["objects"]

    def link(found: re.Match[str]) -> str:
        for full in _where_documented(module, found[1]):
            if full in objects:
                uri = app.builder.get_relative_uri(page, objects[full].docname)
                return f'<a class="viewcode-back" href="{uri}#{objects[full].node_id}">[docs]</a>'
        return ""

    context["body"] = BACK.sub(link, context["body"])


def _where_documented(module: str, wrong: str) -> Iterator[str]:
    """Full names that a name of viewcode may have in the reference."""
    parts = wrong.split(".")
    for count in range(1, len(parts) + 1):
        name = ".".join(parts[-count:])
        yield f"{module}.{name}"
        first, dot, member = name.partition(".")
        value = vars(sys.modules[module]).get(first)
        for home, documented in zip(_public_names(), _public_values(), strict=True):
            if value is not None and documented is value:
                yield homes()[home] + dot + member
