"""Saved maps, as ROS keeps them: read, drawn from logs, and sampled into local maps."""
