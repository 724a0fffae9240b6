"""Prints three poses of every rover that answers at an endpoint: python read_pose.py tcp/127.0.0.1:7448."""

import json
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
        pose = message.pose.pose  # m, and a quaternion; covariance: 6 x 6, row by row
        print(sample.key_expr, pose.position.x, pose.position.y, pose.orientation.z, message.pose.covariance[0])
