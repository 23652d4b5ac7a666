"""Bags of ROS 1 and ROS 2 for the tests, written by the `rosbags` package."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="bags ask for the extra aprjax[rosbag]")

from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

STORAGES = ("ros1", "sqlite3", "mcap")
_SUFFIX = {"ros1": ".bag", "sqlite3": "", "mcap": ""}


@dataclass
class Bag:
    """Messages, made by the type store of one ROS, in the order of their times."""

    storage: str
    messages: list[tuple[str, str, float, Any]] = field(default_factory=list)

    def __post_init__(self):
        self.store = get_typestore(Stores.ROS1_NOETIC if self.ros1 else Stores.ROS2_HUMBLE)
        if self.ros1:
            text, kind = "geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"
            self.store.register(get_types_from_msg(text, kind))

    @property
    def ros1(self) -> bool:
        return self.storage == "ros1"

    def type(self, name: str) -> Any:
        return self.store.types[name]

    def header(self, stamp: float, frame: str) -> Any:
        time = self.type("builtin_interfaces/msg/Time")(
            sec=int(stamp), nanosec=round(stamp % 1 * 1e9)
        )
        more = {"seq": 0} if self.ros1 else {}
        return self.type("std_msgs/msg/Header")(stamp=time, frame_id=frame, **more)

    def add(self, topic: str, kind: str, stamp: float, message: Any) -> "Bag":
        self.messages.append((topic, kind, stamp, message))
        return self

    def scan(self, ranges, stamp=1.0, topic="/scan", frame="laser", *, echoes=None, **fields):
        """A LaserScan, or with `echoes`, lists of ranges for each beam, a MultiEchoLaserScan."""
        angles = {
            "angle_min": -np.pi / 2, "angle_increment": np.pi / 180, "range_min": 0.1,
            "range_max": 30.0, **fields,
        }  # fmt: skip
        kind = "sensor_msgs/msg/LaserScan"
        beams: Any = np.asarray(ranges, np.float32)
        intensities: Any = np.zeros(0, np.float32)
        if echoes is not None:
            kind, echo = (
                "sensor_msgs/msg/MultiEchoLaserScan",
                self.type("sensor_msgs/msg/LaserEcho"),
            )
            beams, intensities = [echo(np.asarray(each, np.float32)) for each in echoes], []
        message = self.type(kind)(
            header=self.header(stamp, frame), angle_max=0.0, time_increment=0.0, scan_time=0.1,
            ranges=beams, intensities=intensities, **angles,
        )  # fmt: skip
        return self.add(topic, kind, stamp, message)

    def pose(self, T, flipped=False):
        """Position and orientation; `flipped` is turned over about its own x."""
        x, y, theta = T
        sin, cos = np.sin(theta / 2), np.cos(theta / 2)
        quaternion = (cos, sin, 0.0, 0.0) if flipped else (0.0, 0.0, sin, cos)
        return (x, y, 0.0), quaternion

    def odometry(self, T, stamp=1.0, topic="/odom", child="base_link"):
        position, rotation = self.pose(T)
        prefix = "geometry_msgs/msg/"
        pose = self.type(prefix + "Pose")(
            self.type(prefix + "Point")(*position), self.type(prefix + "Quaternion")(*rotation)
        )
        zero = self.type(prefix + "Vector3")(0.0, 0.0, 0.0)
        twist = self.type(prefix + "Twist")(zero, zero)
        message = self.type("nav_msgs/msg/Odometry")(
            header=self.header(stamp, "odom"),
            child_frame_id=child,
            pose=self.type(prefix + "PoseWithCovariance")(pose, np.zeros(36)),
            twist=self.type(prefix + "TwistWithCovariance")(twist, np.zeros(36)),
        )
        return self.add(topic, "nav_msgs/msg/Odometry", stamp, message)

    def transform(self, parent, child, T, stamp=0.5, *, static=True, flipped=False, rotation=None):
        position, quaternion = self.pose(T, flipped)
        prefix = "geometry_msgs/msg/"
        stamped = self.type(prefix + "TransformStamped")(
            self.header(stamp, parent),
            child,
            self.type(prefix + "Transform")(
                self.type(prefix + "Vector3")(*position),
                self.type(prefix + "Quaternion")(*(rotation or quaternion)),
            ),
        )
        kind = "tf2_msgs/msg/TFMessage"
        return self.add("/tf_static" if static else "/tf", kind, stamp, self.type(kind)([stamped]))

    def write(self, folder: Path, name: str = "drive", *, bzip2: bool = False) -> Path:
        """The bag's path; `bzip2` packs the chunks of ROS 1."""
        path = folder / f"{name}{_SUFFIX[self.storage]}"
        plugin = StoragePlugin.MCAP if self.storage == "mcap" else StoragePlugin.SQLITE3
        writer: Any = (
            Writer1(path) if self.ros1 else Writer2(path, version=8, storage_plugin=plugin)
        )
        if bzip2:
            writer.set_compression(Writer1.CompressionFormat.BZ2)
        with writer:
            connections = {}
            for topic, kind, stamp, message in sorted(self.messages, key=lambda each: each[2]):
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=self.store)
                encode = self.store.serialize_ros1 if self.ros1 else self.store.serialize_cdr
                data = message if isinstance(message, bytes) else encode(message, kind)
                writer.write(connections[topic], int(stamp * 1e9), data)
        return path
