"""Change one thing in certified plans, and check that no wrong plan remains certified.

    python scripts/try_mutants.py --count 10000 --seed 35

A number, a key, a letter, a direction, a byte of the file or a number of the URDF is changed at
random. A mutant must be refused in one sentence, or be certified correctly: then the independent
referee (`referee`) must accept it, too, and a changed robot must reach the same poses. Afterwards
huge files are checked by the command, each in a separate process. The exit status is 1 when a
mutant is certified wrongly, is refused by anything but one sentence, or takes longer than `MAX_S`
or more memory than `MAX_BYTES`.
"""

from __future__ import annotations

import argparse
import base64
import copy
import hashlib
import json
import re
import subprocess
import sys
import tempfile
import time
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from referee.checker import check_plan
from referee.problems import FAMILIES, make_problem, planned
from tqdm import tqdm

from baxter_kin.description import RobotDescription
from baxter_kin.errors import BaxterError
from planner import Plan, load_plan
from planner.certificate.body import Body
from planner.certificate.checking import check, read_plan
from planner.certificate.errors import NotCertifiedError
from planner.plan_file import plan_document
from planner.verification import certificate_of

MAX_S, MAX_BYTES = 10.0, 500 * 2**20

SAME_M = 1e-5
"""Maximum change of the tip's position of a changed robot whose plan is certified."""

Data = dict[str, Any]


def main(argv: Sequence[str] | None = None) -> int:
    """Check mutants and print a summary; returns the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=35)
    parser.add_argument("--plans", type=int, default=10, help="how many plans are changed")
    options, outcomes, wrong, slowest_s = parser.parse_args(argv), Counter[str](), [], 0.0
    rng, text = np.random.default_rng(options.seed), RobotDescription.of().text
    body, plans = Body(text), list(certified_plans(options.seed, options.plans))
    for number in tqdm(range(options.count), unit="mutant"):
        kind = list(MUTATIONS)[number % len(MUTATIONS)]
        mutant = Mutant(copy.deepcopy(plans[number % len(plans)]), text)
        what, began_s = MUTATIONS[kind](rng, mutant), time.process_time()
        outcome, took_s = judged(mutant, body), time.process_time() - began_s
        slowest_s = max(slowest_s, took_s)
        outcomes[f"{kind}: {outcome.split(':')[0]}"] += 1
        if outcome.startswith("WRONG") or took_s > MAX_S:
            wrong.append(f"{number} {kind}, {what}: {outcome}")
    for name, count in sorted(outcomes.items()):
        print(f"{count:6} {name}")
    print(f"slowest: {slowest_s:.2f} s")
    for name, content in endless_files(plans[0]):
        seconds, peak, said = by_command(content, text)
        line = f"{name:28} {seconds:5.1f} s {peak / 2**20:6.0f} MB  {said[:90]}"
        print(line)
        if seconds > MAX_S or peak > MAX_BYTES or not said.startswith("not certified: "):
            wrong.append(line)
    print(*wrong, sep="\n")
    return 1 if wrong else 0


def certified_plans(seed: int, count: int) -> Iterator[Data]:
    """Documents of certified plans of all families."""
    families, number = list(FAMILIES), 0
    while count:
        plan = planned(make_problem(families[number % len(families)], number, seed))
        number += 1
        if plan.failure is None:
            count -= 1
            yield {**plan_document(plan), "certificate": certificate_of(plan)}


class Mutant:
    """A plan file and a URDF, in which one thing is changed."""

    def __init__(self, document: Data, urdf: str) -> None:
        self.document, self.urdf = document, urdf
        self.content: bytes | None = None

    @property
    def file(self) -> bytes:
        """The plan file."""
        return json.dumps(self.document).encode() if self.content is None else self.content


# Mutations


def _leaves(data: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Paths to all numbers, strings and truth values."""
    if isinstance(data, dict | list):
        items = data.items() if isinstance(data, dict) else enumerate(data)
        for key, value in items:
            yield from _leaves(value, (*path, key))
    else:
        yield path


def _holder(data: Any, path: tuple[Any, ...]) -> Any:
    for key in path[:-1]:
        data = data[key]
    return data


def _pick(rng: np.random.Generator, of: list[Any]) -> Any:
    return of[int(rng.integers(len(of)))]


