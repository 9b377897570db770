"""What `iq.contacts.identify` finds in recordings of which everything is known.

python tests/benchmarks/identification.py kinds [--seeds 20] [--first 0]       a person's motion, twelve kinds
python tests/benchmarks/identification.py strokes                              a robot's straight line without a turn
python tests/benchmarks/identification.py smooth                               smooth errors of poses, with and without given noise
python tests/benchmarks/identification.py frames                               other frames; millimetres and pounds
python tests/benchmarks/identification.py changes                              one contact after the other
python tests/benchmarks/identification.py hand                                 MuJoCo: a compliant hand drags the tool
python tests/benchmarks/identification.py tilts                                MuJoCo: a face is turned onto its edge
python tests/benchmarks/identification.py bounds                               errors beside the bound of Cramer and Rao
python tests/benchmarks/identification.py time
"""

# ruff: noqa: E501, C901 (figures are printed in long lines; one table after the other)
import sys
import time
from argparse import ArgumentParser
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from support.recordings import KINDS, NOISE, carried, errors, frames, inverted, random_frame, record, turned

from invariantqp.contacts import identify
from invariantqp.errors import NoContactFound


def answer(poses, wrenches, **options):
    """The kind with its side, the candidates' likewise, what was found or why nothing was."""
    try:
        found = identify(poses, wrenches, **options)
    except NoContactFound as error:
        return "free" if str(error).startswith("nothing is touched") else "none", [], error
    named = [(c.kind, c.fixed_to) for c in found.candidates]
    return (named[0] if found.kind else None), named, found


def row(kind, seeds, style="human", smooth=0.0, noise=None):
    """Print what is right, in the set, sole, sole and wrong, and the errors of those that are right."""
    right = among = sole = wrong = 0
    others, off, spent = Counter(), {}, []
    for seed in seeds:
        X, w, truth = record(kind, seed, style, smooth=smooth)
        true = "free" if kind == "free" else (truth.kind, truth.fixed_to)
        start = time.process_time()
        said, named, found = answer(X, w, noise=noise)
        spent.append(time.process_time() - start)
        right += said == true
        among += said == true or true in named
        alone = len(named) == 1 and said is not None
        sole += alone
        wrong += alone and said != true
        if said != true:
            others[said if isinstance(said, str) or said is None else said[0]] += 1
        elif kind != "free":
            for name, value in errors(found, truth).items():
                off.setdefault(name, []).append(value)
    figures = ", ".join(f"{name} {np.median(v):.2g} / {max(v):.2g}" for name, v in off.items())
    n = len(seeds)
    print(
        f"{kind:14} right {right:3}, among {among:3}, sole {sole:3}, sole and wrong {wrong} of {n} | {figures} | "
        f"{np.median(spent):.2f} s {dict(others) or ''}",
        flush=True,
    )
    return np.array([right, among, sole, wrong, n])


def table(seeds, kinds=KINDS, **options):
    total = sum(row(kind, seeds, **options) for kind in kinds)
    right, among, sole, wrong, n = total.tolist()
    print(f"right {right}, truth among {among}, sole {sole}, sole and wrong {wrong}, of {n}")


def constraints(kind, C, truth, extra):
    """What is zero in a contact whose tool frame is at C (n, 4, 4) in its base frame: poses alone."""
    p, R = C[:, :3, 3], C[:, :3, :3]
    if kind == "point":
        return p[:, 2:]
    if kind == "sphere":
        return (p[:, 2] + 0.5 * extra * (p**2).sum(axis=1))[:, None]
    if kind == "line":
        return np.stack((p[:, 2], R[:, 2, 0]), axis=1)
    tilt = R[:, :2, 2]
    if kind in ("peg", "screw", "hinge"):
        along = p[:, 2:] if kind == "hinge" else p[:, 2:] - extra * truth.turned[:, None]
        return np.concatenate((p[:, :2], tilt) if kind == "peg" else (p[:, :2], tilt, along), axis=1)
    return p  # a ball


