"""Every reason that the library can give has its entry on the troubleshooting page, and every entry is given somewhere.

Reasons are the sentences of `velocity/reasons.py`, and the texts of two words or more in the sources of other
solutions, without those that go into exceptions and warnings: what a checker of arguments is told, what is raised or
warned of.
`SolverFailure` ends in a reason.
"""

import ast
import re
from functools import cache
from pathlib import Path

import invariantqp as iq
from invariantqp.velocity.reasons import SENTENCES

PACKAGE = Path(iq.__file__).parent
PAGE = (Path(__file__).parent.parent / "examples" / "guide" / "troubleshooting.md").read_text(encoding="utf-8")
ROOMS = "velocity", "control", "paths", "force", "pose"
SOURCES = [file for room in ROOMS for file in (PACKAGE / room).rglob("*.py")]
SOURCES = sorted([*SOURCES, PACKAGE / "workbench" / "runs" / "run.py"])
SOURCES.remove(PACKAGE / "force" / "contact_kinds.py")  # its messages are those of wrong arguments alone
ENTRY = re.compile(r"^- ((?:`[^`]+`(?:, | or )?)+):", flags=re.MULTILINE)
ENTRIES = [phrase for found in ENTRY.finditer(PAGE) for phrase in re.findall(r"`([^`]+)`", found[1])]
# Exceptions whose message becomes part of a reason.
IN_REASONS = {"SolverFailure"}
# The sentences of reasons that are data, "…" for each value in one; those that are values alone say nothing.
VALUE = re.compile(r"\{[^}]*\}")
TABLE = {re.sub(r"(…\s*)+…", "…", VALUE.sub("…", text)).strip(" …:;,()") for text in SENTENCES.values()} - {""}
# Remedies of exceptions kept in tables, and what contacts and orders of readings are called.
NO_REASON = re.compile(
    r"the tool|h = 0|a complement|(moment|force) first|systems of … and … dimensions that share a twist"
    r"|lower … and upper … in row …, joint|at joint|pose search|primal infeasible"
    r"|one (twist|point|joint velocity) a Jacobian"
    r"|Give each TwistTask its own (form|point)\.|Add a JointTask of the last priority\."
    r"|Form and guard are for a twist by itself\."
    r"|<Clearance of .*|… and …, … mm|no joint moves it|fixed to one another|neighbours at.*|always nearer than .*"
    r"|not among the pairs given|a \(4, 4\) pose, a pinocchio\.SE3, a point \(3,\), or an iq\.Target"
)


def written(node):
    """The text of a constant or of a formatted string, "…" for each value in it; None for another node."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(part.value if isinstance(part, ast.Constant) else "…" for part in node.values)
    return None


def called(node):
    """The name of what is called, "" where it has none."""
    return getattr(node.func, "id", getattr(node.func, "attr", ""))


def checks(tree):
    """Names in a file that stand for checks of arguments."""
    imports = (node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom))
    names = {n.asname or n.name for node in imports if node.module == "invariantqp.geometry.arrays" for n in node.names}
    calls = (node.func for node in ast.walk(tree) if isinstance(node, ast.Call))
    return names | {f.attr for f in calls if isinstance(f, ast.Attribute) and getattr(f.value, "id", "") == "arrays"}


def reasons(source):
    """The texts of a file that can become part of a reason."""
    tree = ast.parse(source)
    outside = {"BadInput", "warn", "_warn", *checks(tree)}

    def inside(node):
        """The nodes of the tree but for exceptions, checks, docstrings and what forms are called."""
        if isinstance(node, ast.Raise) and not (isinstance(node.exc, ast.Call) and called(node.exc) in IN_REASONS):
            return
        if isinstance(node, ast.Call) and called(node) in outside:
            return
        if isinstance(node, ast.FunctionDef) and node.name == "describe":
            return
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            return
        yield node
        for child in ast.iter_child_nodes(node):
            if not (isinstance(node, ast.JoinedStr) and isinstance(child, ast.Constant)):
                yield from inside(child)

    nodes = list(inside(tree))
    read = {node.id for node in nodes if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)}
    names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)} - read
    assigned = [node for node in nodes if isinstance(node, ast.Assign)]
    unread = {id(value) for node in assigned if getattr(node.targets[0], "id", "") in names for value in ast.walk(node)}
    texts = (written(node) for node in nodes if id(node) not in unread)
    texts = (re.sub(r"(…\s*)+…", "…", text.strip()) for text in texts if text is not None and " " in text.strip())
    texts = {text.strip(" …:;,()") for text in texts}
    return {text for text in texts if re.search("[a-z]", text) and not NO_REASON.fullmatch(text)}


@cache
def given():
    """All reasons of the package."""
    sources = [file for file in SOURCES if file.name != "reasons.py"]
    return TABLE | {text for file in sources for text in reasons(file.read_text(encoding="utf-8"))}


def explains(entry, text):
    return re.search(re.escape(text).replace("…", ".+"), entry) is not None


def test_every_reason_has_its_entry():
    assert len(given()) > 80
    assert sorted(text for text in given() if not any(explains(entry, text) for entry in ENTRIES)) == []


def test_every_entry_is_a_reason():
    assert [entry for entry in ENTRIES if not any(explains(entry, text) for text in given())] == []
