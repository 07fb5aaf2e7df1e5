from __future__ import annotations

import pytest

from sim.view.live.server import LatestMessages


@pytest.fixture
def latest() -> LatestMessages:
    """Those of a reader who may know nodes that are gone."""
    return LatestMessages(keeps_deletions=True)


def test_a_newer_message_replaces_an_older_one(latest: LatestMessages) -> None:
    for x in range(1000):
        latest.put("/a", "position", str(x))
    assert latest.take_all() == ["999"]


def test_messages_on_different_topics_stay_in_order(latest: LatestMessages) -> None:
    keys = [("/a", "position"), ("", "caption"), ("/b", "position"), ("/a", "visible")]
    for path, topic in keys:
        latest.put(path, topic, f"{path} {topic}")
    latest.put("/a", "position", "newer")
    assert list(latest.messages()) == keys
    assert latest.take_all()[0] == "newer"


def test_taking_all_messages_leaves_none(latest: LatestMessages) -> None:
    latest.put("/a", "position", "1")
    latest.take_all()
    assert latest.take_all() == []


def test_put_returns_whether_a_message_is_new(latest: LatestMessages) -> None:
    assert [latest.put("", "caption", text) for text in ("a", "a", "b")] == [True, False, True]


def test_a_deletion_forgets_the_node_and_all_below() -> None:
    scene = LatestMessages(keeps_deletions=False)
    for path in ("/a", "/a/b", "/ab"):
        scene.put(path, "position", path)
    scene.put("/a", "delete", "")
    assert scene.take_all() == ["/ab"]


def test_a_reader_who_may_know_the_node_gets_its_deletion_first(latest: LatestMessages) -> None:
    for topic in ("position", "delete", "position"):
        latest.put("/a", topic, topic)
    assert latest.take_all() == ["delete", "position"]
