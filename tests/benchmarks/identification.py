"""What `iq.contacts.identify` finds in recordings of which everything is known.

python tests/benchmarks/identification.py kinds [--seeds 20] [--first 0]       a person's motion, twelve kinds
python tests/benchmarks/identification.py strokes                              a robot's straight line without a turn
python tests/benchmarks/identification.py smooth                               smooth errors of poses, told and not
python tests/benchmarks/identification.py frames                               other frames; millimetres and pounds
python tests/benchmarks/identification.py changes                              one contact after the other
python tests/benchmarks/identification.py hand                                 MuJoCo: a compliant hand drags the tool
python tests/benchmarks/identification.py time
"""

import sys
import time
from argparse import ArgumentParser
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from support.recordings import KINDS, NOISE, carried, errors, inverted, random_frame, record

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


def row(kind, seeds, style="human", smooth=0.0, told=None):
    """Print what is right, in the set, sole, sole and wrong, and the errors of those that are right."""
    right = among = sole = wrong = 0
    others, off, spent = Counter(), {}, []
    for seed in seeds:
        X, w, truth = record(kind, seed, style, smooth=smooth)
        true = "free" if kind == "free" else (truth.kind, truth.fixed_to)
        start = time.process_time()
        said, named, found = answer(X, w, noise=NOISE if told else None)
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


def displaced(X, w, rng, metre=1.0, newton=1.0):
    """The same recording with base and tool frame displaced and other units; and the two displacements."""
    A, B = random_frame(rng, 2.0), random_frame(rng, 0.5)
    X, w = A @ X @ B, carried(inverted(B), w)
    X[:, :3, 3] *= metre
    return X, w * np.repeat([metre * newton, newton], 3), A, B


def frames_table(seeds, kinds=KINDS):  # noqa: C901 (what is compared, one after the other)
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
        told = ", ".join(f"{name} {value:.1e}" for name, value in most.items())
        print(
            f"unit {metre:g}, force {newton:g}: same answer {same} of {len(kinds[1:]) * len(seeds)}; most: {told}",
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
        told = [k for k in kinds if k[0] is not None]
        if kinds == true:
            verdict = "both, each its own"
        elif said == "none" or not told:
            verdict = "cannot tell"
        elif all(k in true for k in told):
            verdict = "one told, the other not"
        else:
            verdict = "wrong"
            print("   ", seed, true, kinds)
        tally[f"{'with air between' if gap else 'at once'}: {verdict}"] += 1
    for what, count in sorted(tally.items()):
        print(f"{count:4} {what}")


def main():
    parser = ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("table", choices=["kinds", "strokes", "smooth", "frames", "changes", "hand", "time"])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--kinds", nargs="*", default=None)
    told = parser.parse_args()
    seeds, kinds = range(told.first, told.first + told.seeds), tuple(told.kinds or KINDS)
    if told.table == "kinds":
        table(seeds, kinds)
    if told.table == "strokes":
        table(seeds, kinds, style="stroke")
    if told.table == "smooth":
        for share in (False, True):
            print("smooth over 0.2 s, noise told" if share else "smooth over 0.2 s, not told")
            table(seeds, kinds, smooth=0.2, told=share)
    if told.table == "frames":
        frames_table(seeds, kinds)
    if told.table == "changes":
        changes_table(seeds)
    if told.table == "time":
        for kind in kinds:
            X, w, _ = record(kind, told.first, duration=10.0)
            start = time.process_time()
            answer(X, w)
            print(f"{kind:14} {time.process_time() - start:.2f} s of a processor, 10 s at 100 Hz")
    if told.table == "hand":
        hand_table(seeds, kinds)


if __name__ == "__main__":
    main()