def bound(kind, X, w, truth, extra):
    """The bound of Cramer and Rao on (12 + e) small changes of base and tool frame, by differences at the truth.

    No estimate without a bias has a smaller covariance. Nothing of it uses the library.
    """
    h, count = 1e-7, 12 + (extra is not None)
    free = {"point": 3, "sphere": 3, "line": 1}.get(kind, 0)

    def rows(change, off=np.zeros(6), load=np.zeros(6)):  # noqa: B008 (never changed)
        base, tool = truth.base @ small(change[:6]), truth.tool @ small(change[6:12])
        by_change = None if extra is None else extra + (change[12] if count > 12 else 0.0)
        C = inverted(base) @ X @ small(off) @ tool
        moments = carried(inverted(tool), w + load)[:, :free]
        return constraints(kind, C, truth, by_change), moments

    zero = np.zeros(count)
    steps, noises = h * np.eye(count), h * np.eye(6)
    J = [np.stack([(rows(s)[k] - rows(-s)[k]) / (2 * h) for s in steps], -1) for k in (0, 1)]
    L = np.stack([(rows(zero, e)[0] - rows(zero, -e)[0]) / (2 * h) for e in noises], -1)
    M = np.stack([(rows(zero, load=e)[1] - rows(zero, load=-e)[1]) / (2 * h) for e in noises], -1)
    H = np.zeros((count, count))
    for D, by, spread in ((J[0], L, NOISE[0]), (J[1], M, NOISE[1])):
        if D.shape[1]:
            V = np.linalg.inv(by * spread**2 @ np.swapaxes(by, 1, 2))
            H += (np.swapaxes(D, 1, 2) @ V @ D).sum(axis=0)
    scale = np.array(([1.0] * 3 + [0.1] * 3) * 2 + [1.0] * (count - 12))
    if count > 12:
        scale[12] = 10.0 if kind == "sphere" else 0.1
    values, vectors = np.linalg.eigh(H * np.outer(scale, scale))
    kept = values > 1e-9 * values[-1]  # the others change nothing about the contact
    inverse = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T
    return inverse * np.outer(scale, scale)


def small(twist):
    return frames(turned(np.asarray(twist[:3], float)), np.asarray(twist[3:], float))


def bounds_table(seeds):
    """Errors beside the bound and beside what the result says of itself."""
    entries = {"point": (9, 10, 11), "sphere": (9, 10, 11), "line": (10, 11), "ball": (3, 4, 5), "hinge": (3, 4),
               "screw": (3, 4)}  # fmt: skip
    names = {"point": "tip", "sphere": "tip", "line": "tip", "ball": "centre"}
    quantities = [(kind, names.get(kind, "place"), "point", list(which)) for kind, which in entries.items()]
    for kind, name, key, which in [
        *quantities,
        ("sphere", "radius", "radius", [12]),
        ("screw", "pitch", "pitch", [12]),
    ]:
        against_bound, against_said, worst = [], [], (0.0,)
        for seed in seeds:
            X, w, truth = record(kind, seed)
            said, _, found = answer(X, w)
            if said != (truth.kind, truth.fixed_to):
                continue
            extra = {"sphere": -1.0 / truth.radius if truth.radius else None, "screw": truth.pitch, "hinge": 0.0}.get(
                kind
            )
            C = inverted(truth.base) @ X @ truth.tool
            object.__setattr__(truth, "turned", np.unwrap(np.arctan2(C[:, 1, 0], C[:, 0, 0])))
            covariance = min(
                (bound(kind, X, w, truth, e) for e in ([extra, -extra] if kind == "sphere" else [extra])), key=np.trace
            )
            unit = {"point": 1e3, "radius": 100.0 * truth.radius, "pitch": 100.0 / max(abs(truth.pitch), 1e-9)}[key]
            limit = unit * np.sqrt(np.diag(covariance)[which].sum())  # [mm], [%]; a radius is one over the curvature
            off = errors(found, truth)[name]
            own = found.candidates[0].deviations[key] * (100.0 / truth.radius if key == "radius" else unit)
            against_bound.append(off / limit)
            against_said.append(off / own)
            worst = max(worst, (off, limit, own, seed))
        of_bound, of_said = (np.sqrt(np.mean(np.square(a))) for a in (against_bound, against_said))
        print(f"{kind:6} {name:6} {len(against_bound)} recordings: error / bound {of_bound:.2f} rms, error / its own deviation {of_said:.2f} rms; "
              f"worst {worst[0]:.2f} {'mm' if key == 'point' else '%'}, of seed {worst[-1]}, where the bound is {worst[1]:.2f} and it says {worst[2]:.2f}", flush=True)  # fmt: skip


