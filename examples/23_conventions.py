"""The picture of the conventions: what a twist's numbers are, in which frame they are, what a pitch is.

Run: python examples/23_conventions.py [picture.svg]
"""

import sys
from pathlib import Path

import numpy as np

import invariantqp as iq
from invariantqp.workbench.pictures.charts import BLUE, GREEN, VERMILION

# Paper, ink and muted ink in light, and in dark: a page may be dark where a browser is not, so the paper is its own.
STYLE = """
text { font: 14px system-ui, sans-serif; fill: #24292f } .small { font-size: 12.5px; fill: #57606a }
.head { font-size: 16px; font-weight: 600 } .line { stroke: #57606a } .thin { stroke: #8c959f }
.body { fill: #8c959f33 }
.turn { stroke: TURN } .go { stroke: GO } .place { stroke: PLACE }
.turnt { fill: TURN } .got { fill: GO } .placet { fill: PLACE }
.dash { stroke-dasharray: 1 5 }
path, rect, circle { fill: none; stroke-width: 2; stroke-linecap: round } .fill { fill: #57606a }
.paper { fill: #ffffff }
@media (prefers-color-scheme: dark) { .paper { fill: #0d1117 }
 text { fill: #e6edf3 } .small { fill: #9da7b1 } .line { stroke: #9da7b1 }
 .fill { fill: #9da7b1 } .turn { stroke: #ff8a4c } .go { stroke: #58a6ff } .place { stroke: #3fb98a }
 .turnt { fill: #ff8a4c } .got { fill: #58a6ff } .placet { fill: #3fb98a } }
"""
WIDTH, HEIGHT = 850, 350
PAPER = f'<rect class="paper" width="{WIDTH}" height="{HEIGHT}"/>'
# The drawing plane seen from the front, right and above: x to the left front, y to the right, z up.
SEEN = np.array([[-0.5, 0.9, 0.0], [0.32, 0.18, -0.95]])


def flat(points, origin, scale):
    """Points (n, 3) on the page (n, 2)."""
    return np.asarray(origin) + scale * np.atleast_2d(points) @ SEEN.T


def path(points, kind, arrow=""):
    """A curve, with an arrow's head of a class at its end."""
    d = "M" + " L".join(f"{x:.1f} {y:.1f}" for x, y in points)
    return f'<path d="{d}" class="{kind}"/>' + (head(points, arrow) if arrow else "")


def head(points, kind):
    """The head of an arrow along the last piece of a curve."""
    end, before = np.asarray(points[-1]), np.asarray(points[-2])
    along = (end - before) / np.linalg.norm(end - before)
    across = np.array([-along[1], along[0]])
    corners = [end + 3 * along, end - 8 * along + 4.5 * across, end - 8 * along - 4.5 * across]
    return f'<polygon points="{" ".join(f"{x:.1f},{y:.1f}" for x, y in corners)}" class="{kind}"/>'


def text(x, y, words, kind="", anchor="start"):
    return f'<text x="{x}" y="{y}" class="{kind}" text-anchor="{anchor}">{words}</text>'


def frame(T, origin, scale, size, name):
    """A frame's three axes, the letter of each at its end."""
    at = flat(T[:3, 3], origin, scale)[0]
    parts = []
    for k, letter in enumerate("xyz"):
        tip = flat(T[:3, 3] + size * T[:3, k], origin, scale)[0]
        parts += [path([at, tip], "line", "fill"), text(*(at + 1.25 * (tip - at) + (-4, 4)).round(1), letter, "small")]
    return "".join(parts) + text(at[0] + 2, at[1] + 26, name, "small", "middle")


