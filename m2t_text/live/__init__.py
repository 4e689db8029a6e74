"""What a robot asks while it drives: its way, where it is in a saved map, and loops. Free of ROS."""