def _changed(rng: np.random.Generator, value: float) -> float:
    """A different number: nearly the same, of opposite sign, zero, or an extreme value."""
    nearly = value * (1.0 + 10.0 ** rng.uniform(-12.0, 0.0))
    off = value + 10.0 ** rng.uniform(-9.0, 1.0) * rng.choice([-1.0, 1.0])
    odd = float(rng.choice([np.nan, np.inf, 1e308, -1e308, 5e-324, 1e5]))
    return float(_pick(rng, [nearly, off, -value, 0.0, odd]))


def change_number(rng: np.random.Generator, mutant: Mutant) -> str:
    """Change a number of the plan, of its states or of its certificate."""
    data = mutant.document[part := _pick(rng, ["plan", "plan", "states", "certificate"])]
    numbers = [p for p in _leaves(data) if type(_holder(data, p)[p[-1]]) in (float, int)]
    path = _pick(rng, numbers)
    holder, key = _holder(data, path), path[-1]
    before, holder[key] = holder[key], _changed(rng, float(holder[key]))
    return f"{part} {path}: {before} -> {holder[key]}"


def change_entry(rng: np.random.Generator, mutant: Mutant) -> str:
    """Remove or duplicate an entry, or change its type."""
    path = _pick(rng, list(_leaves(mutant.document)))
    path = path[: int(rng.integers(1, len(path) + 1))]
    holder, key = _holder(mutant.document, path), path[-1]
    how = _pick(rng, ["gone", "twice", "none", "text", "list", "table", "true"])
    if how == "gone":
        del holder[key]
    elif how == "twice" and isinstance(holder, list):
        holder.insert(key, copy.deepcopy(holder[key]))
    else:
        other: dict[str, Any] = {"none": None, "text": "x", "list": [], "table": {}, "true": True}
        holder[key] = other.get(how)
    return f"{path} {how}"


def change_byte(rng: np.random.Generator, mutant: Mutant) -> str:
    """Truncate the file, or change a byte."""
    content = bytearray(mutant.file)
    at = int(rng.integers(len(content)))
    if rng.random() < 0.3:
        mutant.content = bytes(content[:at])
        return f"cut off at {at}"
    content[at] = int(rng.integers(256))
    mutant.content = bytes(content)
    return f"byte {at}"


def change_trace(rng: np.random.Generator, mutant: Mutant) -> str:
    """Change a letter or a direction of the certificate."""
    certificate = mutant.document["certificate"]
    columns = [key for key in ("letters", "directions", "fine") if len(_unpacked(certificate[key]))]
    key = _pick(rng, columns)
    content = bytearray(_unpacked(certificate[key]))
    at = int(rng.integers(len(content)))
    content[at] = int(rng.integers(6)) if key == "letters" else int(rng.integers(256))
    certificate[key] = base64.b64encode(zlib.compress(bytes(content))).decode()
    return f"{key} {at}"


def change_robot(rng: np.random.Generator, mutant: Mutant) -> str:
    """Change a number of the URDF."""
    numbers = list(re.finditer(r"(?<=[\" ])-?\d+\.?\d*(?:e-?\d+)?(?=[\" ])", mutant.urdf))
    found = _pick(rng, numbers)
    other = repr(_changed(rng, float(found[0])))
    mutant.urdf = mutant.urdf[: found.start()] + other + mutant.urdf[found.end() :]
    return f"URDF at {found.start()}: {found[0]} -> {other}"


MUTATIONS: dict[str, Callable[[np.random.Generator, Mutant], str]] = {
    "number": change_number,
    "entry": change_entry,
    "byte": change_byte,
    "trace": change_trace,
    "robot": change_robot,
}


def _unpacked(text: str) -> bytes:
    return zlib.decompress(base64.b64decode(text))


# Verdicts


def judged(mutant: Mutant, body: Body) -> str:
    """The verdict of the checker; it starts with WRONG if it is wrong."""
    try:
        document = read_plan(mutant.file)
        stock = mutant.urdf == RobotDescription.of().text
        check(document, mutant.urdf, body=body if stock else None)
    except NotCertifiedError as reason:
        return f"refused: {reason}" if "\n" not in str(reason) else f"WRONG: {reason}"
    except Exception as cause:  # any exception is wrong
        return f"WRONG: {type(cause).__name__}: {cause}"
    if not stock:
        try:
            away_m = _moved_m(document, mutant.urdf)
        except ValueError:
            return "certified, not read by Pinocchio"
        return f"WRONG: reaches {away_m} m elsewhere" if away_m > SAME_M else "certified"
    try:
        plan = _loaded(dict(document))
    except BaxterError:
        return "certified, not read by the planner"
    found = check_plan(plan)
    return f"WRONG: {found[0]}" if found else "certified"


