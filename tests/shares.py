"""Hooks of pytest: a share of the slow tests among those collected, with `--slow-share K/N`.

Campaigns are slow tests, too.
"""

from __future__ import annotations

import zlib

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--slow-share", metavar="K/N", help="one Nth of the slow tests, another one for each K"
    )


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    share = config.getoption("--slow-share")
    if share is None:
        return
    number, shares = map(int, share.split("/"))
    chosen: list[pytest.Item] = []
    others: list[pytest.Item] = []
    for item in items:
        of_item = zlib.crc32(item.nodeid.encode()) % shares
        is_slow = any(item.get_closest_marker(name) for name in ("slow", "campaign"))
        is_chosen = not is_slow or of_item == number % shares
        (chosen if is_chosen else others).append(item)
    items[:] = chosen
    config.hook.pytest_deselected(items=others)
