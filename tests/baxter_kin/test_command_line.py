from __future__ import annotations

import logging
import re
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

import baxter_kin
from baxter_kin.command_line import (
    OneSentenceParser,
    UsageError,
    command,
    flag,
    log_shown,
    number,
    option,
    parse,
    part,
    progress,
    subcommands,
    whole_number,
)

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


def test_what_the_packages_log_in_the_meantime_is_shown() -> None:
    infos: list[str] = []
    warnings: list[str] = []
    logger = logging.getLogger("baxter_kin")
    before = logger.level, list(logger.handlers)
    with log_shown(infos.append, warnings.append, ("baxter_kin", "sim.ros1")):
        log.debug("a detail")
        log.info("compiling with %s", "cc")
        log.warning("not compiled")
        logging.getLogger("sim.ros1.robot").info("two")
        logging.getLogger("somebody_else").warning("something")
    log.info("later")
    assert (infos, warnings) == (["compiling with cc", "two"], ["not compiled"])
    assert (logger.level, logger.handlers) == before


def test_progress_is_for_terminals_and_for_who_wants_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Elsewhere it comes once in a minute."""
    pytest.importorskip("tqdm")
    for is_terminal, is_quiet, is_shown in (
        (True, False, True),
        (True, True, False),
        (False, False, False),
    ):
        monkeypatch.setattr("sys.stderr.isatty", lambda is_it=is_terminal: is_it, raising=False)
        with progress("info", 3, "block", is_quiet=is_quiet) as advance:
            time.sleep(0.11)
            advance(2)
        assert ("info:  67%" in capsys.readouterr().err) == is_shown


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_every_command_tells_its_version(name: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", name, "--version"], capture_output=True, text=True, check=True
    )
    assert done.stdout == f"baxter-kin {baxter_kin.__version__}\n"


@dataclass(frozen=True, slots=True, kw_only=True)
class Milk:
    """Options that several commands share."""

    kind: str | None = option("--milk", choices=("cow", "oat"), help="which milk")


@command("tea", "Make tea.", examples=("tea black --cups 2",), end="Exit status: 0 made.")
@dataclass(frozen=True, slots=True, kw_only=True)
class Tea:
    leaves: str = option(choices=("black", "green"), help="which tea")
    cups: int = option("--cups", type=whole_number(1, 10), default=1, help="how many")
    is_iced: bool = flag("--iced", exclusive="heat", help="with ice")
    is_boiling: bool = flag("--boiling", exclusive="heat", help="very hot")
    spices_g: tuple[tuple[float, ...], ...] = option(
        "--spices", type=number, nargs=2, repeats=True, help="50 % of each"
    )
    milk: Milk = part(Milk, "milk")

    def __post_init__(self) -> None:
        if self.is_iced and self.milk.kind is not None:
            raise UsageError("iced tea takes no milk")


@command(None, "Make coffee.")
@dataclass(frozen=True, slots=True, kw_only=True)
class Coffee:
    shots: int = option("--shots", type=whole_number(1), default=2, help="how many")


@command("bar", "Make a drink.")
@dataclass(frozen=True, slots=True, kw_only=True)
class Drink:
    drink: Tea | Coffee = subcommands({"tea": Tea, "coffee": Coffee}, metavar="DRINK")


def test_a_class_of_options_is_what_the_command_line_gives() -> None:
    assert parse(Tea, ["black"]) == Tea(leaves="black")
    line = "green --cups 3 --spices 1 2 --spices 3 4 --milk oat"
    found = parse(Tea, line.split())
    assert (found.leaves, found.cups, found.milk) == ("green", 3, Milk(kind="oat"))
    assert found.spices_g == ((1.0, 2.0), (3.0, 4.0))
    assert parse(Drink, ["coffee", "--shots", "1"]).drink == Coffee(shots=1)
    assert parse(Drink, ["tea", "black"]).drink == Tea(leaves="black")


def test_the_help_shows_defaults_groups_and_examples(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        parse(Tea, ["--help"])
    text = capsys.readouterr().out
    assert "how many (default: 1)\n" in text
    assert "50 % of each\n" in text
    assert "\nmilk:\n  --milk {cow,oat}" in text
    assert text.endswith("examples:\n  tea black --cups 2\n\nExit status: 0 made.\n")


@pytest.mark.parametrize(
    ("options", "line", "words"),
    [
        (Tea, "", "tea: the following arguments are required: leaves"),
        (Tea, "black --cups 11", "tea: argument --cups: 11 is not from 1 to 10"),
        (Tea, "black --iced --boiling", "not allowed with argument --iced"),
        (Tea, "black --iced --milk oat", "tea: iced tea takes no milk"),
        (Drink, "tea black --iced --milk oat", "bar tea: iced tea takes no milk"),
        (Drink, "juice", "bar: argument DRINK: invalid choice: 'juice'"),
    ],
)
def test_wrong_usage_is_one_sentence_and_status_2(
    options: type, line: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        parse(options, line.split())
    text = capsys.readouterr().err
    assert words in text
    assert text.count("\n") == 1


def test_the_version_asks_for_nothing_else(capsys: pytest.CaptureFixture[str]) -> None:
    parser = OneSentenceParser()
    parser.add_argument("file")
    with pytest.raises(SystemExit, match="0"):
        parser.parse_args(["--version"])
    assert capsys.readouterr().out == f"baxter-kin {baxter_kin.__version__}\n"
    assert vars(parser.parse_args(["some"])) == {"file": "some"}


def test_the_options_of_the_demo_load_no_large_library() -> None:
    program = (
        "import sys; import sim.demo.options; "
        "print(*{'numpy', 'pinocchio', 'casadi', 'coal', 'attrs'} & set(sys.modules))"
    )
    found = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True)
    assert found.stdout.split() == []
