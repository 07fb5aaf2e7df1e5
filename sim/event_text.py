"""What is said of an event: one readable phrase with names and numbers."""

from __future__ import annotations

from planner.grasping import Grasp
from planner.grasping.grasp import Miss
from sim.world.contacts import Contact
from sim.world.falling import Rest
from sim.world.pushing import Push

FULLY = 99.9
"""Per cent from which on a gripper is called open, without saying how far."""


def of_grasp(body: str, grasp: Grasp, percent: float) -> str:
    """A body was grasped; near an edge, how much of a pad is on it."""
    width = f"{1e3 * grasp.width_m:.1f} mm between the finger pads"
    text = f"{body} grasped, {width} ({percent:.0f} % open)"
    if not grasp.is_near_edge:
        return text
    on, off = f"{1e3 * grasp.pad_m:.1f} mm", f"{1e3 * grasp.centre_off_m:.1f} mm"
    return (
        f"{text}, near an edge: only {on} of a finger pad on it, its centre {off} outside of them"
    )


def of_opening(side: str, percent: float) -> str:
    """The empty hand opened; how far, unless all the way."""
    return f"{side} gripper open" + ("" if percent >= FULLY else f", {percent:.0f} %")


def of_miss(miss: Miss | None, wanted: str | None, gap_m: float, *, is_closed: bool) -> str:
    """Nothing was grasped, and why."""
    how = "closed fully" if is_closed else "stopped"
    on = f" on {wanted}" if wanted else ""
    reason = f": {miss}" if miss is not None else ""
    return f"missed: the fingers {how}{on}, {1e3 * gap_m:.1f} mm apart, and hold nothing{reason}"


def of_push(push: Push, side: str) -> str:
    """A closing finger pushed a body, or what it pushed did."""
    finger = f"the {push.finger} finger of the {side} hand"
    by = finger if push.by == f"{push.finger} finger" else f"{push.by}, which {finger} pushes"
    return f"{push.body} pushed {1e3 * push.distance_m:.1f} mm by {by}"


def of_contact(contact: Contact, side: str) -> str:
    """Something was run into."""
    what = _what(contact, side)
    if contact.stops:
        return f"{what} would pass through {_the(contact.other)}; the arm stops before it"
    return f"{what} hit {contact.other}, which is left where it is"


def of_stop(contact: Contact, side: str) -> str:
    """Why a move ended early."""
    return f"{_what(contact, side)} would pass through {_the(contact.other)}"


def of_rest(body: str, rest: Rest) -> str:
    """A body came to rest."""
    text = f"{body} at rest on {rest.support}"
    if rest.fell_off:
        text += f"; it tipped off {' and '.join(rest.fell_off)}"
    if rest.beside_m > 0.0:
        text += f"; it leans, its centre {1e3 * rest.beside_m:.1f} mm outside of what it stands on"
    return text


def _what(contact: Contact, side: str) -> str:
    if contact.is_held:
        return f"the held {contact.mover}"
    is_hand = "gripper" in contact.mover or "hand" in contact.mover
    return f"the {side} {'hand' if is_hand else 'arm'} ({contact.mover})"


def _the(name: str) -> str:
    return f"the {name}"
