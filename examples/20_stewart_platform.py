"""A Stewart platform: its leg forces, its stiffness and how far it is from singular, the same from every origin."""

import numpy as np

import invariantqp as iq


def platform(turn: float) -> tuple[np.ndarray, np.ndarray]:
    """Base and platform points [m] of a 6-6 platform, 0.5 m high, its top turned about the vertical [rad]."""
    base = np.radians([-10, 10, 110, 130, 230, 250])
    top = np.radians([-50, 50, 70, 170, 190, 290]) + turn
    ring = np.column_stack((np.cos(base), np.sin(base), np.zeros(6)))
    plate = np.column_stack((0.5 * np.cos(top), 0.5 * np.sin(top), np.full(6, 0.5)))
    return 0.6 * ring, plate


def main() -> None:
    """Print what the legs do, here and seen from an origin a metre away."""
    stiffness_of_leg = np.full(6, 2e7)  # [N/m]
    W = iq.systems.leg_wrenches(*platform(0.0))
    away = iq.transform(translation=(1.0, -0.4, 0.3))  # the same machine in another frame
    W_away = iq.coadjoint(away) @ W
    h = 0.3  # [m/rad], about the platform's own size

    load = np.array([0.0, 0.0, 0.0, 100.0, 0.0, -500.0])  # a side force and a weight [N], moments first
    forces = iq.systems.wrench_pseudoinverse(W, h) @ load
    print("leg forces [N]:         ", np.round(forces, 1))
    print(
        "  seen from elsewhere:  ", np.round(iq.systems.wrench_pseudoinverse(W_away, h) @ iq.coadjoint(away) @ load, 1)
    )

    K = iq.systems.platform_stiffness(W, stiffness_of_leg)
    twist = np.linalg.solve(K, load)
    print(f"sinks under the load by: {1e6 * -twist[5]:.2f} um")

    print("\nConditioning, ordinary and frame-free (and from the other origin):")
    for turn in (0, 30, 60, 80, 88):
        W = iq.systems.leg_wrenches(*platform(np.radians(turn)))
        there = iq.coadjoint(away) @ W
        ours = [iq.systems.leg_spectrum(x, h).condition for x in (W, there)]
        usual = [np.linalg.cond(x) for x in (W, there)]
        print(f"  top turned {turn:2d} deg:  cond(W) = {usual[0]:8.2f} ({usual[1]:8.2f})", end="   ")
        print(f"hyperbolic = {ours[0]:8.2f} ({ours[1]:8.2f})")

    # Four legs hold four directions; the type of their screws says what the other two are.
    four = iq.systems.leg_wrenches(*(points[:4] for points in platform(0.0)))
    free = iq.systems.annihilator(four)
    print(f"\nWith four legs the platform is free along a 2-system of type {iq.gibson_hunt(free)},")
    print("principal pitches", np.round(iq.principal_pitches(free), 4), "m/rad")


if __name__ == "__main__":
    main()
