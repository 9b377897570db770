"""HTML pages from Jinja templates."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from typing import Any

from invariantqp.extras import require


def fill_template(package: str, template: str, values: Mapping[str, Any]) -> str:
    """A package's template filled with values, which are escaped unless the template marks them as `safe`."""
    require("pictures", "jinja2")
    from jinja2 import Environment, StrictUndefined

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.policies["json.dumps_kwargs"] = {"allow_nan": False}
    text = (resources.files(package) / template).read_text(encoding="utf-8")
    return environment.from_string(text).render(values)
