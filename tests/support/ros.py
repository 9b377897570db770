"""A stand-in for rclpy and its messages: nodes are made and spun, topics are called by the test."""

import sys
from types import ModuleType, SimpleNamespace


def _message(**fields):
    """A class of messages with these fields, each made anew for each of them."""

    class Message:
        def __init__(self, **given):
            for name, make in fields.items():
                setattr(self, name, given[name] if name in given else make())

    return Message


VECTOR = _message(x=float, y=float, z=float)
QUATERNION = _message(x=float, y=float, z=float, w=lambda: 1.0)
POSE = _message(position=VECTOR, orientation=QUATERNION)
MESSAGES = {
    "geometry_msgs.msg": {
        "PoseStamped": _message(pose=POSE),
        "TwistStamped": _message(twist=_message(linear=VECTOR, angular=VECTOR)),
        "WrenchStamped": _message(wrench=_message(force=VECTOR, torque=VECTOR)),
    },
    "sensor_msgs.msg": {"JointState": _message(name=list, position=list)},
    "std_msgs.msg": {"Float64": _message(data=float), "Float64MultiArray": _message(data=list)},
    "std_srvs.srv": {"Trigger": SimpleNamespace(Response=_message(success=bool, message=str))},
}


class Node:
    """What the examples use of rclpy's node."""

    def __init__(self, name):
        self.name, self.subscribed, self.published, self.served, self.timers, self.logged = name, {}, [], {}, [], []

    def create_publisher(self, _kind, _topic, _depth):
        return SimpleNamespace(publish=self.published.append)

    def create_subscription(self, _kind, topic, callback, _depth):
        self.subscribed[topic] = callback

    def create_service(self, _kind, name, callback):
        self.served[name] = callback

    def create_timer(self, period, callback):
        self.timers.append((period, callback))

    def get_logger(self):
        return SimpleNamespace(warning=lambda text, **_options: self.logged.append(text))


def installed(monkeypatch):
    """The stand-in in the place of ROS; the list of what is spun."""
    spun = []
    rclpy, node = ModuleType("rclpy"), ModuleType("rclpy.node")
    rclpy.init, rclpy.spin, node.Node, rclpy.node = lambda: None, spun.append, Node, node
    monkeypatch.setitem(sys.modules, "rclpy", rclpy)
    monkeypatch.setitem(sys.modules, "rclpy.node", node)
    for name, classes in MESSAGES.items():
        parent, _ = name.split(".")
        module = ModuleType(name)
        vars(module).update(classes)
        monkeypatch.setitem(sys.modules, parent, ModuleType(parent))
        monkeypatch.setitem(sys.modules, name, module)
    return spun


def message(kind, **fields):
    """A message by its name."""
    return next(classes[kind] for classes in MESSAGES.values() if kind in classes)(**fields)
