"""Studies: a scene many times with other values, each run in one process without ROS."""