def displaced(X, w, rng, metre=1.0, newton=1.0):
    """The same recording with base and tool frame displaced and other units; and the two displacements."""
    A, B = random_frame(rng, 2.0), random_frame(rng, 0.5)
    X, w = A @ X @ B, carried(inverted(B), w)
    X[:, :3, 3] *= metre
    return X, w * np.repeat([metre * newton, newton], 3), A, B


def frames_table(seeds, kinds=KINDS):
    for metre, newton in ((1.0, 1.0), (1e3, 0.2248)):
        same, most = 0, {}
        for kind in kinds[1:]:
            for seed in seeds:
                X, w, _ = record(kind, seed)
                Y, u, A, B = displaced(X, w, np.random.default_rng(seed), metre, newton)
                (said, named, one), (said2, named2, two) = answer(X, w), answer(Y, u)
                same += said == said2 and named == named2
                if said != said2 or named != named2:
                    print("differs:", kind, seed, named, named2)
                if said in (None, "none") or said != said2:
                    continue
                one, two = one.candidates[0], two.candidates[0]
                on_tool = one.fixed_to == "tool"
                to_surface, to_tip = (inverted(B), A) if on_tool else (A, inverted(B))
                wrong = {}
                if one.normal is not None:
                    wrong["normal deg"] = angle(two.normal, to_surface[:3, :3] @ one.normal)
                if one.axis is not None:
                    frame = to_tip if one.kind == "line" else to_surface
                    along = frame[:3, :3] @ one.axis
                    wrong["axis deg"] = angle(two.axis, along)
                if one.point is not None and one.kind != "face":
                    frame = to_surface if one.fixed_to == "both" else to_tip
                    place = frame[:3, :3] @ one.point + frame[:3, 3]
                    gap = two.point / metre - place
                    if one.axis is not None:
                        gap = gap - along * (along @ gap)
                    wrong["place mm"] = 1e3 * np.linalg.norm(gap)
                for name, value in wrong.items():
                    most[name] = max(most.get(name, 0.0), value)
        largest = ", ".join(f"{name} {value:.1e}" for name, value in most.items())
        print(
            f"unit {metre:g}, force {newton:g}: same answer {same} of {len(kinds[1:]) * len(seeds)}; most: {largest}",
            flush=True,
        )


def angle(a, b):
    return np.rad2deg(np.arcsin(min(1.0, np.linalg.norm(np.cross(a, b)))))


def hand_table(seeds, kinds):
    """In MuJoCo, where contacts give way and slip."""
    from support.compliant_hand import KINDS as HELD
    from support.compliant_hand import drag

    for kind in [k for k in HELD if k in kinds] if kinds != KINDS else HELD:
        right = among = wrong = 0
        off, others = {}, Counter()
        for seed in seeds:
            X, w, truth = drag(kind, seed)
            said, named, found = answer(X, w)
            true = (truth.kind, truth.fixed_to)
            right += said == true
            among += true in named
            wrong += len(named) == 1 and said is not None and said != true
            if said != true:
                others[str(said)] += 1
                print("   ", kind, seed, named, str(found)[:200] if said == "none" else found.reason[:150])
            else:
                for name, value in errors(found, truth).items():
                    off.setdefault(name, []).append(value)
        figures = ", ".join(f"{name} {np.median(v):.2g} / {max(v):.2g}" for name, v in off.items())
        print(
            f"{kind:8} right {right}, among {among}, sole and wrong {wrong} of {len(seeds)} | {figures} "
            f"{dict(others) or ''}",
            flush=True,
        )


