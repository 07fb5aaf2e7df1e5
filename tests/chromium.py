"""Which browser draws the tests' pages; `python -m tests.chromium` exits with 1 if none does."""

from __future__ import annotations

import shutil
import subprocess
import sys

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
