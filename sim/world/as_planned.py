"""As planned: whether a world is as a plan has it, so that what was proven of the plan counts."""

from __future__ import annotations

from planner import Body, Plan
from planner.pick_place.phases import LONGEST_DROP_M
from planner.scene.held import Held
from sim.world.falling import Rest
from sim.world.world import World

AS_PLANNED = 1e-6
"""How far joints (rad, m) and bodies (m, and of rotation matrices) may be from where a plan has
them for its proofs to count; they keep far more distance than that."""


def is_as_planned(world: World, plan: Plan) -> bool:
    """Whether a world is as a plan has it before its first step, so that its proofs count."""
    situation = plan.situation
    if situation is None or not _is_held_alike(world.held, situation.held):
        return False
    own = world.robot.arm(plan.limb).joint_names
    joints = dict(zip(world.robot.joint_names, world.q.tolist(), strict=True))
    planned = situation.joints
    return (
        joints.keys() == planned.keys()
        and all(name in own or abs(joints[name] - planned[name]) <= AS_PLANNED for name in joints)
        and situation.scene.bodies.keys() == world.scene.bodies.keys()
        and all(_is_same(world.body(body.name), body) for body in situation.scene)
    )


def falls_as_planned(world: World, name: str, rest: Rest) -> bool:
    """Whether a body that is let go rests as a plan expects: level, on what is just below it."""
    stands = len(rest.legs) == 1 and rest.beside_m == 0.0
    return stands and rest.fall_m <= LONGEST_DROP_M and not world.riders(name)


def _is_held_alike(held: tuple[Held, ...], planned: tuple[Held, ...]) -> bool:
    """Whether the hands hold the same bodies in the same places."""
    expected = {holding.side: holding for holding in planned}
    return len(held) == len(planned) and all(
        holding.side in expected
        and holding.body == expected[holding.side].body
        and holding.T_tip_body.isApprox(expected[holding.side].T_tip_body, AS_PLANNED)
        for holding in held
    )


def _is_same(body: Body, planned: Body) -> bool:
    """Whether two bodies have equal parts and the same place; a mesh equals only itself."""
    return (
        len(body.parts) == len(planned.parts)
        and bool(body.T_base_body.isApprox(planned.T_base_body, AS_PLANNED))
        and all(
            one.shape == two.shape and one.T_body_part.isApprox(two.T_body_part, AS_PLANNED)
            for one, two in zip(body.parts, planned.parts, strict=True)
        )
    )
