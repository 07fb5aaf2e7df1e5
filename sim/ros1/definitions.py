"""The types of Baxter's interface that ROS 1's standard packages do not have.

Only names, order and kinds of constants and fields are here: of them ROS makes the md5 sum that
both ends of a connection compare. They are facts of baxter_core_msgs 1.2, and of gazebo_msgs and
control_msgs of ROS Noetic.
"""

from __future__ import annotations

from sim.recording.formats.joint_states import ROBOT_MESSAGES
from sim.ros1_messages import MessageType, MessageTypes, ServiceType

_STAMPED_GOAL = "std_msgs/Header header\nactionlib_msgs/GoalID goal_id\n"
_STAMPED_STATUS = "std_msgs/Header header\nactionlib_msgs/GoalStatus status\n"

MESSAGES = {
    **ROBOT_MESSAGES,
    "baxter_core_msgs/AnalogIOState": """
time timestamp
float64 value
bool isInputOnly
""",
    "baxter_core_msgs/AnalogOutputCommand": """
string name
uint16 value
""",
    "baxter_core_msgs/AssemblyState": """
uint8 ESTOP_BUTTON_UNPRESSED=0
uint8 ESTOP_BUTTON_PRESSED=1
uint8 ESTOP_BUTTON_UNKNOWN=2
uint8 ESTOP_BUTTON_RELEASED=3
uint8 ESTOP_SOURCE_NONE=0
uint8 ESTOP_SOURCE_USER=1
uint8 ESTOP_SOURCE_UNKNOWN=2
uint8 ESTOP_SOURCE_FAULT=3
uint8 ESTOP_SOURCE_BRAIN=4
bool ready
bool enabled
bool stopped
bool error
uint8 estop_button
uint8 estop_source
""",
    "baxter_core_msgs/CollisionAvoidanceState": """
std_msgs/Header header
bool other_arm
string[] collision_object
""",
    "baxter_core_msgs/CollisionDetectionState": """
std_msgs/Header header
bool collision_state
""",
    "baxter_core_msgs/DigitalIOState": """
int8 OFF=0
int8 ON=1
int8 PRESSED=1
int8 UNPRESSED=0
int8 state
bool isInputOnly
""",
    "baxter_core_msgs/DigitalOutputCommand": """
string name
bool value
""",
    "baxter_core_msgs/EndEffectorCommand": """
string CMD_NO_OP=no_op
string CMD_SET=set
string CMD_CONFIGURE=configure
string CMD_REBOOT=reboot
string CMD_RESET=reset
string CMD_CALIBRATE=calibrate
string CMD_CLEAR_CALIBRATION=clear_calibration
string CMD_PREPARE_TO_GRIP=prepare_to_grip
string CMD_GRIP=grip
string CMD_RELEASE=release
string CMD_GO=go
string CMD_STOP=stop
uint32 id
string command
string args
string sender
uint32 sequence
""",
    "baxter_core_msgs/EndEffectorProperties": """
uint8 NO_GRIPPER=0
uint8 SUCTION_CUP_GRIPPER=1
uint8 ELECTRIC_GRIPPER=2
uint8 PASSIVE_GRIPPER=3
uint32 id
uint8 ui_type
string manufacturer
string product
string serial_number
string hardware_rev
string firmware_rev
string firmware_date
bool has_calibration
bool controls_grip
bool senses_grip
bool reverses_grip
bool controls_force
bool senses_force
bool controls_position
bool senses_position
string properties
""",
    "baxter_core_msgs/EndpointState": """
std_msgs/Header header
geometry_msgs/Pose pose
geometry_msgs/Twist twist
geometry_msgs/Wrench wrench
""",
    "baxter_core_msgs/HeadPanCommand": """
float32 MAX_SPEED_RATIO=1.0
float32 MIN_SPEED_RATIO=0.0
uint8 REQUEST_PAN_DISABLE=0
uint8 REQUEST_PAN_ENABLE=1
uint8 REQUEST_PAN_VOID=2
float32 target
float32 speed_ratio
uint8 enable_pan_request
""",
    "baxter_core_msgs/HeadState": """
float32 pan
bool isTurning
bool isNodding
bool isPanEnabled
""",
    "baxter_core_msgs/NavigatorState": """
string[] button_names
bool[] buttons
uint8 wheel
string[] light_names
bool[] lights
""",
    "baxter_core_msgs/SEAJointState": """
std_msgs/Header header
string[] name
float64[] commanded_position
float64[] commanded_velocity
float64[] commanded_acceleration
float64[] commanded_effort
float64[] actual_position
float64[] actual_velocity
float64[] actual_effort
float64[] gravity_model_effort
float64[] gravity_only
float64[] hysteresis_model_effort
float64[] crosstalk_model_effort
float64 hystState
""",
    "control_msgs/FollowJointTrajectoryAction": """
control_msgs/FollowJointTrajectoryActionGoal action_goal
control_msgs/FollowJointTrajectoryActionResult action_result
control_msgs/FollowJointTrajectoryActionFeedback action_feedback
""",
    "control_msgs/FollowJointTrajectoryActionFeedback": f"""
{_STAMPED_STATUS}control_msgs/FollowJointTrajectoryFeedback feedback
""",
    "control_msgs/FollowJointTrajectoryActionGoal": f"""
{_STAMPED_GOAL}control_msgs/FollowJointTrajectoryGoal goal
""",
    "control_msgs/FollowJointTrajectoryActionResult": f"""
{_STAMPED_STATUS}control_msgs/FollowJointTrajectoryResult result
""",
    "control_msgs/FollowJointTrajectoryFeedback": """
std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint desired
trajectory_msgs/JointTrajectoryPoint actual
trajectory_msgs/JointTrajectoryPoint error
""",
    "control_msgs/FollowJointTrajectoryGoal": """
trajectory_msgs/JointTrajectory trajectory
control_msgs/JointTolerance[] path_tolerance
control_msgs/JointTolerance[] goal_tolerance
duration goal_time_tolerance
""",
    "control_msgs/FollowJointTrajectoryResult": """
int32 SUCCESSFUL=0
int32 INVALID_GOAL=-1
int32 INVALID_JOINTS=-2
int32 OLD_HEADER_TIMESTAMP=-3
int32 PATH_TOLERANCE_VIOLATED=-4
int32 GOAL_TOLERANCE_VIOLATED=-5
int32 error_code
string error_string
""",
    "control_msgs/JointTolerance": """
string name
float64 position
float64 velocity
float64 acceleration
""",
}
"""Constants and fields, by the type's name."""

SERVICES = {
    "baxter_core_msgs/SolvePositionIK": """
uint8 SEED_AUTO=0
uint8 SEED_USER=1
uint8 SEED_CURRENT=2
uint8 SEED_NS_MAP=3
geometry_msgs/PoseStamped[] pose_stamp
sensor_msgs/JointState[] seed_angles
uint8 seed_mode
---
uint8 RESULT_INVALID=0
sensor_msgs/JointState[] joints
bool[] isValid
uint8[] result_type
""",
    "gazebo_msgs/DeleteModel": """
string model_name
---
bool success
string status_message
""",
    "gazebo_msgs/SpawnModel": """
string model_name
string model_xml
string robot_namespace
geometry_msgs/Pose initial_pose
string reference_frame
---
bool success
string status_message
""",
}
"""Of requests and of responses, by the service's name."""

TYPES = MessageTypes(MESSAGES, SERVICES)
"""ROS 1's standard types, and these."""


def message_type(name: str) -> MessageType:
    """The type of a message, such as "baxter_core_msgs/JointCommand"."""
    return TYPES.message(name)


def service_type(name: str) -> ServiceType:
    """The type of a service, such as "baxter_core_msgs/SolvePositionIK"."""
    return TYPES.service(name)
