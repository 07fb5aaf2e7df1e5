"""Command lines: a frozen class of options becomes parser, help and checked values.

A command's options are a dataclass whose fields say what each option is; `parse` does the rest:

    @command("python -m tea", "Make tea.", examples=("python -m tea --cups 2",))
    @dataclass(frozen=True, slots=True, kw_only=True)
    class TeaOptions:
        kind: str = option(choices=("black", "green"), help="which tea")
        cups: int = option("--cups", whole_number(1, 10), default=1, help="how many")

    options = parse(TeaOptions)

Wrong usage ends the program with status 2 and one sentence that names what was given and what is
allowed. Types of arguments, such as `number_within`, are argparse's: functions of the text.
"""

from __future__ import annotations

import argparse
import dataclasses
import importlib.util
import logging
import math
import os
import shutil
import signal
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar

from baxter_kin.display import millimetres_hint, name_hint, nearest_name
from baxter_kin.errors import BaxterError, ConfigurationError, DescriptionError, FileError
from baxter_kin.files import Destination

if TYPE_CHECKING:
    from baxter_kin.description import HandMount

T = TypeVar("T")

EXIT_USAGE = 2
EXIT_INTERRUPTED = 130
"""Status after Ctrl-C, as shells have it."""

EXIT_TERMINATED = 143
"""Status after SIGTERM."""

MAX_PORT = 65_535
MAX_SHOWN_CHARACTERS = 200
"""Of a file's name in a message."""

OPTION_SIMILARITY = 0.7
"""From where on an unknown option counts as a misspelt one, by difflib's ratio."""

MAX_HELP_COLUMNS = 100

_SPEC, _COMMAND, _PARSER = "option", "__command__", "_parser"


class UsageError(BaxterError):
    """Options that contradict each other, or ask for something that does not exist."""


# Options as fields ------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Option:
    """Arguments of argparse's `add_argument`, once for each set of flags."""

    flags: Sequence[tuple[str, ...]]
    settings: Mapping[str, Any]
    group: str
    exclusive: str


@dataclass(frozen=True)
class _Part:
    """Options of another class, held as one field."""

    options: type[Any]
    group: str


@dataclass(frozen=True)
class _Subcommands:
    """A choice between classes of options."""

    options: Mapping[str, type[Any]]
    title: str | None
    metavar: str


@dataclass(frozen=True)
class _Command:
    """The texts around a command's options."""

    prog: str | None
    about: str
    epilog: str


def option(
    *flags: str,
    help: str,  # noqa: A002 - as argparse calls it
    type: Callable[[str], Any] | None = None,  # noqa: A002 - likewise
    default: Any = None,
    repeats: bool = False,
    required: bool = False,
    group: str = "",
    exclusive: str = "",
    **settings: Any,
) -> Any:
    """A field of a class of options: an option, or a positional argument where no flag is given.

    Several values arrive as a tuple. The help ends with the default where there is one to show and
    the text does not mention it.

    Args:
        flags: such as "-q", "--quiet".
        help: what it does.
        type: makes a value of the text; raises `argparse.ArgumentTypeError` where it cannot.
        default: the field's value when the option is not given.
        repeats: whether it may be given several times; the values arrive as a tuple.
        required: whether an option must be given; a positional argument always must.
        group: heading in the help text.
        exclusive: name of a set of options of which one may be given.
        settings: further arguments of argparse's `add_argument`: choices, metavar, nargs, const.
    """
    if type is not None:
        settings["type"] = type
    if repeats:
        settings["action"], default = "append", ()
    if required:
        settings["required"] = True
    has_shown_default = default is not None and default is not False and default != ()
    if has_shown_default and "default" not in help:
        shown = f"{default:g}" if isinstance(default, float) else default
        help = f"{help} (default: {shown})"  # noqa: A001
    settings["help"] = help.replace("%", "%%")
    return _field(_Option((flags,), settings, group, exclusive), default, required or not flags)


def flag(
    *flags: str,
    help: str,  # noqa: A002 - as argparse calls it
    group: str = "",
    exclusive: str = "",
) -> Any:
    """A field that is True when the option is given; see `option`."""
    return option(
        *flags, help=help, default=False, group=group, exclusive=exclusive, action="store_true"
    )


