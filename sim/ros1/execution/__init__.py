"""Carries out verified plans on a Baxter that speaks ROS 1, real or simulated.

`preflight` and `readiness` say whether a plan may be carried out, `executor` does it: `link` is
what is heard and sent, `stream` what is sent when, `guard` what ends it early, and `stops` the
names of that.
"""
