"""Recordings of a tool in contact, of which everything is known: exact constraints, friction, noise, random frames.

A person moves the tool along all that the contact leaves free, at a few tenths of a hertz, with friction 0.3 at each
place of contact. Frames, places, sizes and durations are random. Nothing of it uses the library.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

KINDS = (
    "free",
    "point",
    "point on tool",
    "sphere",
    "line",
    "line on tool",
    "face",
    "ball",
    "peg",
    "hinge",
    "screw",
    "slide",
)
NOISE = (np.repeat([np.deg2rad(0.05), 2e-4], 3), np.repeat([0.02, 0.3], 3))  # of poses and wrenches, 0.2 mm and 0.3 N
FRICTION, CREEP = 0.3, 1e-3  # [m/s] below which friction fades


@dataclass(frozen=True)
class Truth:
    kind: str
    fixed_to: str
    base: np.ndarray  # (4, 4) frame of the contact in the base frame, z out of the surface or along the axis
    tool: np.ndarray  # (4, 4) the other one in the tool frame; on the tool: the surface's
    pitch: float = 0.0
    radius: float = 0.0


def turned(vectors):
    return Rotation.from_rotvec(vectors).as_matrix()


def frames(R, p):
    T = np.zeros((*np.broadcast_shapes(R.shape[:-2], p.shape[:-1]), 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = R, p, 1.0
    return T


def inverted(T):
    Rt = np.swapaxes(T[..., :3, :3], -1, -2)
    return frames(Rt, -(Rt @ T[..., :3, 3:])[..., 0])


def by(M, v):
    """Rows of v turned by each of M."""
    return np.asarray((M @ np.asarray(v)[..., None])[..., 0])


def carried(T, w):
    """Wrenches (m; f) moved to the frame that T is expressed in."""
    R = T[..., :3, :3]
    f = by(R, w[..., 3:])
    return np.concatenate((by(R, w[..., :3]) + np.cross(np.broadcast_to(T[..., :3, 3], f.shape), f), f), axis=-1)


def wander(rng, t, size, low=0.08, high=0.9):
    """A person's motion: five sines."""
    waves = (rng.normal() * np.sin(2.0 * np.pi * rng.uniform(low, high) * t + rng.uniform(0.0, 6.3)) for _ in range(5))
    return size * 1.2 / np.sqrt(5.0) * sum(waves)


def random_frame(rng, reach):
    return frames(turned(1.5 * rng.normal(size=3)), rng.uniform(-reach, reach, 3))


def noisy(rng, poses, wrenches, share=1.0, smooth=0.0):
    """With noise in both; `smooth` [s] is over how long that of poses is correlated."""
    n = len(poses)
    off = rng.normal(size=(n, 6))
    if smooth:
        kernel = np.exp(-0.5 * (np.arange(-300, 301) / (100.0 * smooth)) ** 2)
        kernel /= np.sqrt((kernel**2).sum())
        off = np.stack([np.convolve(rng.normal(size=n + 600), kernel, "valid") for _ in range(6)], axis=1)
    off = share * off * NOISE[0]
    X = poses.copy()
    X[:, :3, 3] += by(X[:, :3, :3], off[:, 3:])
    X[:, :3, :3] = X[:, :3, :3] @ turned(off[:, :3])
    return X, wrenches + share * rng.normal(size=(n, 6)) * NOISE[1]


def record(kind, seed, style="human", hz=100, share=1.0, smooth=0.0, duration=None):
    """(n, 4, 4) poses, (n, 6) wrenches that the tool exerts in its frame, and the truth.

    `style` "stroke" is a robot's straight line without a turn.
    """
    rng = np.random.default_rng([KINDS.index(kind), seed, 11])
    t = np.arange(int((duration or rng.uniform(3.0, 10.0)) * hz)) / hz
    base, tool = random_frame(rng, 0.6), random_frame(rng, 0.2)
    C, w, extra = _in_contact(kind.removesuffix(" on tool"), rng, t, style)
    on_tool = kind.endswith(" on tool")
    if on_tool:  # the roles exchanged: what the base exerts on the tool, turned round
        w, C = -carried(inverted(C), w), inverted(C)
    X = base @ C @ inverted(tool)
    exerted = carried(tool, carried(inverted(C), w))
    X, exerted = noisy(rng, X, exerted, share, smooth)
    name = kind.removesuffix(" on tool")
    side = "tool" if on_tool else "base" if name in ("point", "line", "sphere") else "both"
    return X, exerted, Truth(name, side, base, tool, **extra)