def part(options: type[Any], group: str = "") -> Any:
    """A field that holds the options of another class, shown under a heading of their own."""
    return dataclasses.field(default_factory=options, metadata={_SPEC: _Part(options, group)})


def subcommands(options: Mapping[str, type[Any]], *, metavar: str, title: str | None = None) -> Any:
    """A field that holds the options of the sub-command that is given.

    Args:
        options: classes by the name of the sub-command; `command` gives their texts.
        metavar: stands for the name in the help text.
        title: heading in the help text.
    """
    return _field(_Subcommands(options, title, metavar), None, is_required=True)


def _field(spec: object, default: Any, is_required: bool) -> Any:
    metadata = {_SPEC: spec}
    if is_required:
        return dataclasses.field(metadata=metadata)
    if isinstance(default, Mapping):
        return dataclasses.field(default_factory=lambda: dict(default), metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def urdf_option(group: str = "") -> Any:
    """The field of `--urdf`, the robot's own description."""
    return option(
        "--urdf",
        help="the robot's own description, as it serves it (default: the stock robot)",
        type=urdf_file,
        metavar="FILE",
        group=group,
    )


def hands_option(group: str = "") -> Any:
    """The field of `--left-hand` and `--right-hand`: hands by side, as far as they are given."""
    settings = {
        "action": _StoreHand,
        "type": _hand,
        "metavar": "HAND",
        "help": "what is on that flange: none, or how the gripper is assembled: fingers, slot and "
        "tips, such as wide, narrow-3 or narrow-2-half_round (default: as the URDF says; the "
        "stock robot has narrow-2-paddle on both sides)",
    }
    flags = (("--left-hand",), ("--right-hand",))
    return _field(_Option(flags, settings, group, ""), {}, is_required=False)


class _StoreHand(argparse.Action):
    """Adds a hand to those by side."""

    def __call__(
        self, _: object, namespace: argparse.Namespace, value: object, __: object = None
    ) -> None:
        side = self.option_strings[0].removeprefix("--").removesuffix("-hand")
        setattr(namespace, self.dest, {**getattr(namespace, self.dest, {}), side: value})


# From a class of options to a parser, and back ---------------------------------------------------


def command(
    prog: str | None,
    about: str,
    *,
    examples: Sequence[str] = (),
    end: str = "",
) -> Callable[[type[T]], type[T]]:
    """Give a class of options the texts of its command.

    Args:
        prog: name in messages; None for that of the process or, of a sub-command, its name.
        about: what the command does.
        examples: command lines that work as they stand.
        end: the last paragraph of the help text, with the exit status.
    """
    texts = _Command(prog, about, _epilog(examples, end))

    def named(options: type[T]) -> type[T]:
        setattr(options, _COMMAND, texts)
        return options

    return named


def parse(options: type[T], argv: Sequence[str] | None = None) -> T:
    """The options of a command line; ends the program with status 2 when they are wrong.

    A class of options may raise `UsageError` in `__post_init__` where options contradict each
    other.

    Args:
        options: a class that `command` has named.
        argv: the arguments; those of the process when None.
    """
    raw = parser_of(options).parse_args(argv)
    try:
        return _value(options, raw)
    except UsageError as cause:
        parser: argparse.ArgumentParser = getattr(raw, _PARSER)
        parser.error(str(cause))


def parser_of(options: type[Any]) -> OneSentenceParser:
    """The parser of a class of options that `command` has named."""
    texts: _Command = getattr(options, _COMMAND)
    parser = OneSentenceParser(prog=texts.prog, **_settings(texts))
    _add(parser, options)
    return parser


def _settings(texts: _Command) -> dict[str, Any]:
    return {"description": texts.about, "epilog": texts.epilog, "allow_abbrev": False}


def _add(parser: argparse.ArgumentParser, options: type[Any]) -> None:
    """Add the options of a class to a parser, which is then the one that reports their misuse."""
    containers: dict[tuple[str, str], argparse._ActionsContainer] = {("", ""): parser}

    def container(group: str, exclusive: str = "") -> argparse._ActionsContainer:
        key = group, exclusive
        if key not in containers:
            containers[key] = (
                container(group).add_mutually_exclusive_group()
                if exclusive
                else parser.add_argument_group(group)
            )
        return containers[key]

    def add(options: type[Any], heading: str) -> None:
        for field in dataclasses.fields(options):
            spec = field.metadata[_SPEC]
            if isinstance(spec, _Part):
                add(spec.options, spec.group or heading)
            elif isinstance(spec, _Subcommands):
                _add_subcommands(parser, field.name, spec)
            else:
                target = container(spec.group or heading, spec.exclusive)
                for flags in spec.flags:
                    settings = {"default": argparse.SUPPRESS, **spec.settings}
                    if flags:
                        settings["dest"] = field.name
                    target.add_argument(*(flags or (field.name,)), **settings)

    add(options, "")
    parser.set_defaults(**{_PARSER: parser})


def _add_subcommands(parser: argparse.ArgumentParser, name: str, spec: _Subcommands) -> None:
    titled = {} if spec.title is None else {"title": spec.title}
    chosen = parser.add_subparsers(dest=name, required=True, metavar=spec.metavar, **titled)
    for key, options in spec.options.items():
        texts: _Command = getattr(options, _COMMAND)
        _add(chosen.add_parser(key, help=texts.about, **_settings(texts)), options)


def _value(options: type[T], raw: argparse.Namespace) -> T:
    """Only what was given is passed on: defaults are those of the class."""
    values = {}
    for field in dataclasses.fields(options):  # type: ignore[arg-type]
        spec = field.metadata[_SPEC]
        if isinstance(spec, _Part):
            values[field.name] = _value(spec.options, raw)
        elif isinstance(spec, _Subcommands):
            values[field.name] = _value(spec.options[getattr(raw, field.name)], raw)
        elif hasattr(raw, field.name):
            values[field.name] = _frozen(getattr(raw, field.name))
    return options(**values)


def _frozen(value: Any) -> Any:
    return tuple(map(_frozen, value)) if isinstance(value, list) else value


# Parsing and its messages ------------------------------------------------------------------------


class OneSentenceParser(argparse.ArgumentParser):
    """Reports wrong usage in one sentence, and exits with status 2; has `--version`.

    An unknown option is answered with the known one that is spelt nearly the same.
    """

    def __init__(self, **settings: Any) -> None:
        super().__init__(**{"formatter_class": _HelpFormatter, **settings})
        self.add_argument("--version", action=_Version)

    def parse_known_args(self, *given: Any, **named: Any) -> tuple[Any, list[str]]:
        """Like argparse's, but unknown arguments are an error."""
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
        """The options that may have been meant."""
        known = [name for name in self._option_string_actions if name.startswith("--")]
        asked = [text.partition("=")[0] for text in unknown if text.startswith("--")]
        near = list(filter(None, (nearest_name(each, known, OPTION_SIMILARITY) for each in asked)))
        return f"; did you mean {' and '.join(near)}?" if near else ""

    def error(self, message: str) -> NoReturn:
        """Exit with status 2 and one sentence."""
        self.exit(EXIT_USAGE, f"{self.prog}: {message} (--help lists the options)\n")


class _HelpFormatter(argparse.HelpFormatter):
    """Keeps indented lines, such as examples, as they are, and wraps the others."""

    def __init__(self, prog: str, **settings: Any) -> None:
        columns = shutil.get_terminal_size().columns - 2
        super().__init__(prog, **{"width": min(columns, MAX_HELP_COLUMNS), **settings})

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        fill = super()._fill_text
        lines = text.splitlines()
        return "\n".join(s if s.startswith("  ") else fill(s, width, indent) for s in lines)


def _epilog(examples: Sequence[str], end: str) -> str:
    heading = ["examples:", *(f"  {line}" for line in examples), ""] if examples else []
    return "\n".join([*heading, end])


class _Version(argparse.Action):
    """Prints the version, which is determined only then."""

    def __init__(self, option_strings: Sequence[str], dest: str) -> None:
        text = "print the version of baxter-kin and exit"
        super().__init__(option_strings, dest, nargs=0, default=argparse.SUPPRESS, help=text)

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        from baxter_kin.distribution.version import NAME, version  # noqa: PLC0415 - reads files

        print(NAME, version())
        parser.exit()


# Types of arguments ------------------------------------------------------------------------------


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
    """The end of a message where a number makes sense in another unit."""
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
        if value < least or (most is not None and value > most):
            allowed = f"at least {least}" if most is None else f"from {least} to {most}"
            raise argparse.ArgumentTypeError(f"{text} is not {allowed}")
        return value

    return checked


def file_to_write(text: str) -> Path:
    """A file that can be written, as far as this can be known beforehand."""
    if not text:
        raise argparse.ArgumentTypeError("the file name is empty")
    path = Path(text)
    shown = text
    if len(text) > MAX_SHOWN_CHARACTERS:
        shown = f"{text[:MAX_SHOWN_CHARACTERS]}..."
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


def file_of_format(suffixes: Sequence[str]) -> Callable[[str], Path]:
    """The type of files to write whose suffix is one of these, which stand for formats."""

    def checked(text: str) -> Path:
        path = file_to_write(text)
        if path.suffix not in suffixes:
            known = ", ".join(suffixes)
            raise argparse.ArgumentTypeError(
                f"{text} must end in one of {known}, which say the format"
            )
        return path

    return checked


def urdf_file(text: str) -> Path:
    """A file with the URDF of a Baxter."""
    from baxter_kin.description import RobotDescription  # noqa: PLC0415 - loads Pinocchio

    path = Path(text)
    try:
        RobotDescription.of(path)
    except DescriptionError as cause:
        raise argparse.ArgumentTypeError(str(cause)) from None
    return path


def _hand(text: str) -> HandMount:
    from baxter_kin.description.hands import hand_of  # noqa: PLC0415 - loads Pinocchio

    try:
        return hand_of(text)
    except ConfigurationError as cause:
        raise argparse.ArgumentTypeError(str(cause)) from None


# Running -----------------------------------------------------------------------------------------


def run_process(main: Callable[[], int], name: str, failed: int) -> NoReturn:
    """Run a program as a process of its own, and end it with its status.

    Args:
        main: the program; returns its exit status.
        name: its name in messages.
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
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the work is done; nothing is left to interrupt
    if status in (EXIT_INTERRUPTED, EXIT_TERMINATED):
        # CPython remembers a KeyboardInterrupt inside exec(), which every dataclass uses, and would
        # end by the signal instead of with the status, although it was handled.
        os._exit(status)
    sys.exit(status)


SHOWN_EVERY_S = 0.1, 60.0
"""Interval of progress on a terminal, and elsewhere, as in the log of a batch system."""


@contextmanager
def progress(
    title: str, total: int, unit: str, *, is_quiet: bool = False
) -> Iterator[Callable[[int], object]]:
    """Show on stderr how much is done and the remaining time, by tqdm if it is installed.

    Gives a function of the number of units that were done since its last call.

    Args:
        title: what is done.
        total: number of all units.
        unit: such as "block".
        is_quiet: whether to show nothing.
    """
    if is_quiet or importlib.util.find_spec("tqdm") is None:
        yield lambda _: None
        return
    from tqdm import tqdm  # noqa: PLC0415 - only when shown

    every_s = SHOWN_EVERY_S[not sys.stderr.isatty()]
    with tqdm(
        desc=title,
        total=total,
        unit=f" {unit}s",
        delay=every_s,
        mininterval=every_s,
        leave=False,
        file=sys.stderr,
    ) as bar:
        yield bar.update


@contextmanager
def log_shown(
    on_info: Callable[[str], None],
    on_warning: Callable[[str], None],
    packages: tuple[str, ...] = ("baxter_kin",),
) -> Iterator[None]:
    """Show what packages log inside the block, such as that a compilation takes seconds.

    Args:
        on_info: receives messages below the level of warnings.
        on_warning: receives warnings, and errors.
        packages: their names, none inside of another.
    """
    loggers = [logging.getLogger(name) for name in packages]
    handler, levels = _LogHandler(on_info, on_warning), [logger.level for logger in loggers]
    for logger in loggers:
        logger.addHandler(handler)
        logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
            logger.removeHandler(handler)


class _LogHandler(logging.Handler):
    def __init__(self, on_info: Callable[[str], None], on_warning: Callable[[str], None]) -> None:
        super().__init__(logging.INFO)
        self._on_info, self._on_warning = on_info, on_warning

    def emit(self, record: logging.LogRecord) -> None:
        show = self._on_info if record.levelno < logging.WARNING else self._on_warning
        show(record.getMessage())
