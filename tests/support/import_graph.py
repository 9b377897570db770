"""Which modules of a package import which, from their source alone: at the top, in functions, for type checkers.

`import a.b` and `from a.b import c` are arrows to the module that they name, a.b.c where that is one; running
a/__init__.py on the way is none. Print the rooms of the package and their arrows with

    PYTHONPATH=tests python -m support.import_graph invariantqp
"""

import ast
import sys
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

Graph = dict[str, set[str]]


def import_graph(package: Path) -> Graph:
    """{module: modules of the package that it imports}, from the folder of the package."""
    files = {_name(file, package): file for file in sorted(package.rglob("*.py"))}
    return {name: set(_imported(name, file, files)) - {name} for name, file in files.items()}


def _name(file: Path, package: Path) -> str:
    parts = [package.name, *file.relative_to(package).with_suffix("").parts]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _imported(name: str, file: Path, modules: dict[str, Path]) -> Iterator[str]:
    home = name if file.name == "__init__.py" else name.rpartition(".")[0]
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in modules)
        elif isinstance(node, ast.ImportFrom):
            above = home.split(".")[: len(home.split(".")) - node.level + 1] if node.level else []
            source = ".".join([*above, *([node.module] if node.module else [])])
            for alias in node.names:
                target = f"{source}.{alias.name}"
                if target in modules:
                    yield target
                elif source in modules:
                    yield source


def circle(graph: Graph) -> list[str]:
    """The modules of one import circle, the first again at the end; empty if there is none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def rooms(graph: Graph, depth: int = 1) -> Graph:
    """The arrows between folders: modules with the same first `depth` names below the package are one room."""

    def room(module: str) -> str:
        return ".".join(module.split(".")[1 : depth + 1])

    found: Graph = {room(module): set() for module in graph if room(module)}
    for module, targets in graph.items():
        if room(module):
            found[room(module)] |= {room(target) for target in targets if room(target)} - {room(module)}
    return found


if __name__ == "__main__":
    drawn = import_graph(Path(sys.argv[1]))
    print(f"{len(drawn)} modules, {sum(map(len, drawn.values()))} arrows, circle: {circle(drawn) or 'none'}")
    for here, there in sorted(rooms(drawn).items()):
        print(f"{here} -> {', '.join(sorted(there)) or 'nothing'}")
