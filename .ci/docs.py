"""The site: the guide, and the API reference from docstrings, one HTML page a module.

Anything pdoc cannot make sense of is an error, and so is a link in the guide that leads nowhere.

Run: python .ci/docs.py OUTPUT_FOLDER
"""

import ast
import inspect
import sys
import typing
import warnings
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules, walk_packages
from types import ModuleType

import guide
import pdoc
import pdoc.doc
from numpy.typing import ArrayLike

import invariantqp as iq
from invariantqp.geometry.arrays import Array
from invariantqp.velocity import reasons

# What a newcomer looks for comes first on the page of public names.
ORDER = (
    *("robots", "control", "velocity", "paths", "force", "identification", "pose", "workbench"),
    *("geometry", "systems", "engine", "errors", "version"),
)
# Aliases that a signature would spell out, as signatures spell them out, and what they are called.
ALIASES = {inspect.formatannotation(alias): name for alias, name in ((ArrayLike, "ArrayLike"), (Array, "Array"))}
# robosuite needs NumPy below 2, and so an environment of its own: here its names are enough.
ROBOSUITE = ("composite.composite_controller", "composite.composite_controller_factory", "parts.controller")


class Named(ModuleType):
    """A module of which only names are needed: each is a class that returns what it is called with."""

    def __getattr__(self, name: str) -> type:
        """The class of that name."""
        if name.startswith("__"):
            raise AttributeError(name)
        return type(name, (), {"__new__": lambda _, value: value})


def resolve(module: ModuleType) -> None:
    """Let the annotations of a module's named tuples, which are names there, be read from anywhere."""
    for value in vars(module).values():
        if isinstance(value, type) and issubclass(value, tuple) and value.__module__ == module.__name__:
            hints = typing.get_type_hints(value.__new__, {"Array": Array} | vars(reasons) | vars(module))
            value.__new__.__annotations__ = hints
            value.__annotations__ = {name: hints[name] for name in value._fields if name in hints}


def called_by_name(spelled: typing.Callable[..., str]) -> typing.Callable[..., str]:
    """Annotations with aliases by their names."""

    def spell(annotation: object, *arguments: object, **options: object) -> str:
        text = spelled(annotation, *arguments, **options)
        for alias, name in ALIASES.items():
            inside = alias.removeprefix("Union[").removesuffix("]") if alias.startswith("Union[") else alias
            text = text.replace(alias, name).replace(inside, name)
        return text

    return spell


def main(folder: Path) -> None:
    """Write the pages."""
    warnings.simplefilter("error")
    source = ast.parse(Path(iq.__file__).read_text(encoding="utf-8"))
    imports = [node for node in ast.walk(source) if isinstance(node, ast.ImportFrom)]
    homes = {alias.name: str(node.module) for node in imports for alias in node.names}
    iq.__all__.sort(key=lambda name: ORDER.index(homes[name].split(".")[1]))
    for name in ROBOSUITE:
        sys.modules[f"robosuite.controllers.{name}"] = Named(name)
    for found in walk_packages(iq.__path__, "invariantqp."):
        resolve(import_module(found.name))
    inspect.formatannotation = pdoc.doc.formatannotation = called_by_name(inspect.formatannotation)
    modules = [f"invariantqp.{module.name}" for module in iter_modules(iq.__path__)]
    pdoc.render.configure(docformat="google", footer_text=f"invariantqp {iq.__version__}")
    pdoc.pdoc("invariantqp", *modules, output_directory=folder)
    page = (folder / "invariantqp.html").read_text(encoding="utf-8")
    missing = [name for name in iq.__all__ if name != "__version__" and f'<section id="{name}"' not in page]
    if missing:
        sys.exit(f"not on the first page: {', '.join(missing)}")
    print(f"{len(iq.__all__)} public names, {len(list(folder.rglob('*.html')))} pages: {folder / 'invariantqp.html'}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
    guide.main(Path(sys.argv[1]) / "guide")
