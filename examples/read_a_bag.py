"""What a recorded run holds: its topics, and the path of its tip. Needs the extra `ros`, but no running ROS.

python examples/read_a_bag.py [BAG]
"""

import sys

from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from soro_lab.bag import BagReader

with BagReader(sys.argv[1] if len(sys.argv) > 1 else "bags/track_circle_lockstep_2s") as bag:
    for topic, count in zip(bag.topics, bag.counts, strict=True):
        print(f"{count:5d}  {topic.name}  {topic.type}")
    name = next(topic.name for topic in bag.topics if topic.name.endswith("/chambers/state"))
    for k, message in enumerate(bag.messages([name])):
        if k % 100 == 0:
            state = deserialize_message(message.data, JointState)
            pressures = ", ".join(f"{1e-3 * p:.1f} kPa" for p in state.effort)
            print(f"{state.header.stamp.sec + 1e-9 * state.header.stamp.nanosec:.1f} s  {pressures}")
