"""What the command lines share: complaints in one sentence, types of arguments, what is logged.

Each type is given to argparse as `type=...`; it says what came and what is allowed.
"""

from __future__ import annotations

import argparse
import logging
import math
import os
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from baxter_kin.errors import ConfigurationError, DescriptionError, FileError, millimetres_hint
from baxter_kin.files import Destination

if TYPE_CHECKING:
    from baxter_kin.description import HandMount

LONGEST_SHOWN = 200
"""How much of a file's name a message repeats."""


EXIT_INTERRUPTED = 130
"""Status of what Ctrl-C has stopped, as shells have it."""


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
    if status == EXIT_INTERRUPTED:
        # CPython remembers a KeyboardInterrupt inside exec(), which every dataclass uses, and would
        # end by the signal instead of with the status, although it was handled.
        os._exit(status)
    sys.exit(status)


class OneSentenceParser(argparse.ArgumentParser):
    """Says what is wrong in one sentence, and exits with status 2."""

    def error(self, message: str) -> NoReturn:
        """End here."""
        self.exit(2, f"{self.prog}: {message} (--help lists the options)\n")


def add_urdf(parser: argparse.ArgumentParser) -> None:
    """Add `--urdf`, the robot's own description."""
    parser.add_argument(
        "--urdf",
        type=urdf_file,
        metavar="FILE",
        help="the robot's own description, as it serves it (default: the stock robot)",
    )


def urdf_file(text: str) -> Path:
    """The path of a URDF that is a Baxter's."""
    from baxter_kin.description import RobotDescription  # noqa: PLC0415 - loads Pinocchio

    path = Path(text)
    try:
        RobotDescription.of(path)
    except DescriptionError as cause:
        raise argparse.ArgumentTypeError(str(cause)) from None
    return path


def add_hands(parser: argparse.ArgumentParser) -> None:
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
        raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} is not a finite number")
    return value


def number_within(least: float, most: float, unit: str) -> Callable[[str], float]:
    """The type of numbers from `least` to `most`, which have a unit."""

    def checked(text: str) -> float:
        value = number(text)
        if not least <= value <= most:
            hint = millimetres_hint(value) if unit == "m" else ""
            raise argparse.ArgumentTypeError(
                f"{text} is not from {least:g} to {most:g} {unit}{hint}"
            )
        return value

    return checked


def whole_number(least: int) -> Callable[[str], int]:
    """The type of whole numbers from `least` on."""

    def checked(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r} is not a whole number") from None
        if value < least:
            raise argparse.ArgumentTypeError(f"{text} is not at least {least}")
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
