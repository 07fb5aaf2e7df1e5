"""Types against the md5 sums that Baxter's own software states, and those of ROS 1."""

from __future__ import annotations

import pytest

from sim.errors import RosMessageError
from sim.ros1.definitions import MESSAGES, SERVICES, message_type, service_type

MD5_OF_MESSAGES = {
    "baxter_core_msgs/AnalogIOState": "39af371963dc9e4447e91f430c720b33",
    "baxter_core_msgs/AnalogOutputCommand": "a7b945129a083ca4095d48aa94841d85",
    "baxter_core_msgs/AssemblyState": "356d9dd237ce73b2667da9235f541933",
    "baxter_core_msgs/CollisionAvoidanceState": "30f5cb8ae019f1ffe8b599e6d2e589c7",
    "baxter_core_msgs/CollisionDetectionState": "7bde38c182b4d08fdc0635b116f65d04",
    "baxter_core_msgs/DigitalIOState": "29d0be3859dae81a66b28f167ecec98c",
    "baxter_core_msgs/DigitalOutputCommand": "23f05028c1a699fb83e22401228c3a9e",
    "baxter_core_msgs/EndEffectorCommand": "c003234e90416f2ca02ac7837c42cbb7",
    "baxter_core_msgs/EndEffectorProperties": "21b83773ab9a35216d11e427573c76cc",
    "baxter_core_msgs/EndEffectorState": "ade777f069d738595bc19e246b8ec7a0",
    "baxter_core_msgs/EndpointState": "44bea01d596ff699fa1447bec34167ac",
    "baxter_core_msgs/HeadPanCommand": "23b8a3f4b7ee9de7099d029e57660a8c",
    "baxter_core_msgs/HeadState": "71c43b264307205358e7e49be5601348",
    "baxter_core_msgs/JointCommand": "19bfec8434dd568ab3c633d187c36f2e",
    "baxter_core_msgs/NavigatorState": "680d121a1f16a32647298b292492fffd",
    "baxter_core_msgs/SEAJointState": "d36406dcbb6d860b1b39c4e28f81352b",
    "control_msgs/FollowJointTrajectoryAction": "bc4f9b743838566551c0390c65f1a248",
    "sensor_msgs/JointState": "3066dcd76a6cfaef579bd0f34173e9fd",
    "std_msgs/Empty": "d41d8cd98f00b204e9800998ecf8427e",
    "std_msgs/String": "992ce8a1687cec8c8bd883ec73ca41d1",
    "tf2_msgs/TFMessage": "94810edda583a504dfda3829e70d7eec",
}

MD5_OF_SERVICES = {
    "baxter_core_msgs/SolvePositionIK": "18cc92fd96853eb10b34de0b5c7d3cba",
    "gazebo_msgs/DeleteModel": "9ce56b4e9e54616de25d796dc972a262",
    "gazebo_msgs/SpawnModel": "9ed9c82c96abe1a00c3e8cdaeee24413",
}


def test_types_have_the_sums_of_their_packages() -> None:
    assert {name: message_type(name).md5 for name in MD5_OF_MESSAGES} == MD5_OF_MESSAGES
    assert {name: service_type(name).md5 for name in SERVICES} == MD5_OF_SERVICES
    baxters = {name for name in MESSAGES if name.startswith("baxter_core_msgs")}
    assert baxters <= MD5_OF_MESSAGES.keys()


def test_unknown_types_are_refused_with_those_that_are_known() -> None:
    with pytest.raises(RosMessageError, match=r"unknown message type 'no/Such'.*JointCommand"):
        message_type("no/Such")
    with pytest.raises(RosMessageError, match=r"unknown service type 'no/Such'.*SolvePositionIK"):
        service_type("no/Such")
