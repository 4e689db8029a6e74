"""m2t-text as a ROS 2 node."""
