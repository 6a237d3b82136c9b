"""Commands that need neither ROS nor devices."""
