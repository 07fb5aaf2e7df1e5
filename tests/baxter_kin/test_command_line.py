from __future__ import annotations

import logging

from baxter_kin.command_line import log_told

log = logging.getLogger("baxter_kin.somewhere")


def test_what_is_logged_in_the_meantime_is_told() -> None:
    said: list[str] = []
    complaints: list[str] = []
    with log_told(said.append, complaints.append):
        log.debug("a detail")
        log.info("compiling with %s", "cc")
        log.warning("not compiled")
    log.info("later")
    assert (said, complaints) == (["compiling with cc"], ["not compiled"])


def test_what_others_log_is_not_told() -> None:
    said: list[str] = []
    with log_told(said.append, said.append):
        logging.getLogger("somebody_else").warning("something")
    assert said == []


def test_the_logger_is_left_as_it_was() -> None:
    logger = logging.getLogger("baxter_kin")
    before = logger.level, list(logger.handlers)
    with log_told(print, print):
        pass
    assert (logger.level, logger.handlers) == before


def test_several_packages_are_told_where_that_is_asked_for() -> None:
    said: list[str] = []
    with log_told(said.append, said.append, ("baxter_kin", "sim.ros1")):
        log.info("one")
        logging.getLogger("sim.ros1.robot").info("two")
    assert said == ["one", "two"]
