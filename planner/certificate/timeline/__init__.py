"""A plan followed step by step: where everything is, and which pairs must keep apart.

Everything is derived from the start and the steps; the states and contacts that the plan states are
compared with that. A witness adds numbers that are checked here: how far fingers close and push,
and how long a held body may touch its support.
"""

from planner.certificate.timeline.bodies import PRESS_M, STATE_TOLERANCE, Situation
from planner.certificate.timeline.contact import DROP_M, SLIDE_M, TOUCH_M, distance_m
from planner.certificate.timeline.steps import (
    A_MAX_RAD_S2,
    J_MAX_RAD_S3,
    MOTION,
    Limits,
    StepWitness,
    Timeline,
)
from planner.certificate.timeline.tip import TIP_TOLERANCE, TOGETHER_M, TOGETHER_RAD

__all__ = [
    "A_MAX_RAD_S2",
    "DROP_M",
    "J_MAX_RAD_S3",
    "MOTION",
    "PRESS_M",
    "SLIDE_M",
    "STATE_TOLERANCE",
    "TIP_TOLERANCE",
    "TOGETHER_M",
    "TOGETHER_RAD",
    "TOUCH_M",
    "Limits",
    "Situation",
    "StepWitness",
    "Timeline",
    "distance_m",
]
