"""Certificates of plans and motions: every limit, pose and clearance, by independent code.

`python -m planner.verification FILE` checks a saved plan; see `planner.verification.command_line`.
"""

import baxter_kin.kinematics.pinocchio_loading  # noqa: F401 - its error names what is missing
from planner.verification.both_arms import TwoArmCertificate, certificate_of_both, verify_both
from planner.verification.certificate import Certificate, Check, Relation
from planner.verification.inspection import verify
from planner.verification.motion_certificate import MotionCertificate, PolynomialMotion, certify
from planner.verification.witness import certificate_of

__all__ = [
    "Certificate",
    "Check",
    "MotionCertificate",
    "PolynomialMotion",
    "Relation",
    "TwoArmCertificate",
    "certificate_of",
    "certificate_of_both",
    "certify",
    "verify",
    "verify_both",
]
