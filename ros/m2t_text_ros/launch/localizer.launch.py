"""The localizer, configured and activated, with the parameters of a file."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, RegisterEventHandler
from launch.event_handlers import OnProcessStart
from launch.events import matches_action
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import LifecycleNode
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from launch_ros.substitutions import FindPackageShare
from lifecycle_msgs.msg import Transition


def generate_launch_description() -> LaunchDescription:
    default = PathJoinSubstitution([FindPackageShare("m2t_text_ros"), "config", "localizer.yaml"])
    node = LifecycleNode(
        package="m2t_text_ros",
        executable="localizer",
        name="m2t_localizer",
        namespace="",
        output="screen",
        parameters=[LaunchConfiguration("params_file")],
    )
    configure = EmitEvent(
        event=ChangeState(
            lifecycle_node_matcher=matches_action(node), transition_id=Transition.TRANSITION_CONFIGURE
        )
    )
    activate = EmitEvent(
        event=ChangeState(
            lifecycle_node_matcher=matches_action(node), transition_id=Transition.TRANSITION_ACTIVATE
        )
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument("params_file", default_value=default, description="YAML of parameters."),
            node,
            RegisterEventHandler(OnProcessStart(target_action=node, on_start=[configure])),
            RegisterEventHandler(
                OnStateTransition(target_lifecycle_node=node, goal_state="inactive", entities=[activate])
            ),
        ]
    )
