"""What the command lines share: complaints in one sentence, types of arguments, what is logged.

Each type is given to argparse as `type=...`; it says what came and what is allowed.
"""

from __future__ import annotations

import argparse
import logging
import math
import os
import shutil
import signal
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TypeAlias

from baxter_kin.errors import (
    ConfigurationError,
    DescriptionError,
    FileError,
    millimetres_hint,
    name_hint,
    nearest_name,
)
from baxter_kin.files import Destination

if TYPE_CHECKING:
    from baxter_kin.description import HandMount

Options: TypeAlias = argparse._ActionsContainer
"""A parser, or a group of options of one."""

LONGEST_SHOWN = 200
"""How much of a file's name a message repeats."""

EXIT_INTERRUPTED = 130
"""Status of what Ctrl-C has stopped, as shells have it."""

EXIT_TERMINATED = 143
"""The same of SIGTERM."""

ALIKE_OPTIONS = 0.7
"""How alike options are of which one may have been meant, by difflib's ratio."""

WIDEST = 100
"""Columns of a help text, however wide the terminal is."""


def run_process(main: Callable[[], int], name: str, failed: int) -> NoReturn:
    """Run a program as a process of its own, and end it with its status.

    Args:
        main: the program; gives its exit status.
        name: what messages call it.
        failed: the status where its output cannot be written.
    """
    try:
        status = main()
        if sys.stdout is not None:  # as when the caller has closed it
            sys.stdout.flush()
    except OSError as cause:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        if not isinstance(cause, BrokenPipeError):  # the reader of a pipe has seen enough
            print(f"{name}: cannot write: {cause.strerror}", file=sys.stderr)
        status = failed
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the work is done; leave in peace
    if status in (EXIT_INTERRUPTED, EXIT_TERMINATED):
        # CPython remembers a KeyboardInterrupt inside exec(), which every dataclass uses, and would
        # end by the signal instead of with the status, although it was handled.
        os._exit(status)
    sys.exit(status)


class OneSentenceParser(argparse.ArgumentParser):
    """Says what is wrong in one sentence, and exits with status 2; has `--version`.

    An option that does not exist is answered with those whose names are near.
    """

    def __init__(self, **settings: Any) -> None:
        super().__init__(**{"formatter_class": _HelpFormatter, **settings})
        self.add_argument("--version", action=_Version)

    def parse_known_args(self, *given: Any, **named: Any) -> tuple[Any, list[str]]:
        """As argparse has it, but what is not known ends here."""
        texts = sys.argv[1:] if not given or given[0] is None else given[0]
        for text in texts:
            if not text.startswith("--") and f"-{text}" in self._option_string_actions:
                self.error(f"{text} has one dash; write -{text}")
        options, unknown = super().parse_known_args(*given, **named)
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(unknown)}{self._near(unknown)}")
        return options, unknown

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        try:
            super()._check_value(action, value)
        except argparse.ArgumentError as cause:
            cause.message += name_hint(str(value), map(str, action.choices or ()))
            raise

    def _near(self, unknown: Sequence[str]) -> str:
        """Which option may have been meant by each that does not exist."""
        known = [name for name in self._option_string_actions if name.startswith("--")]
        asked = [text.partition("=")[0] for text in unknown if text.startswith("--")]
        near = list(filter(None, (nearest_name(each, known, ALIKE_OPTIONS) for each in asked)))
        return f"; did you mean {' and '.join(near)}?" if near else ""

    def error(self, message: str) -> NoReturn:
        """End here."""
        self.exit(2, f"{self.prog}: {message} (--help lists the options)\n")


class _HelpFormatter(argparse.HelpFormatter):
    """Keeps lines that are indented, as examples are, and wraps the others."""

    def __init__(self, prog: str, **settings: Any) -> None:
        columns = shutil.get_terminal_size().columns - 2
        super().__init__(prog, **{"width": min(columns, WIDEST), **settings})

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        fill = super()._fill_text
        lines = text.splitlines()
        return "\n".join(s if s.startswith("  ") else fill(s, width, indent) for s in lines)


def examples(*lines: str, end: str) -> str:
    """The end of a help text: command lines that work as they stand, then a paragraph."""
    return "\n".join(["examples:", *(f"  {line}" for line in lines), "", end])


class _Version(argparse.Action):
    """Prints the version, which is looked up only then."""

    def __init__(self, option_strings: Sequence[str], dest: str) -> None:
        told = "print the version of baxter-kin and end"
        super().__init__(option_strings, dest, nargs=0, default=argparse.SUPPRESS, help=told)

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        from baxter_kin.distribution.version import NAME, version  # noqa: PLC0415 - looks it up

        print(NAME, version())
        parser.exit()


def add_urdf(parser: Options) -> None:
    """Add `--urdf`, the robot's own description."""
    parser.add_argument(
        "--urdf",
        type=_urdf_file,
        metavar="FILE",
        help="the robot's own description, as it serves it (default: the stock robot)",
    )


