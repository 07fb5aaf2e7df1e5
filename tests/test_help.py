"""`--help` of every command: examples that parse, groups, and lines that fit a terminal."""

from __future__ import annotations

import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from baxter_kin.benchmark.command import BenchmarkOptions
from baxter_kin.command_line import parse, parser_of
from planner.atlas.commands.command_line import AtlasOptions
from planner.verification.command_line import VerificationOptions
from sim.demo.options import DemoOptions
from sim.ros1.check import CheckOptions
from sim.ros1.execute import ExecuteOptions
from sim.ros1.master import MasterOptions
from sim.ros1.mirror import MirrorOptions
from sim.ros1.press import PressOptions
from sim.ros1.robot.__main__ import RobotOptions

ROOT = Path(__file__).parents[1]
OPTIONS: dict[str, type] = {
    "baxter_kin.benchmark": BenchmarkOptions,
    "baxter_kin.demo": DemoOptions,
    "planner.atlas": AtlasOptions,
    "planner.verification": VerificationOptions,
    "sim.ros1.check": CheckOptions,
    "sim.ros1.execute": ExecuteOptions,
    "sim.ros1.master": MasterOptions,
    "sim.ros1.mirror": MirrorOptions,
    "sim.ros1.press": PressOptions,
    "sim.ros1.robot": RobotOptions,
}
EXAMPLES = ("examples.three_poses", "examples.tower", "examples.where_to_put_the_table")


def help_of(module: str, columns: int, patch: pytest.MonkeyPatch) -> str:
    patch.setenv("COLUMNS", str(columns))
    if module in OPTIONS:
        return parser_of(OPTIONS[module]).format_help()
    command = [sys.executable, "-m", module, "--help"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stderr == ""
    return done.stdout


def examples_in(text: str) -> list[str]:
    _, _, after = text.partition("\nexamples:\n")
    return [line.strip() for line in after.split("\n\n")[0].splitlines()]


@pytest.mark.slow
@pytest.mark.parametrize("module", [*OPTIONS, *EXAMPLES])
def test_help_has_examples_that_parse_and_lines_that_fit(
    module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    wide = help_of(module, 200, monkeypatch)
    found = examples_in(wide)
    assert 2 <= len(found) <= 4
    assert max(map(len, wide.splitlines())) <= 100
    assert "xit status" in wide
    for line in found:
        python, _, name, *arguments = shlex.split(line)
        assert (python, name) == ("python", module)
        if module in OPTIONS:
            parse(OPTIONS[module], arguments)
    if module in OPTIONS:
        narrow = help_of(module, 80, monkeypatch)
        assert max(map(len, narrow.splitlines())) <= 90


@pytest.mark.parametrize(
    ("module", "arguments", "words"),
    [
        ("baxter_kin.demo", "--report-file r --headlss", "and --headless?"),
        ("baxter_kin.demo", "--Hover 0.1", "; did you mean --hover?"),
        ("sim.ros1.robot", "--own_master", "; did you mean --own-master?"),
        ("baxter_kin.demo", "--limb Left", "; did you mean left?"),
        ("baxter_kin.demo", "-html a.html", "-html has one dash; write --html"),
        ("baxter_kin.demo", "--add-pose 0.7, 0.15, -0.129", "and spaces between numbers"),
        ("baxter_kin.demo", "--speed 50", "not from 0.001 to 1; are these per cent? Give 0.5 then"),
        ("baxter_kin.demo", "--hover 150", "150 mm is 0.15 m"),
        ("sim.ros1.execute", "a --lag-s 400 420", "are these milliseconds? Give 0.4 s then"),
        ("sim.ros1.execute", "a --speed 3000", "3000 is not from 0.01 to 1 (--help"),
        ("baxter_kin.demo", "--pose-add", "unrecognized arguments: --pose-add (--help"),
    ],
)
def test_likely_mistakes_are_answered_with_what_was_meant(
    module: str, arguments: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        parse(OPTIONS[module], arguments.split())
    assert ended.value.code == 2
    message = capsys.readouterr().err
    assert words in message
    assert message.count("\n") == 1


@pytest.mark.parametrize("script", sorted((ROOT / "scripts").glob("*.py")), ids=lambda s: s.name)
def test_every_script_reads_its_arguments_before_it_does_anything(script: Path) -> None:
    text = script.read_text(encoding="utf-8")
    assert any(call in text for call in ("parse_args(", "parse_known_args(", "parse("))
