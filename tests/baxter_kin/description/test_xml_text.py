from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from baxter_kin.description.xml_text import (
    MAX_ELEMENTS,
    MAX_NESTING,
    MAX_TEXT_BYTES,
    Element,
    read_xml,
)
from baxter_kin.errors import DescriptionError


def test_elements_and_attributes_come_in_order() -> None:
    root = read_xml("<a x='1'><b/>words<c y='2'/><b z='3'/></a>")
    assert (root.name, root.attributes) == ("a", {"x": "1"})
    assert [child.name for child in root.children] == ["b", "c", "b"]
    assert [child.attributes for child in root.all("b")] == [{}, {"z": "3"}]
    assert root.first("c") == Element("c", {"y": "2"})
    assert root.first("d") is None


def test_text_is_kept_up_to_the_first_child() -> None:
    root = read_xml("<a> one\ntwo &amp; three<b>four</b>five</a>")
    assert (root.text, root.children[0].text) == (" one\ntwo & three", "four")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "latin-1"])
def test_bytes_are_read_as_their_first_line_says(encoding: str) -> None:
    text = f"<?xml version='1.0' encoding='{encoding}'?><a x='\xe9'/>"
    assert read_xml(text.encode(encoding)).attributes == {"x": "\xe9"}


def test_text_is_text_whatever_its_first_line_says() -> None:
    assert (
        read_xml("<?xml version='1.0' encoding='latin-1'?><a x='\xe9'/>").attributes["x"] == "\xe9"
    )


LAUGHS = "".join(f"<!ENTITY l{i} '{f'&l{i - 1};' * 10}'>" for i in range(1, 30))


@pytest.mark.parametrize(
    "declared",
    [
        f"<!DOCTYPE a [<!ENTITY l0 'ha'>{LAUGHS}]><a>&l29;</a>",
        "<!DOCTYPE a [<!ENTITY x SYSTEM 'file:///etc/passwd'>]><a>&x;</a>",
        "<!DOCTYPE a SYSTEM 'http://127.0.0.1/a.dtd'><a/>",
        "<!DOCTYPE a [<!ENTITY % x SYSTEM 'file:///etc/passwd'> %x;]><a/>",
        "<!DOCTYPE a><a/>",
    ],
)
def test_a_document_type_is_refused(declared: str) -> None:
    with pytest.raises(DescriptionError, match="declares a document type"):
        read_xml(declared)


def test_an_entity_that_nobody_declared_is_refused() -> None:
    with pytest.raises(DescriptionError, match="no XML"):
        read_xml("<a>&x;</a>")


def test_size_nesting_and_number_are_bounded() -> None:
    with pytest.raises(DescriptionError, match="larger than 4 MB"):
        read_xml(b"<a>" + MAX_TEXT_BYTES * b" " + b"</a>")
    with pytest.raises(DescriptionError, match="nested too deeply"):
        read_xml("<a>" * (MAX_NESTING + 1))
    with pytest.raises(DescriptionError, match="too many"):
        read_xml("<a>" + (MAX_ELEMENTS + 1) * "<b/>")
    deepest = "<a>" * MAX_NESTING + "</a>" * MAX_NESTING
    assert read_xml(deepest).name == "a"


@pytest.mark.parametrize(
    "text",
    [
        "",
        "<a>",
        "<a></b>",
        "<a/><b/>",
        "<a x='1' x='2'/>",
        "<a \ud800/>",
        b"<?xml version='1.0' encoding='no-such'?><a/>",
        b"<?xml version='1.0' encoding='shift_jis'?><a/>",
        b"\xff\xfe<",
        b"<a>\xff</a>",
        "<a>\0</a>",
    ],
)
def test_what_is_no_xml_is_refused(text: str | bytes) -> None:
    with pytest.raises(DescriptionError, match="no XML"):
        read_xml(text)


@given(st.one_of(st.binary(max_size=200), st.text(max_size=200)))
def test_anything_is_read_or_refused(text: str | bytes) -> None:
    with suppress(DescriptionError):
        assert read_xml(text).name


def test_no_file_is_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("builtins.open", None)
    assert read_xml(f"<a href='{tmp_path}/b'><?xml-stylesheet href='c'?></a>").name == "a"
