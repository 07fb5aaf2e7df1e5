"""Pages are put together whole, with texts as they are."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.errors import ViewerError
from sim.view import webpage
from sim.view.webpage import inside_script, page, viewer_bundle


def test_no_slot_is_left_open() -> None:
    assert "{{" not in page("live.html", title="Baxter")


def test_slots_of_inserted_files_are_filled_too() -> None:
    assert "Baxter & <friends>" in page("card.html", title="Baxter & <friends>")
    assert page("card.html", title="Baxter & <friends>") in page(
        "live.html", title="Baxter & <friends>"
    )


@pytest.mark.parametrize("text", [r"\1 \g<0> \n", "{{card}}", "{{title}}", "", "ä €"])
def test_a_text_is_inserted_as_it_is(text: str) -> None:
    before, after = page("card.html", title="@@@").split("@@@", 1)
    assert page("card.html", title=text).startswith(before + text)
    assert page("card.html", title=text).endswith(after.replace("@@@", text))


@given(st.text() | st.sampled_from(["</script>", "a</SCRIPT b", "<!-- </scripty", "<\\/script>"]))
def test_a_text_in_a_script_says_the_same_and_does_not_end_it(text: str) -> None:
    code = inside_script(json.dumps(text))
    assert "</script" not in code.lower()
    assert json.loads(code) == text


def test_the_viewer_is_there_and_has_no_end_of_script_left_in_it() -> None:
    bundle = viewer_bundle()
    assert "BufferGeometry" in bundle
    assert "</script" not in inside_script(bundle).lower()


def test_without_meshcat_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(webpage, "find_spec", lambda _name: None)
    with pytest.raises(ViewerError, match=r"run: .* -m pip install meshcat$"):
        viewer_bundle()
