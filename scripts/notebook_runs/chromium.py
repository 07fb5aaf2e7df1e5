"""Chromium as scripts take pictures with it: without a window and without a graphics card."""

from __future__ import annotations

import shutil

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")

FLAGS = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


def chromium_on_path() -> str | None:
    """Where it is; None where there is none, so that Playwright takes its own."""
    return next(filter(None, map(shutil.which, NAMES)), None)
