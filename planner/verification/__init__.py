"""Plan -> Certificate: every limit, pose and clearance, proven by code that did not plan.

`python -m planner.verification FILE` checks a saved plan; see `planner.verification.command_line`.
"""

import baxter_kin.kinematics.pinocchio_loading  # noqa: F401 - says what it lacks, before all others
from planner.verification.certificate import Certificate, Check, Relation
from planner.verification.inspection import verify
from planner.verification.motion_certificate import MotionCertificate, PolynomialMotion, certify
from planner.verification.prover import certificate_of

__all__ = [
    "Certificate",
    "Check",
    "MotionCertificate",
    "PolynomialMotion",
    "Relation",
    "certificate_of",
    "certify",
    "verify",
]