def _loaded(document: Data) -> Plan:
    document.pop("certificate")
    document["sha256"] = "0" * 64
    content = json.dumps(document)
    content = content.replace("0" * 64, hashlib.sha256(content.encode()).hexdigest(), 1)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "plan.json")
        path.write_text(content, "utf-8")
        return load_plan(path)


def _moved_m(document: Any, urdf: str) -> float:
    """Maximum change of the tip's position at the knots of a plan, for a changed robot."""
    model, stock = (pin.buildModelFromXML(x) for x in (urdf, RobotDescription.of().text))
    tip, most = f"{document['plan']['limb']}_gripper", 0.0
    for step in document["plan"]["steps"]:
        for q in step["trajectory"]["q"] if step["type"] == "Move" else ():
            names = step["trajectory"]["limits"]["names"]
            places = [_tip_m(each, tip, names, q) for each in (model, stock)]
            most = max(most, float(np.linalg.norm(places[0] - places[1])))
    return most


def _tip_m(model: pin.Model, tip: str, names: list[str], q: list[float]) -> Any:
    full, data = pin.neutral(model), model.createData()
    for name, value in zip(names, q, strict=True):
        full[model.joints[model.getJointId(name)].idx_q] = value
    pin.framesForwardKinematics(model, data, full)
    return data.oMf[model.getFrameId(tip)].translation


# Huge files


COMMAND = """
import sys, time
from planner.certificate.__main__ import main
status = main(sys.argv[1:])
peak = next(x for x in open("/proc/self/status") if x.startswith("VmHWM"))
print(peak.split()[1], time.process_time())
"""
"""Prints its own peak memory, in kB, and processor time, in s, after the output of the command."""


def by_command(content: bytes, urdf: str) -> tuple[float, int, str]:
    """Check a file by the command: its processor time (s), peak memory (bytes) and output."""
    with tempfile.TemporaryDirectory() as folder:
        plan, robot = Path(folder, "plan.json"), Path(folder, "robot.urdf")
        plan.write_bytes(content)
        robot.write_text(urdf, "utf-8")
        command = [sys.executable, "-c", COMMAND, str(plan), "--urdf", str(robot)]
        said = subprocess.run(command, capture_output=True, text=True, check=False).stdout
    *lines, figures = said.splitlines() or ["0 0"]
    peak, spent_s = figures.split()
    return float(spent_s), int(peak) * 1024, "\n".join(lines)


def endless_files(document: Data) -> Iterator[tuple[str, bytes]]:
    """Descriptions and contents of huge files."""

    def packed(content: bytes) -> str:
        return base64.b64encode(zlib.compress(content, 9)).decode()

    def changed(change: Callable[[Data, Data], object]) -> bytes:
        """The file after a change of the document and the bodies of its scene."""
        data = copy.deepcopy(document)
        change(data, data["plan"]["start"]["scene"]["bodies"])
        return json.dumps(data).encode()

    bomb, letters = packed(b"\x00" * 300_000_000), packed(b"\x05" * 1_900_000)
    for key in ("letters", "directions", "fine"):
        certificate = {**document["certificate"], key: bomb}
        yield f"300 MB of {key}", changed(lambda data, _, c=certificate: data.update(certificate=c))
    certificate = {**document["certificate"], "letters": letters}
    yield "time cut for ever", changed(lambda data, _: data.update(certificate=certificate))
    yield "lists in lists", b"[" * 1_000_000
    yield "a number of a million digits", b'{"format": ' + b"1" * 1_000_000 + b"}"
    steps = document["plan"]["steps"] * 2000
    yield "steps", changed(lambda data, _: data["plan"].update(steps=steps))[: 31 * 2**20]
    body = next(iter(document["plan"]["start"]["scene"]["bodies"].values()))
    more = {f"more{number}": body for number in range(2000)}
    yield "bodies", changed(lambda _, bodies: bodies.update(more))
    vertices = np.random.default_rng(1).uniform(-0.1, 0.1, (1000, 3)).round(4).tolist()
    for count in (90_000, 200_000):
        corners = np.random.default_rng(2).integers(0, 1000, (count, 3)).tolist()
        mesh = {"type": "Mesh", "vertices": vertices, "triangles": corners}
        first = {**body, "parts": [{**body["parts"][0], "shape": mesh}, *body["parts"][1:]]}
        yield (
            f"{count} triangles",
            changed(lambda _, bodies, b=first: bodies.update({next(iter(bodies)): b})),
        )
    yield "40 MB", b" " * (40 * 2**20)


if __name__ == "__main__":
    sys.exit(main())
