"""Hooks of pytest: a share of the collected tests, with `--share K/N`."""

from __future__ import annotations

import zlib

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--share", metavar="K/N", help="one Nth of the tests, another one for each K")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    share = config.getoption("--share")
    if share is None:
        return
    number, shares = map(int, share.split("/"))
    chosen: list[pytest.Item] = []
    others: list[pytest.Item] = []
    for item in items:
        of_item = zlib.crc32(item.nodeid.encode()) % shares
        (chosen if of_item == number % shares else others).append(item)
    items[:] = chosen
    config.hook.pytest_deselected(items=others)
