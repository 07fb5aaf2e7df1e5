"""Which browser draws the tests' pages; `python -m tests.chromium` exits with 1 if none does."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
OWN = """
from playwright.sync_api import sync_playwright
with sync_playwright() as playwright:
    print(playwright.chromium.executable_path)
"""
"""Asked in another process: Playwright starts only once in each."""

ANSWERS_WITHIN_S = 60.0


def find_chromium() -> str | None:
    """A Chromium that starts: one on PATH, or else Playwright's own; None where there is none.

    None, too, where Playwright does not start, which drives it.
    """
    own = playwrights_own()
    if own is None:
        return None
    on_path = filter(None, map(shutil.which, NAMES))
    return next((path for path in (*on_path, own) if _says(path, "--version") is not None), None)


def at_usual_priority(path: str, folder: Path) -> str:
    """A program in that folder that starts a Chromium which cannot raise its own priority.

    Where it may, as root, its drawing goes before all else on the machine, and tests in real time
    that run beside it come late. Without `setpriv`, of util-linux, the path as it is.
    """
    if os.geteuid() != 0 or shutil.which("setpriv") is None:
        return path
    starter = folder / "chromium"
    kept = "setpriv --bounding-set=-sys_nice --inh-caps=-sys_nice --"
    starter.write_text(f'#!/bin/sh\nexec {kept} "{path}" "$@"\n', "utf-8")
    starter.chmod(0o755)
    return str(starter)


def playwrights_own() -> str | None:
    """Where `playwright install chromium` puts one; None where Playwright does not start."""
    path = _says(sys.executable, "-c", OWN)
    return None if path is None else path.strip()


def _says(*command: str) -> str | None:
    """What a program prints; None where it, or a library that it needs, is not there."""
    try:
        return subprocess.run(
            command, check=True, capture_output=True, text=True, timeout=ANSWERS_WITHIN_S
        ).stdout
    except (OSError, subprocess.SubprocessError):
        return None


if __name__ == "__main__":
    sys.exit(find_chromium() is None)