def tilts_table(seeds):
    """In MuJoCo, a face that is turned onto one of its edges in the middle of a recording."""
    from support.compliant_hand import drag

    tally = Counter()
    for seed in seeds:
        X, w, _ = drag("face", seed, duration=10.0, tilted=0.5)
        said, _, found = answer(X, w)
        kinds = [] if said == "none" else [(p.kind, p.start, p.stop) for p in found.segments]
        print("   ", seed, kinds or str(found)[:150])
        found_kinds = [kind for kind, *_ in kinds if kind]
        tally["both, each its own" if found_kinds == ["face", "line"] else
              "wrong" if any(kind not in ("face", "line") for kind in found_kinds) else "one identified, or none"] += 1  # fmt: skip
    for what, count in sorted(tally.items()):
        print(f"{count:4} {what}")


def changes_table(seeds):
    """Two contacts one after the other, at once or with a second of air between; which kinds is drawn by the seed."""
    tally = Counter()
    for seed in seeds:
        rng = np.random.default_rng([seed, 5])
        first, second = rng.choice([k for k in KINDS if k != "free"], 2, replace=False)
        (X, w, one), (Y, u, two) = record(first, seed, duration=4.0), record(second, seed + 500, duration=4.0)
        gap = seed % 2
        air = record("free", seed, duration=1.0)
        parts = [(X, w), air[:2], (Y, u)] if gap else [(X, w), (Y, u)]
        said, _, found = answer(*(np.concatenate([part[k] for part in parts]) for k in (0, 1)))
        kinds = [] if said == "none" else [(p.kind, p.fixed_to) for p in found.segments]
        true = [(t.kind, t.fixed_to) for t in (one, two)]
        determined = [k for k in kinds if k[0] is not None]
        if kinds == true:
            verdict = "both, each its own"
        elif said == "none" or not determined:
            verdict = "undetermined"
        elif all(k in true for k in determined):
            verdict = "one identified, the other not"
        else:
            verdict = "wrong"
            print("   ", seed, true, kinds)
        tally[f"{'with air between' if gap else 'at once'}: {verdict}"] += 1
    for what, count in sorted(tally.items()):
        print(f"{count:4} {what}")


def main():
    parser = ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "table", choices=["kinds", "strokes", "smooth", "frames", "changes", "tilts", "hand", "bounds", "time"]
    )
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--kinds", nargs="*", default=None)
    options = parser.parse_args()
    seeds, kinds = range(options.first, options.first + options.seeds), tuple(options.kinds or KINDS)
    if options.table == "kinds":
        table(seeds, kinds)
    if options.table == "strokes":
        table(seeds, kinds, style="stroke")
    if options.table == "smooth":
        for noise in (None, NOISE):
            print("smooth over 0.2 s, noise estimated" if noise is None else "smooth over 0.2 s, noise given")
            table(seeds, kinds, smooth=0.2, noise=noise)
    if options.table == "frames":
        frames_table(seeds, kinds)
    if options.table == "changes":
        changes_table(seeds)
    if options.table == "tilts":
        tilts_table(seeds)
    if options.table == "bounds":
        bounds_table(seeds)
    if options.table == "time":
        for kind in kinds:
            X, w, _ = record(kind, options.first, duration=10.0)
            start = time.process_time()
            answer(X, w)
            print(f"{kind:14} {time.process_time() - start:.2f} s of a processor, 10 s at 100 Hz")
    if options.table == "hand":
        hand_table(seeds, kinds)


if __name__ == "__main__":
    main()
