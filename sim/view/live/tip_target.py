"""A tip target to move by hand, in a notebook or a program: the arm in a live view follows it.

```python
viewer = Viewer(robot)
target = TipTarget(viewer, robot, "left")
target.sliders()  # in a notebook
target.set(0.7, 0.2, 0.1, math.pi, 0.0, 0.0)  # anywhere
```
"""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin

from baxter_kin import Baxter, IKResult, IKService, SeedMode
from baxter_kin.display import OneLine, position
from baxter_kin.distribution.extras import run_to_install
from baxter_kin.fields import NotCopied
from baxter_kin.validation import FloatArray, expect, finite_scalar
from planner import Body
from planner.scene.bodies import Cylinder, Part
from sim.errors import ViewerError
from sim.view.live.viewer import Viewer

AXIS_LENGTH_M = 0.12
AXIS_RADIUS_M = 0.005

SLIDER_RANGES_M = {"x": (-0.3, 1.3), "y": (-1.4, 1.4), "z": (-0.9, 1.3)}
"""Ranges a little beyond the reach of either arm, in base."""

SLIDER_STEP_M = 0.005
SLIDER_STEP_DEG = 1.0

_Rgba: TypeAlias = tuple[float, float, float, float]

_AXIS_RGBA: tuple[_Rgba, ...] = (
    (0.85, 0.1, 0.1, 1.0),
    (0.1, 0.65, 0.15, 1.0),
    (0.1, 0.3, 0.9, 1.0),
)
_UNREACHABLE_RGBA: _Rgba = (0.95, 0.0, 0.0, 1.0)


class TipTarget(NotCopied, OneLine):
    """A target pose of one arm's tip, drawn as three axes: x red, y green, z blue.

    All three are red while the pose cannot be reached; the caption then states the reason, and the
    arm stays at the last reachable pose. Several targets, as for both arms, may share a view.

    Attributes:
        T_base_target: the latest target, seen from base; at first the pose of the tip.
        result: the result of inverse kinematics for it; None before the first.
    """

    def __init__(self, viewer: Viewer, robot: Baxter, side: str) -> None:
        """Begin with the arm as the view shows it.

        Args:
            viewer: the view of the arm and the target.
            robot: the robot in it.
            side: "left" or "right".
        """
        self._viewer = expect(viewer, Viewer, "viewer", ViewerError)
        self._arm = expect(robot, Baxter, "robot", ViewerError).arm(side)
        self._ik = IKService(self._arm)
        self._joints = list(robot.indices(self._arm.joint_names))
        self.T_base_target = self._arm.T_base_tip(viewer.q[self._joints])
        self.result: IKResult | None = None
        self._name = f"{side} target"
        self._show_axes(is_reachable=True)

    def _facts(self) -> tuple[str, ...]:
        return self._name, f"at {position(self.T_base_target)}"

    def set(  # noqa: PLR0917 - a pose has six numbers, in an order everybody knows
        self, x: float, y: float, z: float, roll: float, pitch: float, yaw: float
    ) -> IKResult:
        """Move the target, solve for the joints from where they are, and show both.

        Args:
            x: position in base along x, m.
            y: position along y, m.
            z: position along z, m.
            roll: rotation about base's x axis, the first of three about fixed axes, rad.
            pitch: then about base's y axis, rad.
            yaw: then about base's z axis, rad.

        Returns:
            The solution, or the reason why there is none.

        Raises:
            ViewerError: when a number is not finite, or the view is closed.
        """
        given = {"x": x, "y": y, "z": z, "roll": roll, "pitch": pitch, "yaw": yaw}
        checked = [finite_scalar(value, name, ViewerError) for name, value in given.items()]
        self.T_base_target = pin.SE3(pin.rpy.rpyToMatrix(*checked[3:]), np.array(checked[:3]))
        q, side = self._viewer.q, self._arm.side
        result = self._ik.solve(self.T_base_target, current=q[self._joints], mode=SeedMode.AUTO)
        self.result = result
        self._show_axes(is_reachable=result.is_valid)
        if result.is_valid:
            q[self._joints] = result.q
            self._viewer.show(q, {}, f"{side} tip at its target", seed=result.label)
        else:
            self._viewer.show(q, {}, f"{side} tip: {result.failure}")
        return result

    def sliders(self) -> Any:
        """Six sliders that move the target, as an ipywidgets box; angles in degrees.

        Raises:
            ViewerError: when ipywidgets is not installed.
        """
        try:
            import ipywidgets  # noqa: PLC0415 - only notebooks need it
        except ImportError as cause:
            raise ViewerError(
                f"the sliders need ipywidgets; {run_to_install('ipywidgets')}"
            ) from cause
        angles = dict.fromkeys(("roll", "pitch", "yaw"), (-180.0, 180.0))
        values = [
            *self.T_base_target.translation.tolist(),
            *np.degrees(pin.rpy.matrixToRpy(self.T_base_target.rotation)).tolist(),
        ]
        sliders = [
            ipywidgets.FloatSlider(
                description=f"{name} (°)" if name in angles else f"{name} (m)",
                value=value,
                min=low,
                max=high,
                step=SLIDER_STEP_DEG if name in angles else SLIDER_STEP_M,
            )
            for (name, (low, high)), value in zip(
                (SLIDER_RANGES_M | angles).items(), values, strict=True
            )
        ]

        def move(_change: object) -> None:
            x, y, z, *angles_deg = (slider.value for slider in sliders)
            self.set(x, y, z, *map(math.radians, angles_deg))

        for slider in sliders:
            slider.observe(move, names="value")
        return ipywidgets.VBox(sliders)

    def remove(self) -> None:
        """Remove the axes from the view; the arm stays."""
        self._viewer.remove_body(self._name)

    def _show_axes(self, *, is_reachable: bool) -> None:
        parts = tuple(
            _axis(direction, rgba if is_reachable else _UNREACHABLE_RGBA)
            for direction, rgba in zip(np.eye(3), _AXIS_RGBA, strict=True)
        )
        self._viewer.add_body(Body(self._name, parts, self.T_base_target))


def _axis(direction: FloatArray, rgba: _Rgba) -> Part:
    """A rod from the origin along one of the axes."""
    R = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), direction).toRotationMatrix()
    middle = AXIS_LENGTH_M / 2 * direction
    return Part(Cylinder(AXIS_RADIUS_M, AXIS_LENGTH_M), pin.SE3(R, middle), rgba)
