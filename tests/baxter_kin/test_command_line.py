from __future__ import annotations

import logging
import re
import subprocess
import sys
from pathlib import Path

import pytest

import baxter_kin
from baxter_kin.command_line import OneSentenceParser, log_told

SCRIPTS = re.findall(
    r'^baxter-\w+ = "([\w.]+):\w+"$',
    (Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"),
    re.MULTILINE,
)
COMMANDS = {name.removesuffix(".__main__") for name in SCRIPTS} | {
    "baxter_kin.benchmark",
    "baxter_kin.demo",
    "planner.verification",
}

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


@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_every_command_tells_its_version(command: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", command, "--version"], capture_output=True, text=True, check=True
    )
    assert done.stdout == f"baxter-kin {baxter_kin.__version__}\n"


def test_the_version_asks_for_nothing_else(capsys: pytest.CaptureFixture[str]) -> None:
    parser = OneSentenceParser()
    parser.add_argument("file")
    with pytest.raises(SystemExit, match="0"):
        parser.parse_args(["--version"])
    assert capsys.readouterr().out == f"baxter-kin {baxter_kin.__version__}\n"
    assert vars(parser.parse_args(["some"])) == {"file": "some"}
