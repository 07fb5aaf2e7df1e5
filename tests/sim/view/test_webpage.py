"""Pages are put together whole, with texts as they are."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.errors import ViewerError
from sim.view import webpage
from sim.view.webpage import inside_script, live_page, page, viewer_bundle


def replay_page(title: object = "", notice: str = "", data: str = "") -> str:
    return page("replay.html", title=title, notice=notice, data=data)


def test_no_slot_is_left_open() -> None:
    assert "{{" not in live_page("Baxter")
    for template in ("replay.html", "atlas/atlas.html"):
        filled = page(template, title="Baxter", notice="", data="")
        assert "{{" not in filled.replace(inside_script(viewer_bundle()), "")
    assert "<h1>Baxter &amp; &lt;friends&gt;</h1>" in live_page("Baxter & <friends>")


@pytest.mark.parametrize("text", [r"\1 \g<0> \n", "{{card.html}}", "{{title}}", "", "ä €"])
def test_a_text_is_inserted_as_it_is(text: str) -> None:
    before, after = replay_page(data="@@@").split("@@@")
    assert replay_page(data=text) == before + text + after


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
