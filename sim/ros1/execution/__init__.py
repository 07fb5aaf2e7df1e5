"""Execution of verified plans on a Baxter that speaks ROS 1, real or simulated.

`link` holds what the robot reports, `readiness` decides whether a plan may be executed, `execution`
sends it: `set_points` at 100 Hz through the publishers of `channel`. `guard` and `stops` end it
early; `twin` informs observers. `identification` measures how an arm lags.
"""
