"""soro as ROS 2 nodes: topics, runs, recorded runs and their pictures."""
