"""The guide as HTML beside the API reference; a link that leads nowhere is an error."""

import re
import shutil
import sys
from pathlib import Path

import markdown2  # pdoc brings it, and Pygments
from pygments.formatters import HtmlFormatter

ROOT = Path(__file__).parent.parent
GUIDE = ROOT / "examples" / "guide"
PICTURES = ROOT / "examples" / "pictures"
EXTRAS = ["tables", "fenced-code-blocks", "header-ids", "code-friendly", "cuddled-lists"]
PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title><style>
:root {{ color-scheme: light dark; --ink: #24292f; --paper: #fff; --rule: #8c959f55; --link: #0969da }}
@media (prefers-color-scheme: dark) {{ :root {{ --ink: #e6edf3; --paper: #0d1117; --link: #58a6ff }} }}
body {{ font: 16px/1.55 system-ui, sans-serif; color: var(--ink); background: var(--paper); margin: 0 auto;
  max-width: 1180px; padding: 16px; display: grid; grid-template-columns: 240px minmax(0, 1fr); gap: 36px }}
nav {{ font-size: 14px; position: sticky; top: 16px; align-self: start;
  max-height: calc(100vh - 32px); overflow-y: auto }}
nav a {{ display: block; padding: 3px 0 }}
nav a.here {{ color: var(--ink); font-weight: 600 }} a {{ color: var(--link); text-decoration: none }}
main {{ max-width: 880px }} img {{ max-width: 100% }} code {{ font-size: 13.5px }}
pre {{ padding: 12px; overflow-x: auto; border: 1px solid var(--rule); border-radius: 6px }}
table {{ border-collapse: collapse; display: block; overflow-x: auto }}
td, th {{ border: 1px solid var(--rule); padding: 5px 10px; text-align: left; vertical-align: top }}
@media (max-width: 760px) {{ body {{ display: block }}
  nav {{ position: static; max-height: 112px; padding: 0 8px; border: 1px solid var(--rule); border-radius: 6px }} }}
{light} @media (prefers-color-scheme: dark) {{ {dark} }}
</style></head><body><nav><a href="../invariantqp.html">API reference</a>{nav}</nav><main>{body}</main></body></html>
"""


def named(page: str) -> str:
    """The file of a page of the guide, or of CONTRIBUTING."""
    return "index.html" if page.endswith("README.md") else Path(page).with_suffix(".html").name


def moved(link: str) -> str:
    """A link of a page, in the built guide."""
    page, mark, place = link.partition("#")
    if page.startswith("../pictures/"):
        return page.removeprefix("../")
    return named(page) + mark + place if page.endswith(".md") and "://" not in page else link


def main(folder: Path) -> None:
    """Write the pages of the guide to a folder, and beside it the page that a site opens with."""
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copytree(PICTURES, folder / "pictures", dirs_exist_ok=True)
    first = (GUIDE / "README.md").read_text(encoding="utf-8")
    listed = [("The guide", "README.md"), *re.findall(r"^- \[([^\]]+)\]\(([^)]+)\)", first, flags=re.MULTILINE)]
    style = {"light": HtmlFormatter(style="default"), "dark": HtmlFormatter(style="github-dark")}
    colours = {name: made.get_style_defs(".codehilite") for name, made in style.items()}
    for source in [*GUIDE.glob("*.md"), ROOT / ".github" / "CONTRIBUTING.md"]:
        body = markdown2.markdown(source.read_text(encoding="utf-8"), extras=EXTRAS)
        body = re.sub(r'(href|src)="([^"]+)"', lambda m: f'{m[1]}="{moved(m[2])}"', body)
        nav = "".join(
            f'<a href="{named(page)}"{" class=here" if page == source.name else ""}>{title}</a>'
            for title, page in listed
        )
        text = PAGE.format(title=source.stem, nav=nav, body=body, **colours)
        (folder / named(source.name)).write_text(text, encoding="utf-8")
    start = '<!doctype html><meta http-equiv="refresh" content="0; url=guide/index.html"><title>invariantqp</title>'
    (folder.parent / "index.html").write_text(start, encoding="utf-8")
    links = {(p, link) for p in folder.glob("*.html") for link in re.findall(r'(?:href|src)="([^"#]+)', p.read_text())}
    lost = [f"{page.name}: {link}" for page, link in links if "://" not in link and not (folder / link).exists()]
    if lost:
        sys.exit("links that lead nowhere: " + ", ".join(sorted(lost)))
    print(f"{len(list(folder.glob('*.html')))} pages of the guide: {folder / 'index.html'}")
