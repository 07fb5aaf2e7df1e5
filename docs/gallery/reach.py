"""
Where an arm reaches
====================

At which positions can the left hand point down, at the height of the table? Some thousand poses are
each solved to a thousandth of a millimetre or refused with a reason, in a fraction of a second.
"""

import matplotlib.pyplot as plt
import numpy as np

from baxter_kin import Baxter, IKService, pose_from_quaternion

DOWN = (0.0, 1.0, 0.0, 0.0)  # x, y, z, w
xs, ys = np.linspace(0.2, 1.2, 51), np.linspace(-0.7, 1.2, 96)
poses = [pose_from_quaternion((x, y, -0.13), DOWN) for y in ys for x in xs]

# %%
# `baxter_kin.IKService.solve_batch` solves them in one call.

arm = Baxter.load().arm("left")
results = IKService(arm).solve_batch(poses)
solved = np.array([result.is_valid for result in results]).reshape(len(ys), len(xs))
print(f"{solved.sum()} of {solved.size} poses have a solution")
print(results[-1].failure)

# %%
# The distance of the nearest joint from its limits. At pale positions the arm can hardly move
# farther.

middle, half = (arm.limits.q_max + arm.limits.q_min) / 2, (arm.limits.q_max - arm.limits.q_min) / 2
margin = np.array(
    [
        1.0 - np.abs((result.q - middle) / half).max() if result.is_valid else np.nan
        for result in results
    ]
).reshape(solved.shape)
figure, axes = plt.subplots(figsize=(6, 7), layout="constrained")
image = axes.pcolormesh(ys, xs, 100.0 * margin.T, cmap="viridis_r", vmin=0.0)
axes.plot(0.0, 0.0, "k^", markersize=10, label="base")
axes.invert_xaxis()
axes.set(xlabel="y in base, m (left is left)", ylabel="x in base, m (ahead)", aspect="equal")
axes.set_title("Left hand pointing down, 25 mm above the table")
axes.legend()
figure.colorbar(image, label="margin to the nearest joint limit, % of half the range")
plt.show()
