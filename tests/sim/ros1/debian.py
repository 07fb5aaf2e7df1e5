"""ROS 1 as Debian has it; `python -m tests.sim.ros1.debian` exits with 1 where it is not there."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

PYTHON = "/usr/bin/python3"
"""Debian's packages are for Debian's Python, whatever runs the tests."""

PACKAGES = (
    "python3-rosmaster python3-rospy python3-rostopic python3-rosservice python3-genpy"
    " python3-actionlib python3-std-msgs python3-sensor-msgs python3-geometry-msgs ros-std-msgs"
    " python3-trajectory-msgs"
    " ros-sensor-msgs ros-geometry-msgs ros-trajectory-msgs ros-actionlib-msgs"
)
"""What the tests need of them."""

MODULES = "rosmaster, rospy, rostopic, rosservice, genpy, actionlib, sensor_msgs.msg"
PROGRAMS = ("rosmaster", "rostopic", "rosservice")
DEFINITIONS = Path("/usr/share")
STANDARD = ("std_msgs", "sensor_msgs", "geometry_msgs", "trajectory_msgs", "actionlib_msgs")
GENERATORS = {"msg": "/usr/lib/genpy/genmsg_py.py", "srv": "/usr/lib/genpy/gensrv_py.py"}

WITHIN_S = 120.0


def find_ros() -> str:
    """What is missing of it; empty when nothing is."""
    files = [*GENERATORS.values(), *(str(DEFINITIONS / name / "msg") for name in STANDARD)]
    missing = [path for path in (PYTHON, *files) if not Path(path).exists()]
    missing += [name for name in PROGRAMS if shutil.which(name) is None]
    if missing:
        return missing[0]
    command = [PYTHON, "-c", f"import {MODULES}"]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=WITHIN_S, check=False
        )
    except (OSError, subprocess.SubprocessError) as error:
        return str(error)
    return done.stderr.strip().rpartition("\n")[2] if done.returncode else ""


def generate_classes(folder: Path, messages: dict[str, str], services: dict[str, str]) -> None:
    """Have ROS's own generator make Python packages of definitions, below a folder."""
    for kind, texts in (("msg", messages), ("srv", services)):
        for name, text in texts.items():
            package, _, plain = name.partition("/")
            path = folder / "definitions" / package / kind / f"{plain}.{kind}"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text.lstrip("\n"))
    packages = sorted(path.name for path in (folder / "definitions").iterdir())
    places = {name: folder / "definitions" / name / "msg" for name in packages}
    places |= {name: DEFINITIONS / name / "msg" for name in STANDARD}
    includes = [f"-I{name}:{path}" for name, path in places.items()]
    for package in packages:
        (folder / package).mkdir()
        (folder / package / "__init__.py").touch()
        for kind, generator in GENERATORS.items():
            files = sorted((folder / "definitions" / package / kind).glob(f"*.{kind}"))
            if files:
                out = folder / package / kind
                _run(generator, f"-p{package}", f"-o{out}", *includes, *map(str, files))
                _run(generator, "--initpy", f"-p{package}", f"-o{out}")


def environment(master_uri: str, classes: Path) -> dict[str, str]:
    """What a process of ROS needs to find a master and classes, and to stay on this computer."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("ROS")}
    return kept | {
        "ROS_MASTER_URI": master_uri,
        "ROS_IP": "127.0.0.1",
        "ROS_LOG_DIR": str(classes / "log"),
        "PYTHONPATH": str(classes),
        "PYTHONUNBUFFERED": "1",
    }


def _run(*command: str) -> None:
    subprocess.run([PYTHON, *command], check=True, capture_output=True, timeout=WITHIN_S)


if __name__ == "__main__":
    sys.exit(find_ros() or 0)
