"""What speaks against a plan."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong.

    Attributes:
        kind: what, such as "touches" or "closer than the margin".
        label: during which step.
        time_s: since that step began.
        first: link or body.
        second: link or body; empty when it is about one alone.
        amount: how deep in metres where that is known, how close, how far; else nan.
        detail: numbers in words, if there are more.
    """

    kind: str
    label: str
    time_s: float
    first: str
    second: str
    amount: float
    detail: str = ""

    def __str__(self) -> str:
        pair = f"{self.first} - {self.second}" if self.second else self.first
        more = f", {self.detail}" if self.detail else ""
        return f"{self.label} at {self.time_s:.3f} s: {pair}: {self.kind} ({self.amount:.3g}{more})"
