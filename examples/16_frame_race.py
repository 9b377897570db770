"""One motion, told to the same loop twice: the tool frame is put elsewhere on the tool, nothing else changes.

A UR5 is pulled out of its reach and back. Left, a least-squares QP by DAQP with Levenberg and Marquardt's damping, told
posture, limits and feedforward; right, this library, told the same and the physical point where accuracy counts. Where
the arm cannot do what is asked, least squares weighs metres and radians at the origin of the tool frame, so the two
descriptions of one motion give two motions.

Run: python examples/16_frame_race.py [film.gif [frames]]     prints how far the joints part, and draws it
     python examples/16_frame_race.py --picture               draws examples/pictures/frame_race.gif
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.figure import Figure

import invariantqp as iq
from invariantqp.compare.measure.displaced import displaced
from invariantqp.compare.measure.frames import moved_start, random_displacement
from invariantqp.compare.registry import controller_named
from invariantqp.runs.pilots import pilot_of
from invariantqp.runs.prepare import prepare
from invariantqp.runs.run import run

TASK, SEED, SEEDS = "stability/reach_and_back", 2, 10  # of the displacement drawn, and of all that are counted
ROWS = {"QP with LM": "least-squares QP", "invariantqp": "invariantqp"}
FRAMES, SHARE, PICTURE = 70, 0.5, Path(__file__).parent / "pictures" / "frame_race.gif"
COLOURS = ("#0072B2", "#D55E00")  # the frame as it is, the frame moved
VIEW = np.array([[0.94, 0.34, 0.0], [-0.1, 0.27, 0.96]])  # base frame to paper


def runs(method, seeds):
    """Joint positions (n + 1, m): with the tool frame as it is, with the start moved by rounding, with moved frames."""
    task = iq.load_task(TASK)
    plain = prepare(task)
    setups = [
        plain,
        moved_start(task, plain),
        *(displaced(prepare(task), random_displacement(k)) for k in range(seeds)),
    ]
    return [run(setup, pilot_of(setup.brief, controller_named(method))).q for setup in setups], plain


def stick(robot, q):
    """The arm on paper (2, m + 2)."""
    return VIEW @ np.vstack((np.zeros(3), robot.origins(q), robot.pose(q)[:3, 3])).T


def changed_sides(paths):
    """How many of the moved frames end with joints more than 1 rad from where they end with the frame as it is."""
    return sum(bool(np.abs(paths[0] - q)[-1].max() > 1.0) for q in paths[2:])


def draw(found, file, frames):
    figure = Figure(figsize=(8.5, 3.95), dpi=100)  # with a layout of its own: every frame has the same
    panels = figure.subplots(1, 2)
    figure.subplots_adjust(left=0.01, right=0.99, top=0.92, bottom=0.12, wspace=0.03)
    lines = []
    for axes, (title, (paths, setup)) in zip(panels, found.items(), strict=True):
        axes.set_aspect("equal")
        axes.set(xlim=(-0.3, 1.15), ylim=(-0.35, 0.75), xticks=[], yticks=[])
        axes.set_title(title, fontsize=14, fontweight="bold")
        often = f"the elbow flips with {changed_sides(paths)} of {len(paths) - 2} tool frames"
        axes.text(0.03, 0.92, often, transform=axes.transAxes, fontsize=12)
        goal = axes.plot([], [], "+", color="#222222", markersize=16, markeredgewidth=2.5, zorder=5, label="target")[0]
        arms = [
            axes.plot(
                [], [], "-o", color=c, linewidth=w, markersize=w + 1, alpha=0.85, solid_capstyle="round", label=name
            )[0]
            for c, w, name in zip(COLOURS, (8.0, 3.5), ("tool frame as it is", "tool frame moved"), strict=True)
        ]
        lines.append(
            (
                goal,
                arms,
                axes.text(0.03, 0.04, "", transform=axes.transAxes, fontsize=14),
                (paths[0], paths[2 + SEED]),
                setup,
            )
        )
    figure.legend(
        *panels[0].get_legend_handles_labels(),
        loc="lower center",
        bbox_to_anchor=(0.5, -0.01),
        ncols=3,
        frameon=False,
        fontsize=13,
    )

    def show(k):
        for goal, arms, text, paths, setup in lines:
            i = int(SHARE * k / (frames - 1) * (len(paths[0]) - 1))
            goal.set_data(*(VIEW @ setup.wanted[i][:3, 3])[:, None])
            for line, q in zip(arms, paths, strict=True):
                line.set_data(*stick(setup.robot, q[i]))
            text.set_text(f"joints apart by {np.abs(paths[0][i] - paths[1][i]).max():.2g} rad")

    FuncAnimation(figure, show, frames=frames).save(file, writer=PillowWriter(fps=14))


def main(word, frames):
    found = {title: runs(method, min(SEEDS, frames)) for method, title in ROWS.items()}
    for title, ((plain, nudged, *moved), _) in found.items():
        apart = [np.abs(plain - q).max() for q in moved]
        print(f"{title}, {len(moved)} other tool frames: the joints part by {min(apart):.1e} to {max(apart):.1e} rad,")
        print(f"  at the end by more than 1 rad in {changed_sides([plain, nudged, *moved])} of them;", end=" ")
        print(f"a start moved by 1e-12 parts them by {np.abs(plain - nudged).max():.1e} rad")
    draw(found, PICTURE if word == "--picture" else word, frames)


if __name__ == "__main__":
    words = dict(enumerate(sys.argv))
    main(words.get(1, "frame_race.gif"), int(words.get(2, FRAMES)))