def cells(x, y, letters, kinds, note):
    """Six numbers in a row of boxes."""
    out = []
    for k, letter in enumerate(letters):
        kind = kinds[k // 3]
        out += [f'<rect x="{x + 38 * k}" y="{y}" width="38" height="27" class="{kind}"/>']
        out += [text(x + 38 * k + 19, y + 18, letter, f"{kind}t", "middle")]
    return "".join(out) + text(x, y + 46, note, "small")


def twist_panel():
    origin, scale = (128, 165), 60
    spin = [(0.42 * np.cos(a), 0.42 * np.sin(a), 1.0) for a in np.linspace(-2.4, 2.9, 40)]
    body = [(0.0, 0.0), (48, -34), (108, -20), (120, 24), (66, 48), (8, 34), (0, 0)]
    blob = "M" + " L".join(f"{118 + x} {150 + y}" for x, y in body)
    at = flat(np.zeros(3), origin, scale)[0]
    out = [text(20, 28, "Twist: turn, then go", "head"), f'<path d="{blob}Z" class="body thin"/>']
    out += [frame(np.eye(4), origin, scale, 0.55, "frame")]
    out += [
        path([at, flat([0, 0, 1.45], origin, scale)[0]], "turn", "turnt"),
        path(flat(spin, origin, scale), "turn", "turnt"),
    ]
    out += [
        path([at, at + np.array([105, -52])], "go", "got"),
        text(at[0] - 16, at[1] - 80, "ω", "turnt"),
        text(at[0] + 112, at[1] - 52, "v", "got"),
    ]
    out += [
        cells(20, 236, ["ωx", "ωy", "ωz", "vx", "vy", "vz"], ("turn", "go"), "v: of the body at the frame's origin")
    ]
    out += [cells(20, 296, ["mx", "my", "mz", "fx", "fy", "fz"], ("turn", "go"), "wrench: moment about it, then force")]
    return "".join(out)


def frames_panel():
    origin, scale = (345, 190), 62
    tool = iq.transform(iq.exp([0.5, 0.0, 0.9, 0, 0, 0])[:3, :3], [-0.2, 2.1, 1.1])
    tip = (tool @ [0.0, 0.35, 1.0, 1.0])[:3]
    ends = [flat(p, origin, scale)[0] for p in (np.zeros(3), tool[:3, 3], tip)]
    out = [text(305, 28, "Frames", "head"), frame(np.eye(4), origin, scale, 0.75, "base")]
    bow = [ends[0] + t * (ends[1] - ends[0]) + (0, 46 * t * (1 - t)) for t in np.linspace(0.06, 0.94, 20)]
    out += [path(bow, "thin", "fill"), frame(tool, origin, scale, 0.6, "")]
    out += [text(ends[1][0] + 22, ends[1][1] + 20, "tool frame", "small")]
    out += [path([ends[1], ends[2]], "place dash")]
    out += [f'<circle cx="{ends[2][0]:.1f}" cy="{ends[2][1]:.1f}" r="4.5" class="place placet"/>']
    out += [text(ends[2][0] + 9, ends[2][1] - 6, "point", "placet")]
    out += [text(400, 222, "T = robot.pose(q)")]
    rows = (
        "in the base frame: poses, targets,",
        "Jacobian, twist, feedforward",
        "in the tool frame: point=",
        "tool to base: adjoint(T) for a twist,",
        "coadjoint(T) for a wrench",
    )
    out += [text(305, 258 + 21 * k, row, "small") for k, row in enumerate(rows)]
    return "".join(out)


def pitch_panel():
    out = [text(600, 28, "Pitch: length per radian", "head")]
    for x, h, name, note in ((632, 0.0, "h = 0", "hinge"), (717, 0.16, "h", "screw"), (802, np.inf, "h = ∞", "slide")):
        origin, scale = (x, 205), 62
        out += [path([(x, 218), (x, 56)], "thin")]
        if np.isinf(h):
            out += [path([(x + 18, 200), (x + 18, 85)], "go", "got")]
        else:
            turns = 1.85 if h else 0.85
            a = np.linspace(-1.4, -1.4 + 2 * np.pi * turns, 120)
            up = h * (a + 1.4) if h else np.full_like(a, 0.9)
            points = flat(np.column_stack((0.5 * np.cos(a), 0.5 * np.sin(a), up)), origin, scale)
            out += [path(points, "turn" if not h else "place", "turnt" if not h else "placet")]
            if h:
                low, high = (flat([0, 0, z], origin, scale)[0][1] for z in (0.0, 2 * np.pi * h))
                out += [
                    path([(x + 38, low), (x + 38, high)], "line", "fill"),
                    path([(x + 38, high), (x + 38, low)], "line", "fill"),
                ]
                out += [text(x + 42, 0.5 * (low + high) + 34, "2πh", "small")]
        out += [text(x, 246, name, "", "middle"), text(x, 264, note, "small", "middle")]
    rows = ("ω·v / ω·ω, the same in every", "frame; a turn advances by 2πh")
    return "".join(out) + "".join(text(600, 296 + 21 * k, row, "small") for k, row in enumerate(rows))


def main(file):
    style = STYLE.replace("PLACE", GREEN).replace("TURN", VERMILION).replace("GO", BLUE)
    parts = (twist_panel(), frames_panel(), pitch_panel())
    size = f'width="{WIDTH}" height="{HEIGHT}" viewBox="0 0 {WIDTH} {HEIGHT}"'
    drawn = f'<svg xmlns="http://www.w3.org/2000/svg" {size}><style>{style}</style>{PAPER}{"".join(parts)}</svg>\n'
    Path(file).write_text(drawn, encoding="utf-8")
    print(f"{file}: {len(drawn) // 1000 + 1} kB")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "conventions.svg")
