from functools import cache
from pathlib import Path

import pytest
from support.import_graph import circle, import_graph, rooms

import invariantqp as iq

PACKAGE = Path(iq.__file__).parent


@cache
def ours():
    return import_graph(PACKAGE)


def written(folder, files):
    """A package p made of {"a": source, "b.c": source}."""
    for name, source in ({"": "", **files}).items():
        file = folder.joinpath("p", *name.split("."))
        file = file / "__init__.py" if name in ("", "b") else file.with_suffix(".py")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(source, encoding="utf-8")
    return import_graph(folder / "p")


@pytest.mark.parametrize(
    "source",
    [
        "import p.a",
        "from p.a import x",
        "from p import a",
        "from ..a import x",
        "from .. import a",
        "def f():\n    import p.a",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from p.a import X",
    ],
)
def test_every_way_to_import_is_an_arrow(tmp_path, source):
    graph = written(tmp_path, {"a": "from p.b.c import y", "b": "", "b.c": source})
    assert graph == {"p": set(), "p.a": {"p.b.c"}, "p.b": set(), "p.b.c": {"p.a"}}
    assert set(circle(graph)) == {"p.a", "p.b.c"}


def test_the_face_of_a_package_is_a_module_too(tmp_path):
    graph = written(tmp_path, {"": "from p.a import x", "a": "from p import __version__", "b": "", "b.c": "import p.b"})
    assert graph == {"p": {"p.a"}, "p.a": {"p"}, "p.b": set(), "p.b.c": {"p.b"}}
    assert set(circle(graph)) == {"p", "p.a"}


def test_a_circle_of_three_is_found(tmp_path):
    files = {"a": "import p.d", "d": "import p.e", "e": "import p.a", "b": "", "b.c": "import p.a"}
    graph = written(tmp_path, files)
    assert set(circle(graph)) == {"p.a", "p.d", "p.e"}
    assert rooms(graph) == {"a": {"d"}, "d": {"e"}, "e": {"a"}, "b": {"a"}}
    assert circle({**graph, "p.e": set()}) == []


def test_no_module_imports_itself_by_way_of_others():
    assert len(ours()) > 150
    assert circle(ours()) == []


def test_no_module_imports_the_face_of_the_package():
    assert [name for name, targets in ours().items() if "invariantqp" in targets] == []


def test_no_folder_imports_itself_by_way_of_others():
    assert circle(rooms(ours())) == []
    compare = {name: targets for name, targets in ours().items() if name.startswith("invariantqp.workbench.compare")}
    inside = rooms({name: targets & set(compare) for name, targets in compare.items()}, depth=3)
    assert len(inside) > 5
    assert circle(inside) == []
