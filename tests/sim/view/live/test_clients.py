from __future__ import annotations

from sim.view.live.clients import LatestMessages, Message
from sim.view.meshcat_commands import delete, set_property


def moved(path: str, x: float) -> Message:
    return Message.with_command(set_property(path, "position", [x, 0.0, 0.0]))


def deleted(path: str) -> Message:
    return Message.with_command(delete(path))


def test_a_newer_letter_takes_the_place_of_an_older() -> None:
    latest = LatestMessages(keeps_deletions=True)
    for x in range(1000):
        latest.put(moved("/a", float(x)))
    assert latest.take_all() == [moved("/a", 999.0)]


def test_letters_on_different_topics_stay_in_order() -> None:
    latest = LatestMessages(keeps_deletions=True)
    messages = [moved("/a", 1.0), Message.for_page("caption", "pick"), moved("/b", 1.0)]
    for message in messages:
        latest.put(message)
    assert latest.messages() == messages


def test_taking_empties_it() -> None:
    latest = LatestMessages(keeps_deletions=True)
    latest.put(moved("/a", 1.0))
    latest.take_all()
    assert len(latest) == 0


def test_deleting_forgets_the_node_and_all_below() -> None:
    latest = LatestMessages(keeps_deletions=False)
    for path in ("/a", "/a/b", "/ab"):
        latest.put(moved(path, 1.0))
    latest.put(deleted("/a"))
    assert latest.messages() == [moved("/ab", 1.0)]


def test_a_reader_who_knows_the_node_is_told_first_that_it_is_gone() -> None:
    latest = LatestMessages(keeps_deletions=True)
    for message in (moved("/a", 1.0), deleted("/a"), moved("/a", 2.0)):
        latest.put(message)
    assert latest.messages() == [deleted("/a"), moved("/a", 2.0)]
