"""The shape of the Rust code: no circles between modules, and no storey that looks up."""

import re
from pathlib import Path

import pytest

SOURCE = Path(__file__).parent.parent / "src"

# The storeys, the ground first. A folder may use its own storey and those below it.
STOREYS = [
    {"error", "cancel", "memory", "simd", "mirror"},
    {"picture", "rows"},
    {"carried", "noise"},
    {"color", "depth", "optics", "aperture", "files", "deep", "refine", "clipped", "matte"},
    {"scene"},
    {"plan", "views"},
    {"method"},
    {"cpu", "gpu"},
    {"device"},
    {"renderer"},
    {"python"},
]


def module_of(path, root):
    parts = path.relative_to(root).with_suffix("").parts
    return parts[:-1] if parts[-1] in ("mod", "lib") else parts


def without_tests(text):
    """Drop comments, strings and the unit tests, which may use anything."""
    text = re.sub(r'"(?:[^"\\]|\\.)*"', '""', re.sub(r"//[^\n]*", "", text))
    return re.split(r"#\[cfg\(test\)\]\s*mod \w+ \{", text)[0]


def expanded(use):
    """List the plain paths of ``a::{b, c::{d, e}}``."""
    if not (match := re.match(r"^(.*?)\{(.*)\}$", use, re.S)):
        return [use]
    paths, depth, start = [], 0, 0
    for i, character in enumerate(match[2] + ","):
        depth += (character == "{") - (character == "}")
        if character == "," and depth == 0:
            if item := match[2][start:i].strip():
                paths += expanded(match[1] + item)
            start = i + 1
    return paths


def imports(root):
    """Map every module to the modules that it names, by ``use`` or by a path."""
    files = {module_of(path, root): path for path in sorted(root.rglob("*.rs")) if "tests" not in path.stem}

    def target(module, path):
        names = path.split(" as ")[0].split("::")
        if names[0] == "crate":
            base, names = (), names[1:]
        elif names[0] == "super":
            ups = sum(name == "super" for name in names)
            base, names = module[: len(module) - ups], names[ups:]
        elif names[0] == "self":
            base, names = module, names[1:]
        elif (*module, names[0]) in files:
            base = module
        else:
            return None
        found = (*base, *names)
        while found and found not in files:
            found = found[:-1]
        return found

    graph = {}
    for module, path in files.items():
        text = without_tests(path.read_text())
        uses = [re.sub(r"\s+", "", use) for use in re.findall(r"\buse\s+([^;]+);", text)]
        rest = re.sub(r"\buse\s+[^;]+;", "", text)
        named = [name for use in uses for name in expanded(use)]
        named += re.findall(r"(?<![\w:])(?:\w+::)+\w+", rest)
        graph[module] = {found for name in named if (found := target(module, name)) and found != module}
    return graph


def circles(graph):
    """List the strongly connected components of more than one module, by Tarjan's algorithm."""
    index, low, stack, found = {}, {}, [], []

    def visit(module):
        index[module] = low[module] = len(index)
        stack.append(module)
        for other in sorted(graph[module]):
            if other not in index:
                visit(other)
                low[module] = min(low[module], low[other])
            elif other in stack:
                low[module] = min(low[module], index[other])
        if low[module] == index[module]:
            part = stack[stack.index(module) :]
            del stack[stack.index(module) :]
            if len(part) > 1:
                found.append(sorted("/".join(name) for name in part))

    for module in graph:
        if module not in index:
            visit(module)
    return found


def test_no_module_depends_on_itself_through_others():
    assert circles(imports(SOURCE)) == []


def test_no_storey_looks_up():
    level = {name: i for i, storey in enumerate(STOREYS) for name in storey}
    graph = imports(SOURCE)
    assert {module[0] for module in graph if module} == set(level)
    up = [
        ("/".join(module), "/".join(other))
        for module, others in graph.items()
        for other in others
        if module
        and other
        and (level[other[0]] > level[module[0]] or {module[0], other[0]} == {"cpu", "gpu"})
    ]
    assert up == []


def test_one_place_chooses_the_device():
    chosen = {
        str(path.relative_to(SOURCE))
        for path in SOURCE.rglob("*.rs")
        if re.search(r"Device::(Cpu|Gpu)(\(\w+\))? =>", without_tests(path.read_text()))
    }
    assert chosen == {"renderer.rs"}


@pytest.mark.parametrize(
    ("files", "expected"),
    [
        ({"a.rs": "use crate::b;", "b.rs": "fn f() {}"}, []),
        ({"a.rs": "use crate::b;", "b.rs": "fn f() { crate::a::g() }"}, [["a", "b"]]),
        ({"a/mod.rs": "mod b; fn f() { b::g() }", "a/b.rs": "use super::f;"}, [["a", "a/b"]]),
        ({"a.rs": "use crate::b::{c, d};", "b.rs": "", "c.rs": "// crate::a\n"}, []),
        ({"a.rs": "use crate::b;", "b.rs": "#[cfg(test)]\nmod tests {\n use crate::a; }"}, []),
    ],
)
def test_circles_are_found(tmp_path, files, expected):
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    assert circles(imports(tmp_path)) == expected
