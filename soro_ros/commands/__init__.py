"""Commands that need ROS or recordings of it."""