def _urdf_file(text: str) -> Path:
    """The path of a URDF that is a Baxter's."""
    from baxter_kin.description import RobotDescription  # noqa: PLC0415 - loads Pinocchio

    path = Path(text)
    try:
        RobotDescription.of(path)
    except DescriptionError as cause:
        raise argparse.ArgumentTypeError(str(cause)) from None
    return path


def add_hands(parser: Options) -> None:
    """Add `--left-hand` and `--right-hand`, what is on the flanges; `hands_of` reads them."""
    for side in ("left", "right"):
        parser.add_argument(
            f"--{side}-hand",
            type=_hand,
            default=argparse.SUPPRESS,
            metavar="HAND",
            help="what is on that flange: none, or how the gripper is assembled: fingers, slot and "
            "tips, such as wide, narrow-3 or narrow-2-half_round (default: as the URDF says; the "
            "stock robot has narrow-2-paddle on both sides)",
        )


def hands_of(raw: argparse.Namespace) -> Mapping[str, HandMount]:
    """What `add_hands` has read, by side; sides of which nothing was said are absent."""
    named = {side: f"{side}_hand" for side in ("left", "right")}
    return {side: getattr(raw, name) for side, name in named.items() if hasattr(raw, name)}


def _hand(text: str) -> HandMount:
    from baxter_kin.description.hands import hand_of  # noqa: PLC0415 - loads Pinocchio

    try:
        return hand_of(text)
    except ConfigurationError as cause:
        raise argparse.ArgumentTypeError(str(cause)) from None


def number(text: str) -> float:
    """A finite number."""
    try:
        value = float(text)
    except ValueError:
        hint = "; put a point in it, and spaces between numbers" if "," in text else ""
        raise argparse.ArgumentTypeError(f"{text!r} is not a number{hint}") from None
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} is not a finite number")
    return value


def number_within(least: float, most: float, unit: str) -> Callable[[str], float]:
    """The type of numbers from `least` to `most`, which have a unit."""

    def checked(text: str) -> float:
        value = number(text)
        if not least <= value <= most:
            allowed = f"from {least:g} to {most:g} {unit}".rstrip()
            hint = _unit_hint(value, unit, least, most)
            raise argparse.ArgumentTypeError(f"{text} is not {allowed}{hint}")
        return value

    return checked


def _unit_hint(value: float, unit: str, least: float, most: float) -> str:
    """What a refusal adds where a number makes sense in another unit."""
    if unit == "m":
        return millimetres_hint(value)
    other, share = {"s": ("milliseconds", 1e-3), "": ("per cent", 1e-2)}.get(unit, ("", 0.0))
    if not other or value < most or not least <= share * value <= most:
        return ""
    return f"; are these {other}? Give {share * value:g}{f' {unit}' if unit else ''} then"


def whole_number(least: int, most: int | None = None) -> Callable[[str], int]:
    """The type of whole numbers from `least` on, or to `most`."""

    def checked(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r} is not a whole number") from None
        if value < least:
            raise argparse.ArgumentTypeError(f"{text} is not at least {least}")
        if most is not None and value > most:
            raise argparse.ArgumentTypeError(f"{text} is not at most {most}")
        return value

    return checked


def file_to_write(text: str) -> Path:
    """A file that can be written, as far as can be told before it is."""
    if not text:
        raise argparse.ArgumentTypeError("the file name is empty")
    path = Path(text)
    shown = text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."
    try:
        file = Destination.of(path)
    except FileError as cause:
        raise argparse.ArgumentTypeError(f"cannot write {shown}: {cause.reason}") from None
    folder = file.path.parent
    if not folder.is_dir():
        raise argparse.ArgumentTypeError(f"the folder of {shown} does not exist; make it first")
    if not os.access(folder if file.status is None else file.path, os.W_OK):
        raise argparse.ArgumentTypeError(f"cannot write {shown}: Permission denied")
    return path


@contextmanager
def log_told(
    say: Callable[[str], None],
    complain: Callable[[str], None],
    packages: tuple[str, ...] = ("baxter_kin",),
) -> Iterator[None]:
    """What packages log in the meantime reaches the user, as when one compiles for seconds.

    Args:
        say: told what is of interest.
        complain: told warnings, and what is worse.
        packages: names of the packages, none inside of another.
    """
    loggers = [logging.getLogger(name) for name in packages]
    handler, levels = _Teller(say, complain), [logger.level for logger in loggers]
    for logger in loggers:
        logger.addHandler(handler)
        logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
            logger.removeHandler(handler)


class _Teller(logging.Handler):
    def __init__(self, say: Callable[[str], None], complain: Callable[[str], None]) -> None:
        super().__init__(logging.INFO)
        self._say, self._complain = say, complain

    def emit(self, record: logging.LogRecord) -> None:
        tell = self._say if record.levelno < logging.WARNING else self._complain
        tell(record.getMessage())
