"""Check the certificate in a file: `python -m planner.certificate FILE --urdf FILE`.

The file holds a plan (`planner.save_plan`), one of both arms (`planner.save_two_arm_plan`) or a
motion (`MotionCertificate.save`).

Exit status: 0 certified, 1 not certified, 2 wrong usage or a file that cannot be read. Needs NumPy
and nothing else. The URDF of a real robot is its parameter `/robot_description`; `python -m
baxter_kin.description` prints that of the stock robot.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from planner.certificate.checking import (
    TWO_ARM_FORMAT,
    Certified,
    check,
    check_both,
    read_plan,
)
from planner.certificate.errors import NotCertifiedError
from planner.certificate.timeline import A_MAX_RAD_S2, J_MAX_RAD_S3, Limits


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m planner.certificate",
        description="Check the certificate in a file of a plan or a motion, with NumPy alone.",
    )
    parser.add_argument("plan", type=Path, metavar="PLAN", help="file with a certificate")
    parser.add_argument("--urdf", type=Path, required=True, metavar="FILE", help="the robot's URDF")
    parser.add_argument(
        "--a-max", type=float, default=A_MAX_RAD_S2, help="of plans, rad/s^2, default %(default)s"
    )
    parser.add_argument(
        "--j-max", type=float, default=J_MAX_RAD_S3, help="of plans, rad/s^3, default %(default)s"
    )
    options = parser.parse_args(arguments)
    try:
        content, urdf = options.plan.read_bytes(), options.urdf.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as cause:
        print(f"planner.certificate: {cause}", file=sys.stderr)
        return 2
    try:
        limits, document = Limits(options.a_max, options.j_max), read_plan(content)
        if document["format"] == TWO_ARM_FORMAT:
            parts = check_both(document, urdf, limits=limits)
        else:
            parts = {"": check(document, urdf, limits=limits)}
    except NotCertifiedError as reason:
        print(f"not certified: {reason}")
        return 1
    for name, found in parts.items():
        print(*filter(None, (name, _table(found))), sep="\n")
    return 0


def _table(found: Certified) -> str:
    rows = [f"{label:32} {1e3 * clear:9.3f} mm" for label, clear in found.clearances_m]
    of_hands = [(name, value) for name, (value, _) in found.worst.items() if "hands in" in name]
    units = {"distance": "m", "turn": "rad"}
    rows += [f"{name:32} {value:9.2g} {units[name.split()[0]]}" for name, value in of_hands]
    rows += [f"assumed: {each}" for each in found.assumed]
    rows += [f"not judged: limits of {each}" for each in found.not_judged]
    end = f"certified: {1e3 * found.clearance_m:.3f} mm at every instant, {found.rows} rows"
    return "\n".join([*rows, end])


if __name__ == "__main__":
    sys.exit(main())
