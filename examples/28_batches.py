"""Rows per second of the velocity law on arrays of every library there is, beside a loop over rows.

Joint positions all over the range of a Franka Research 3, random twists, two boxes: one that no joint meets, and one
that nearly every row meets. Every library is asked for the same rows. With the rates the largest difference is printed:
of `solve_velocities` from the loop, of `batches`, which has the law of loops, from the first library. Calls take turns;
a rate is of the median call, with that of the slowest in a hundred beside it.

Run: python examples/28_batches.py [--rows 4096] [--device cuda] [--single] [--libraries numpy,torch,jax,cupy]
"""

import argparse
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from time import perf_counter
from types import SimpleNamespace

import numpy as np

import invariantqp as iq
from invariantqp import batches

FIRST = "solve_velocity, one by one"
BATCHES = "batches.velocities, "
SOME = 200  # rows of the loop
BOXES = {"free": 50.0, "tight": 0.3}  # joint velocities [rad/s]


def numpy_():
    return SimpleNamespace(array=np.asarray, host=np.asarray, wait=lambda x: x, traced=lambda f: f)


def torch_(device):
    torch = import_module("torch")
    if device == "cpu":
        torch.set_num_threads(1)  # as the others here; operations on rows of seven numbers gain nothing by more
    wait = torch.cuda.synchronize if device == "cuda" else lambda: None
    return SimpleNamespace(
        array=lambda a: torch.tensor(a, device=device),
        host=lambda x: x.cpu().numpy(),
        wait=lambda _: wait(),
        traced=lambda f: f,
    )


def jax_(device):
    jax = import_module("jax")
    jax.config.update("jax_enable_x64", val=True)
    place = jax.devices(device)[0]
    return SimpleNamespace(
        array=lambda a: jax.device_put(a, place), host=np.asarray, wait=lambda x: x.block_until_ready(), traced=jax.jit
    )


def cupy_():
    cupy = import_module("cupy")
    return SimpleNamespace(
        array=cupy.asarray, host=cupy.asnumpy, wait=lambda _: cupy.cuda.Device().synchronize(), traced=lambda f: f
    )


def libraries(wanted, device):
    """Those that are installed and have the device."""
    makers = {"numpy": numpy_, "torch": lambda: torch_(device), "jax": lambda: jax_(device), "cupy": cupy_}
    for name in wanted:
        if find_spec(name) is None:
            print(f"{name}: not installed")
        elif name == "cupy" and device != "cuda":
            print("cupy: with --device cuda only")
        else:
            yield name, makers[name]()


def case(rows, precision):
    """J, twist and point of every row."""
    robot = iq.load_robot("fr3")
    rng = np.random.default_rng(0)
    q = rng.uniform(robot.position_lower, robot.position_upper, size=(rows, 7))
    here = batches.kinematics(robot, q)
    twist = 0.3 * rng.normal(size=(rows, 6))
    return [a.astype(precision) for a in (here.jacobian, twist, here.pose[:, :3, 3])]


def solved(J, twist, point, high):
    return batches.velocities(J, twist, point=point, bounds=(-high, high)).velocity


def calls(rows, speed, found):
    """What is timed, by name: a call, what waits for its answer, what brings that here, and how many rows it solves."""
    J, twist, point = rows
    high = np.full((len(J), 7), speed, dtype=J.dtype)
    bounds, some = iq.Bounds(-high[0], high[0]), min(len(J), SOME)

    def one_by_one():
        triples = zip(J[:some], twist[:some], point[:some], strict=True)
        return np.array([iq.solve_velocity(a, s, point=p, bounds=bounds).velocity for a, s, p in triples])

    def together():
        return iq.solve_velocities(J, twist, point=point, bounds=(-high, high)).velocity

    yield FIRST, one_by_one, numpy_(), some
    yield "solve_velocities", together, numpy_(), len(J)
    for name, library in found:
        values = [library.array(a) for a in (J, twist, point, high)]
        yield f"{BATCHES}{name}", partial(library.traced(solved), *values), library, len(J)


def race(box, contestants, repeats):
    """Times of calls that take turns, printed."""
    answers, times = {}, {name: [] for name, *_ in contestants}
    for name, call, library, _ in contestants:  # also compiles
        answer = call()
        library.wait(answer)
        answers[name] = library.host(answer)
    for _ in range(repeats):
        for name, call, library, _ in contestants:
            begin = perf_counter()
            library.wait(call())
            times[name].append(perf_counter() - begin)
    loop = np.median(times[FIRST]) / contestants[0][3]
    of_loops = next((name for name in answers if name.startswith(BATCHES)), FIRST)
    for name, _, _, rows in contestants:
        middle, slow = np.median(times[name]) / rows, np.quantile(times[name], 0.99) / rows
        same = answers[of_loops if name.startswith(BATCHES) else FIRST]
        off = np.abs(answers[name][: len(same)] - same).max()
        print(f"{box:6}{name:28}{1.0 / middle:12.0f}{1.0 / slow:12.0f}{loop / middle:10.1f} x{off:12.0e}")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--rows", type=int, default=4096)
    parser.add_argument("--repeats", type=int, default=20)
    parser.add_argument("--device", default="cpu", choices=["cpu", "cuda"])
    parser.add_argument("--single", action="store_true", help="single precision")
    parser.add_argument("--libraries", default="numpy,torch,jax,cupy")
    options = parser.parse_args()
    rows = case(options.rows, np.float32 if options.single else np.float64)
    found = list(libraries(options.libraries.split(","), options.device))
    print(f"{options.rows} rows of {rows[0].dtype}, {options.device}")
    print(f"{'box':34}{'rows/s':>12}{'slowest':>12}{'the loop':>12}{'off by':>12}")
    for box, speed in BOXES.items():
        race(box, list(calls(rows, speed, found)), options.repeats)


if __name__ == "__main__":
    main()
