"""Prints three poses of every rover that answers at an endpoint: python read_pose.py tcp/127.0.0.1:7448."""

import json
import math
import sys
from queue import Queue

import zenoh
from rosbags.typesys import Stores, get_typestore

TYPE = "geometry_msgs/msg/PoseWithCovarianceStamped"

poses: Queue[zenoh.Sample] = Queue()
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps(sys.argv[1:]))
with zenoh.open(config) as session:
    subscriber = session.declare_subscriber("infant/*/pose", poses.put)
    for sample in (poses.get(timeout=60.0) for _ in range(3)):
        message = get_typestore(Stores.ROS2_JAZZY).deserialize_cdr(sample.payload.to_bytes(), TYPE)
        pose, variances = message.pose.pose, message.pose.covariance[::7]  # the diagonal: 0 x, 1 y, 5 yaw
        yaw = 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)  # rad; the position is in m
        print(sample.key_expr, pose.position.x, pose.position.y, yaw, variances[0], variances[1], variances[5])
