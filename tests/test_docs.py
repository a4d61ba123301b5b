"""The documentation builds without a warning, notebooks run, links lead somewhere, pages fit screens."""

import subprocess
import sys
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

for package in (
    "sphinx",
    "myst_nb",
    "pydata_sphinx_theme",
    "numpydoc",
    "latex2mathml",
    "anywidget",
    "mitsuba",
):
    pytest.importorskip(package, reason=f"the documentation needs its dependency group: no {package}")

ROOT = Path(__file__).parents[1]
SIZES = {"desktop": (1280, 900), "phone": (390, 844)}


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    out = tmp_path_factory.mktemp("docs")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", "-d", out / "trees"]
    built = subprocess.run(
        [*command, ROOT / "docs", out / "html"], capture_output=True, text=True, check=False
    )
    assert built.returncode == 0, built.stdout + built.stderr
    return out / "html"


class Page(HTMLParser):
    """What a page links to, what it loads, and what can be linked to in it."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.names: set[str] = set()
        self.pictures: list[dict[str, str | None]] = []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        words = dict(attrs)
        self.names.update(words[key] for key in ("id", "name") if words.get(key))
        if tag == "a" and words.get("href"):
            self.links.append(words["href"])
        if tag == "link" and words.get("rel") in ("stylesheet", "icon", "preload", "modulepreload"):
            self.loads.append(words.get("href") or "")
        if tag in ("script", "img", "source", "iframe") and words.get("src"):
            self.loads.append(words["src"])
        if tag == "img":
            self.pictures.append(words)


@cache
def page_at(path: Path) -> Page:
    return Page(path)


def pages(site):
    return sorted(path for path in site.rglob("*.html") if "_static" not in path.parts)


def test_links_lead_somewhere(site):
    dead = []
    for path in pages(site):
        for link in page_at(path).links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if not target.is_file() or (
                parts.fragment
                and target.suffix == ".html"
                and unquote(parts.fragment) not in page_at(target).names
            ):
                dead.append((path.name, link))
    assert dead == []


def test_nothing_is_loaded_from_elsewhere(site):
    for path in pages(site):
        for load in page_at(path).loads:
            parts = urlsplit(load)
            assert parts.scheme in ("", "data"), (path.name, load)
            assert not parts.netloc, (path.name, load)
            assert parts.scheme or (path.parent / unquote(parts.path)).is_file(), (path.name, load)


def test_links_to_other_sites_are_safe(site):
    links = {link for path in pages(site) for link in page_at(path).links}
    assert [link for link in links if urlsplit(link).scheme not in ("", "https", "mailto")] == []


def test_pages_show_results_of_their_notebooks(site):
    """Pictures that cells drew are there, the widget's still among them."""
    for name, least in (
        ("tutorial", 6),
        ("optics", 4),
        ("gallery", 5),
        ("guide/notebook", 2),
        ("guide/mitsuba", 2),
    ):
        assert len(page_at(site / f"{name}.html").pictures) >= least, name


def test_every_public_name_is_in_the_reference(site):
    import dofsim
    from dofsim import batch, io, metrics, mitsuba, plot

    names = set().union(*(page_at(path).names for path in site.glob("api/*.html")))
    for module in (dofsim, batch, io, metrics, mitsuba, plot):
        for name in module.__all__:
            thing = getattr(module, name)
            if callable(thing):
                assert f"{module.__name__}.{name}" in names


def test_pages_fit_desktops_and_phones(site, browser):
    """In a browser: nothing sticks out of the page, nothing is asked for elsewhere, no script fails."""
    # Text that ends beyond the article's right edge, unless something in the article scrolls it into sight.
    sticking_out = """() => {
        const scrolls = (one) => ['auto', 'scroll'].includes(getComputedStyle(one).overflowX);
        const texts = 'article p, article li, article dt, article dd, article h1';
        return [...document.querySelectorAll(texts)].filter((text) => {
            let up = text;
            for (; !up.matches('.bd-article-container'); up = up.parentElement) {
                if (scrolls(up)) return false;
            }
            return text.getBoundingClientRect().right > up.getBoundingClientRect().right + 1;
        }).map((text) => text.textContent.slice(0, 60));
    }"""
    for width, height in SIZES.values():
        page = browser.new_page(viewport={"width": width, "height": height})
        requests, errors = [], []
        page.on("request", lambda request, into=requests: into.append(request.url))
        page.on("pageerror", lambda error, into=errors: into.append(str(error)))
        for path in pages(site):
            page.goto(path.as_uri())
            assert page.evaluate("document.documentElement.scrollWidth") <= width, path.name
            assert page.evaluate(sticking_out) == [], path.name
        assert [url for url in requests if not url.startswith(("file:", "data:"))] == []
        assert errors == []
        page.close()
