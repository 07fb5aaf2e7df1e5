"""Every program on the pages runs, and prints what its page says."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.snippets import snippets_of

DOCS = Path(__file__).parents[2] / "docs"
MADE = ("notebooks", "stories")
"""Folders of pages that the build writes."""

ZARR = ("where_to_put_the_table",)
"""Pages whose programs need it, and it Python 3.11."""

LONG = (
    "tutorial",
    "plan_around_obstacles",
    "follow_a_path",
    "into_a_shelf",
    "two_arms",
    "draw",
    "keep_it_upright",
    "proofs",
    "record_and_replay",
    "teach_and_replay",
    "watch_live",
    "atlas_on_a_cluster",
    "where_to_put_the_table",
)
"""Pages whose programs take seconds; each of their steps is tested where it belongs."""

PAGES = [
    pytest.param(
        page,
        id=str(page.relative_to(DOCS)),
        marks=[pytest.mark.campaign] if page.stem in LONG else [],
    )
    for page in sorted(DOCS.rglob("*.md"))
    if page.relative_to(DOCS).parts[0] not in MADE and any(snippets_of(page))
]


@pytest.mark.parametrize("page", PAGES)
@pytest.mark.filterwarnings("ignore:FigureCanvasAgg is non-interactive")
def test_programs_print_what_the_page_says(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if page.stem in ZARR:
        pytest.importorskip("zarr", reason="maps need zarr, and it Python 3.11")
    monkeypatch.chdir(tmp_path)  # a page may write files
    monkeypatch.setenv("MPLBACKEND", "agg")
    names: dict[str, object] = {"__name__": "__main__"}
    for snippet in snippets_of(page):
        printed = snippet.run(names)
        if snippet.printed is not None:
            assert printed == snippet.printed


def test_no_program_is_overlooked() -> None:
    for page in DOCS.rglob("*.md"):
        fences = [line for line in page.read_text("utf-8").splitlines() if "```py" in line]
        assert fences == ["```python"] * len(list(snippets_of(page))), page