def _in_contact(kind, rng, t, style):  # noqa: C901 (one kind after the other)
    """Poses of the tool's contact frame in the base's, and the wrench that the tool exerts there."""
    n, zero = len(t), np.zeros(len(t))
    L, A = rng.uniform(0.03, 0.1), np.deg2rad(rng.uniform(8.0, 30.0))
    side, angle = (0.0, 0.0) if style == "stroke" else (L * rng.uniform(0.4, 1.0), A)
    x, y, z = wander(rng, t, L), wander(rng, t, side), zero
    rx, ry, rz = (wander(rng, t, angle) for _ in range(3))
    extra = {}
    if kind == "free":
        z = wander(rng, t, L)
    if kind == "line":
        ry = zero
    if kind in ("face", "peg", "hinge", "screw", "slide"):
        rx = ry = zero
    if kind in ("ball", "peg", "hinge", "screw", "slide"):
        x = y = zero
    if kind in ("peg", "slide"):
        z = wander(rng, t, L)
    if kind == "hinge":
        rz = 3.0 * rz
    if kind == "slide":
        rz = zero
    if kind == "screw":
        extra["pitch"] = rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 5.0) / (2.0 * np.pi) * 1e-2
        rz = 6.0 * rz
        z = extra["pitch"] * rz
    R = turned(np.stack((zero, zero, rz), 1)) @ turned(np.stack((rx, ry, zero), 1))
    if kind in ("point", "free", "ball", "sphere"):
        R = turned(np.stack((rx, ry, rz), 1))
    if kind == "sphere":
        radius = extra["radius"] = rng.choice([-1.0, 1.0]) * rng.uniform(0.08, 0.3)
        fits = min(1.0, 0.8 * abs(radius) / np.sqrt((x * x + y * y).max()))  # not beyond the equator
        x, y = fits * x, fits * y
        z = -np.sign(radius) * (abs(radius) - np.sqrt(radius**2 - x * x - y * y))
    p = np.stack((x, y, z), axis=1)
    dt = t[1] - t[0]
    v = np.gradient(p, dt, axis=0)
    turns = Rotation.from_matrix(R[1:] @ np.swapaxes(R[:-1], 1, 2)).as_rotvec() / dt
    omega = np.concatenate((turns, turns[-1:]))
    w = np.zeros((n, 6))
    press = rng.uniform(5.0, 15.0) * (1.0 + 0.25 * np.clip(wander(rng, t, 1.0), -2.0, 2.0))

    def push(place, normal, force):
        """Press against a normal at a place, with friction against the slide there."""
        slide = v + np.cross(omega, place - p)
        slide = slide - normal * (slide * normal).sum(axis=1)[:, None]
        speed = np.sqrt((slide**2).sum(axis=1) + CREEP**2)[:, None]
        f = force[:, None] * (FRICTION * slide / speed - normal)
        w[:, :3] += np.cross(place, f)
        w[:, 3:] += f

    up = np.tile([0.0, 0.0, 1.0], (n, 1))
    if kind == "point":
        push(p, up, press)
    if kind == "sphere":
        out = np.stack((x, y, np.sqrt(radius**2 - x * x - y * y)), axis=1) / abs(radius)
        push(p, out * np.array([np.sign(radius), np.sign(radius), 1.0]), press)
    if kind in ("line", "face"):
        corners = [[-1, 0, 0], [1, 0, 0]] if kind == "line" else [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
        size = rng.uniform(0.015, 0.04)
        shares = np.exp(np.stack([wander(rng, t, 0.6) for _ in corners], axis=1))
        for corner, part in zip(corners, (shares / shares.sum(axis=1)[:, None]).T, strict=True):
            push(p + by(R, size * np.array(corner)), up, part * press)
    if kind in ("ball", "peg", "hinge", "screw", "slide"):
        w[:, 3:] = np.stack([wander(rng, t, 6.0) + 4.0 * rng.normal() for _ in range(3)], axis=1)
        w[:, :3] = np.stack([wander(rng, t, 0.6) + 0.3 * rng.normal() for _ in range(3)], axis=1)
        _rub(kind, w, v, omega, extra)
        w[:, :3] += np.cross(p, w[:, 3:])
    return frames(R, p), w, extra


def _rub(kind, w, v, omega, extra):
    """Friction in a joint in place of the wrench in its freedoms: 4 to 5 mm of arm."""

    def sign(a, least):
        return a / np.sqrt(a * a + least * least)

    if kind == "ball":
        force = np.linalg.norm(w[:, 3:], axis=1)[:, None]
        w[:, :3] = FRICTION * force * 0.004 * omega / np.sqrt((omega**2).sum(axis=1) + 4e-4)[:, None]
        return
    aside = np.linalg.norm(w[:, 3:5], axis=1)
    if kind in ("peg", "hinge"):
        w[:, 2] = FRICTION * aside * 0.005 * sign(omega[:, 2], 0.02)
    if kind in ("peg", "slide"):
        w[:, 5] = FRICTION * aside * sign(v[:, 2], CREEP)
    if kind == "screw":
        rub = FRICTION * (aside + np.abs(w[:, 5])) * 0.005 * sign(omega[:, 2], 0.02)
        w[:, 2] = -extra["pitch"] * w[:, 5] + rub


def errors(found, truth):
    """How far a candidate is from the truth: degrees, millimetres, per cent."""

    def angle(a, b):
        a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
        return np.rad2deg(np.arcsin(min(1.0, np.linalg.norm(np.cross(a, b)))))

    def from_axis(point, place, axis):
        off = point - place
        return 1e3 * np.linalg.norm(off - axis * (axis @ off))

    surface, tip = (truth.tool, truth.base) if truth.fixed_to == "tool" else (truth.base, truth.tool)
    kind, z = truth.kind, surface[:3, 2]
    if kind == "point":
        off = found.normal @ (z if truth.fixed_to == "base" else -z)
        return {
            "normal": angle(found.normal, z) if abs(off) < 2 else 180.0,
            "tip": 1e3 * np.linalg.norm(found.point - tip[:3, 3]),
        }
    if kind == "sphere":
        return {
            "tip": 1e3 * np.linalg.norm(found.point - tip[:3, 3]),
            "radius": 100 * abs(found.radius / truth.radius - 1),
        }
    if kind == "line":
        edge = tip[:3, 0]
        return {
            "normal": angle(found.normal, z),
            "edge": angle(found.axis, edge),
            "tip": from_axis(found.point, tip[:3, 3], edge),
        }
    if kind == "face":
        return {"normal": angle(found.normal, z)}
    if kind == "ball":
        return {"centre": 1e3 * np.linalg.norm(found.point - truth.base[:3, 3])}
    if kind == "slide":
        return {"axis": angle(found.axis, z)}
    wrong = {"axis": angle(found.axis, z), "place": from_axis(found.point, truth.base[:3, 3], z)}
    if kind == "screw":
        wrong["pitch"] = 100 * abs(found.pitch / truth.pitch - 1)
    return wrong
