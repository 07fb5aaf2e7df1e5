"""
Write on the table
==================

A text becomes strokes of a pen, and these one motion of the arm, which rounds the corners of the
letters by up to a millimetre instead of stopping at them.
"""

import matplotlib.pyplot as plt
import numpy as np

from sim import Workbench, text_strokes

# %%
# The letters are those of a font of single lines. They stand so that the robot can read them.

bench = Workbench()
task = bench.draw("KIN")
print(task)

# %%
# The plan states the path and the tolerance, 1 mm and 0.5 deg; they are proven at every instant.

move = task.plan.moves[-1]
print(f"{move.path.length_m:.2f} m in {move.trajectory.duration:.1f} s")

# %%
# The strokes that were asked for, and the way of the tip, also where the pen is up.

arm = bench.robot.arm(task.arm)
times_s = np.linspace(0.0, move.trajectory.duration, 3000)
tips = arm.T_base_tips(move.trajectory.sample(times_s).q)[:, :3, 3]
figure, axes = plt.subplots(figsize=(7, 2), layout="constrained")
for stroke in text_strokes("KIN"):
    axes.plot(-stroke[:, 1], stroke[:, 0], color="0.8", linewidth=5, solid_capstyle="round")
axes.plot(-tips[:, 1], tips[:, 0], linewidth=0.8)
axes.set(xlabel="-y in base, m", ylabel="x in base, m", aspect="equal")
plt.show()

# %%
# The replay draws the ink as the pen touches the table. "Tolerances" in the panel shows how far the
# tip is from its path.

bench.replay()
