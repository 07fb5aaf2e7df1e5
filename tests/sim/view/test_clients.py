from __future__ import annotations

from sim.view.clients import Letter, Mailbox
from sim.view.meshcat_commands import delete, set_property


def moved(path: str, x: float) -> Letter:
    return Letter.with_command(set_property(path, "position", [x, 0.0, 0.0]))


def deleted(path: str) -> Letter:
    return Letter.with_command(delete(path))


def test_a_newer_letter_takes_the_place_of_an_older() -> None:
    mailbox = Mailbox(keeps_deletions=True)
    for x in range(1000):
        mailbox.put(moved("/a", float(x)))
    assert mailbox.take_all() == [moved("/a", 999.0)]


def test_letters_on_different_topics_stay_in_order() -> None:
    mailbox = Mailbox(keeps_deletions=True)
    letters = [moved("/a", 1.0), Letter.for_page("caption", "pick"), moved("/b", 1.0)]
    for letter in letters:
        mailbox.put(letter)
    assert mailbox.letters() == letters


def test_taking_empties_it() -> None:
    mailbox = Mailbox(keeps_deletions=True)
    mailbox.put(moved("/a", 1.0))
    mailbox.take_all()
    assert len(mailbox) == 0


def test_deleting_forgets_the_node_and_all_below() -> None:
    mailbox = Mailbox(keeps_deletions=False)
    for path in ("/a", "/a/b", "/ab"):
        mailbox.put(moved(path, 1.0))
    mailbox.put(deleted("/a"))
    assert mailbox.letters() == [moved("/ab", 1.0)]


def test_a_reader_who_knows_the_node_is_told_first_that_it_is_gone() -> None:
    mailbox = Mailbox(keeps_deletions=True)
    for letter in (moved("/a", 1.0), deleted("/a"), moved("/a", 2.0)):
        mailbox.put(letter)
    assert mailbox.letters() == [deleted("/a"), moved("/a", 2.0)]
