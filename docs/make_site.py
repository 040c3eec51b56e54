"""The documents as a site, for `make docs`.

    python docs/make_site.py            lays out all pages in one folder, with what else they link to and the
                                        pages that are made of the code (reference.py)
    python docs/make_site.py publish    checks that the site that was built of it is whole, and moves it to
                                        where the service finds it for /manual

On a site there is nothing beside it: a link out of `docs/` leads to a copy. Nothing is fetched from
elsewhere.
"""

from __future__ import annotations

import re
import shutil
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

ROOT = Path(__file__).resolve().parents[1]
STAGE = ROOT / "build" / "site-source"
SITE = ROOT / "build" / "site"
PUBLISHED = ROOT / "app" / "panel" / "manual_site"
LINK = re.compile(r"(?<=\]\()(?![a-z]+:|#)([^)\s#]+)")


def stage(folder: Path) -> None:
    """Fill a folder anew."""
    shutil.rmtree(folder, ignore_errors=True)
    for source in sorted(
        [
            *ROOT.glob("*.md"),
            *(ROOT / "docs").rglob("*.md"),
            *(ROOT / "docs").glob("*.png"),
            *(ROOT / "docs").glob("*.gif"),
            *(ROOT / "docs").glob("*.js"),
        ]
    ):
        target = folder / staged(source)
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.suffix == ".md":
            target.write_text(_with_links(source, folder), encoding="utf-8")
        else:
            shutil.copyfile(source, target)
    sys.path[:0] = [str(ROOT / "docs"), str(ROOT)]
    from reference import pages

    for name, text in pages().items():
        (folder / name).write_text(text, encoding="utf-8")


def staged(source: Path) -> str:
    """Where a file of the repository is on the site, whose pages are all in one folder.

    Python files are text there: browsers show it, and no tool takes the copies for the project's code.
    """
    path = source.relative_to(ROOT)
    if path.name == "README.md":  # a site's first page, which is docs/index.md
        return "about.md"
    page = len(path.parts) == 1 and path.suffix == ".md"
    if page or path.parts[0] == "docs":
        return path.name.lower()
    return f"files/{path}.txt" if path.suffix == ".py" else f"files/{path}"


def _with_links(page: Path, folder: Path) -> str:
    def link(found: re.Match[str]) -> str:
        target = (page.parent / found[1]).resolve()
        name = staged(target)
        if name.startswith("files/"):
            copy = folder / name
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(target, copy)
        return name

    return LINK.sub(link, page.read_text(encoding="utf-8"))


class _Page(HTMLParser):
    """What a page has and wants.

    Attributes:
        places: that a link can lead to.
        links: for who reads.
        loads: what a browser gets by itself.
    """

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.places: set[str] = set()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.feed(file.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name == "id" and value:
                self.places.add(value)
            elif name in ("href", "src", "srcset") and value:
                (self.links if tag == "a" else self.loads).append(value)


def problems(site: Path) -> Iterator[str]:
    """Links of a site that lead nowhere, and whatever its pages would fetch from elsewhere."""
    pages = {file.name: _Page(file) for file in sorted(site.glob("*.html")) if file.name != "404.html"}
    for name, page in pages.items():
        for link in page.links:
            url = urlsplit(link)
            target, place = unquote(url.path) or name, unquote(url.fragment)
            if url.scheme:
                continue
            if not (site / target).exists() or (
                place and target in pages and place not in pages[target].places
            ):
                yield f"{name}: {link} leads nowhere"
        for load in page.loads:
            if urlsplit(load).scheme or load.startswith("//"):
                yield f"{name}: {load} would be fetched from elsewhere"


def main() -> int:
    """The exit status."""
    if sys.argv[1:] != ["publish"]:
        stage(STAGE)
        shutil.copyfile(ROOT / "docs" / "zensical.toml", ROOT / "build" / "zensical.toml")  # next to the site
        return 0
    if found := list(problems(SITE)):
        print("\n".join(found))
        return 1
    shutil.rmtree(PUBLISHED, ignore_errors=True)
    SITE.rename(PUBLISHED)
    return 0


if __name__ == "__main__":
    sys.exit(main())
