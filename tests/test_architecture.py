"""The laws, read from the sources: who imports whom, which third parties, how large things get."""

import ast
import re
import subprocess
import sys
from collections import Counter, defaultdict
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("cosim", "protocols", "experiments")
SOURCES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))

LINES = (
    "units errors arrays ranges caches sources processes jit elementary installed page",
    "randomness settings geometry documents statistics",
    "observation machine protocol navigation",
    "trace intervals payloads kernel",
    "world",
    "robots channels",
    "node faults present scenario decoding beliefs series simulation columns parts results upkeep experiment sweep "
    "cluster",
    "timeline report export web picture testing parallel env pins warm live data_dictionary console cli_pictures "
    "cli_sweeps cli __main__",
)
"""The layers of cosim: each may import all lines above its own, its own package, and what stands left in its line."""
PLACES = {name: (depth, at) for depth, line in enumerate(LINES) for at, name in enumerate(line.split())}
STRANGERS = {("robots", "channels"), ("channels", "robots")}
PROTOCOLS_MAY = {
    *("units", "errors", "arrays", "jit", "elementary", "settings", "randomness", "geometry", "documents"),
    *("observation", "machine", "protocol", "page", "navigation"),
}

OWNERS = {
    "simpy": {"kernel"},
    "pyarrow": {"trace", "columns", "parts", "results", "report", "export"},
    "pandas": {"trace", "results", "report", "export"},
    "markdown_it": {"report"},
    "numba": {"jit"},
    "click": {"console", "cli_pictures", "cli_sweeps", "cli"},
    "rich": {"console"},
    "starlette": {"web"},
    "uvicorn": {"web"},
    "websockets": {"web"},
    "gymnasium": {"parallel"},
    "pettingzoo": {"parallel"},
    "SALib": {"report"},
    "mcap": {"export"},
    "imageio_ffmpeg": {"picture"},
    "dask": {"cluster"},
    "distributed": {"cluster"},
    "dask_jobqueue": {"cluster"},
    "random": set(),
    "time": {"processes", "sweep", "cluster", "results", "upkeep", "web", "warm", "live", "cli"},
    "datetime": {"sweep", "results", "cli"},
}
"""Modules from outside that only these layers of cosim may import; the wall clock where runs are timed or live."""
PROTOCOL_PARTIES = {"numpy", "scipy", "networkx", "pydantic"}

LIBRARY_FUNCTIONS = {
    *("exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "pow", "power", "sin", "cos", "tan", "hypot", "dot"),
    *("atan", "atan2", "asin", "acos", "arctan", "arctan2", "arcsin", "arccos", "erf", "erfc", "matmul", "einsum"),
}
"""Functions of math and numpy that differ in the last bit; math.hypot is Python's own, of + * / and sqrt."""

VERSION = r"__version__ = '[\d.]+'"
EXTENSIBLE = ("protocols", "experiments")
"""Packages to which users add folders of their own that have the same name."""
EXTENDED = ["from pkgutil import extend_path", "__path__ = extend_path(__path__, __name__)"]

FILE_LINES, FUNCTION_LINES, PUBLIC_METHODS, CONSTRUCTOR_PARAMETERS, FOLDER_ENTRIES = 800, 60, 20, 8, 25
ROOT_LINES = range(5, 16)
STARS = {"Draws"}
"""Classes whose constructors may take any number of parameters: the names of a random stream."""
NAMESAKES = {("cosim", "Outcome")}
"""Classes of one name that users have known for long: what became of a payload, and of a run."""
"""How many lines the docstring of a package root may have."""
LISTS = ("cosim", "experiments")
"""Folders that may have more entries: the table of layers above, and a list of experiments."""


# ---------------------------------------------------------------- reading


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_name(path) for path in SOURCES}


def imports(tree: ast.AST) -> Iterator[str]:
    """Yield the dotted name of everything that is imported anywhere, TYPE_CHECKING blocks and functions included."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"line {node.lineno}: a relative import hides the layer"
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                if inner != "cosim.__version__":  # a literal in a package root: it loads nothing
                    yield inner if inner in MODULES else str(node.module)


def layer(module: str) -> str:
    return module.split(".")[1] if "." in module else ""


def import_fault(importer: str, imported: str) -> str | None:
    """Return one sentence if *importer* must not import *imported*, both dotted module names."""
    package, other = importer.split(".")[0], imported.split(".")[0]
    if other not in PACKAGES:
        return party_fault(importer, other)
    if imported == other:
        return f"{importer} imports the package root {imported}"
    here, there = layer(importer), layer(imported)
    if package == "protocols":
        if other == "experiments" or (other == "cosim" and there not in PROTOCOLS_MAY):
            return f"{importer} imports {imported}, but a protocol knows only {', '.join(sorted(PROTOCOLS_MAY))}"
        return None
    if package == "experiments":
        return None
    if other != "cosim":
        return f"{importer} imports {imported}, but cosim knows no protocol and no experiment by name"
    if here == there:
        return None
    if (here, there) in STRANGERS or PLACES[there] >= PLACES[here]:
        return f"{importer} imports {imported}, but {there} does not stand above {here} in the table of layers"
    return None


def party_fault(importer: str, party: str) -> str | None:
    package = importer.split(".")[0]
    if package == "protocols":
        if party not in PROTOCOL_PARTIES and party not in sys.stdlib_module_names:
            return f"{importer} imports {party}, but protocols use only {', '.join(sorted(PROTOCOL_PARTIES))}"
        if party in {"random", "time", "datetime", "secrets", "uuid"}:
            return f"{importer} imports {party}, but time and randomness are arguments"
    if package == "cosim" and party in OWNERS and layer(importer) not in OWNERS[party]:
        return f"{importer} imports {party}, which belongs to {', '.join(sorted(OWNERS[party])) or 'nobody'}"
    return None


def cycle(graph: dict[str, set[str]]) -> list[str]:
    """Return the modules of one import cycle in *graph*, in order, or nothing."""
    done: set[str] = set()

    def visit(module: str, path: list[str]) -> list[str]:
        if module in path:
            return path[path.index(module) :]
        if module in done:
            return []
        for other in sorted(graph.get(module, ())):
            if found := visit(other, [*path, module]):
                return found
        done.add(module)
        return []

    for module in sorted(graph):
        if found := visit(module, []):
            return found
    return []


def oversized(tree: ast.Module, lines: int) -> list[str]:
    """Return a sentence for every budget that *tree*, a file of that many *lines*, exceeds."""
    faults = [f"{lines} lines, {FILE_LINES} are enough"] if lines > FILE_LINES else []
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            length = (node.end_lineno or node.lineno) - node.lineno + 1
            if length > FUNCTION_LINES:
                faults.append(f"{node.name} has {length} lines, {FUNCTION_LINES} are enough")
        if isinstance(node, ast.ClassDef):
            public = [f for f in node.body if isinstance(f, ast.FunctionDef) and not f.name.startswith("_")]
            if len(public) > PUBLIC_METHODS:
                faults.append(f"{node.name} has {len(public)} public methods, {PUBLIC_METHODS} are enough")
            faults += constructor_faults(node)
    return faults


def constructor_faults(node: ast.ClassDef) -> list[str]:
    """Return a sentence if the constructor of a class takes too much; what a star takes has no bound."""
    faults = []
    for made in node.body:
        if isinstance(made, ast.FunctionDef) and made.name == "__init__":
            taken = made.args
            count = len(taken.posonlyargs + taken.args + taken.kwonlyargs) - 1
            if (taken.vararg or taken.kwarg) and node.name not in STARS:
                faults.append(f"the constructor of {node.name} takes any number of parameters")
            elif count > CONSTRUCTOR_PARAMETERS:
                faults.append(
                    f"the constructor of {node.name} takes {count} parameters, {CONSTRUCTOR_PARAMETERS} are enough"
                )
    return faults


def crowded(modules: Collection[str]) -> list[str]:
    """Return a sentence for every package that has too many of *modules*, by their dotted names, right below it."""
    entries = Counter(module.rpartition(".")[0] for module in modules)
    return [
        f"{package} has {count} entries, {FOLDER_ENTRIES} are enough"
        for package, count in sorted(entries.items())
        if count > FOLDER_ENTRIES and package not in (*LISTS, "")
    ]


def doubled(trees: Mapping[str, ast.Module]) -> list[str]:
    """Return a sentence for every name that public classes of two modules in one package have."""
    places = defaultdict(list)
    for module, tree in sorted(trees.items()):
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[module.rpartition(".")[0], node.name].append(module)
    return [
        f"a class {key[1]} is in each of {', '.join(where)}"
        for key, where in places.items()
        if len(where) > 1 and key not in NAMESAKES
    ]


def root_fault(package: str, tree: ast.Module) -> str | None:
    """Return one sentence if *tree*, the root of *package*, is silent or does more than to say what lives there."""
    told = ast.get_docstring(tree)
    written = tree.body[0].end_lineno if told else 0  # its lines in the source, quotes included
    if written not in ROOT_LINES:
        return f"the root of {package} does not say in 5 to 15 lines what lives there and where to begin"
    for statement in tree.body[told is not None :]:
        source = ast.unparse(statement)
        version = package == "cosim" and re.fullmatch(VERSION, source)
        if not version and not (package in EXTENSIBLE and source in EXTENDED):
            return f"the root of {package} re-exports or does something: {source}"
    return None


TREES = {module_name(path): ast.parse(path.read_text(encoding="utf-8"), str(path)) for path in SOURCES}
LENGTHS = {module_name(path): len(path.read_text(encoding="utf-8").splitlines()) for path in SOURCES}


# ---------------------------------------------------------------- the laws


def test_every_layer_has_its_place():
    strange = {layer(module) for module in MODULES if module.startswith("cosim.")} - PLACES.keys()
    assert not strange, f"the table of layers does not know {sorted(strange)}"


def test_imports_look_up_only():
    faults = [
        fault for module, tree in TREES.items() for name in imports(tree) if (fault := import_fault(module, name))
    ]
    assert not faults, faults[0]


def test_no_experiment_imports_another():
    """What several share is in a folder without a sweep.yaml."""
    own = {path.parent.name for path in (ROOT / "experiments").glob("*/sweep.yaml")}
    faults = [
        f"{module} imports {name}"
        for module, tree in TREES.items()
        if module.startswith("experiments.")
        for name in imports(tree)
        if name.startswith("experiments.") and layer(name) in own - {layer(module)}
    ]
    assert not faults, faults[0]


def test_there_are_no_import_cycles():
    graph = {module: {name for name in imports(tree) if name in MODULES} for module, tree in TREES.items()}
    found = cycle(graph)
    assert not found, f"an import cycle: {' -> '.join(found)}"


def test_files_functions_and_classes_keep_their_budgets():
    faults = [f"{name}: {fault}" for name, tree in TREES.items() for fault in oversized(tree, LENGTHS[name])]
    assert not faults, faults[0]


def test_folders_keep_their_budget():
    faults = crowded(MODULES)
    assert not faults, faults[0]


def test_no_two_classes_of_one_package_have_one_name():
    faults = doubled({name: tree for name, tree in TREES.items() if name not in PACKAGES})
    assert not faults, faults[0]


def test_the_budgets_are_those_that_contributing_names():
    text = " ".join((ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").split())
    for budget in (
        f"a class has at most {PUBLIC_METHODS} public methods",
        f"a constructor {CONSTRUCTOR_PARAMETERS} parameters",
        f"a function {FUNCTION_LINES} lines",
        f"a file {FILE_LINES} lines",
        f"a folder {FOLDER_ENTRIES} entries",
        f"a docstring of {ROOT_LINES[0]} to {ROOT_LINES[-1]} lines",
    ):
        assert budget in text


def test_package_roots_say_what_lives_there_and_do_nothing():
    roots = {module_name(path): TREES[module_name(path)] for path in SOURCES if path.name == "__init__.py"}
    faults = [fault for package, tree in roots.items() if (fault := root_fault(package, tree))]
    assert not faults, faults[0]
    for package in EXTENSIBLE:
        assert [ast.unparse(statement) for statement in roots[package].body[1:]] == EXTENDED


def test_the_page_about_the_architecture_names_what_there_is():
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    missing = [path for path in re.findall(r"`([\w/]+/[\w./]+)`", page) if not (ROOT / path).exists()]
    assert not missing, f"docs/architecture.md names {missing[0]}, which does not exist"
    methods = {
        (node.name, made.name)
        for tree in TREES.values()
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
        for made in node.body
        if isinstance(made, ast.FunctionDef)
    }
    named = set(re.findall(r"`([A-Z]\w+)\.(\w+)`", page))
    assert named <= methods, f"docs/architecture.md names {sorted(named - methods)[0]}, which does not exist"
    packages = {path.name for path in (ROOT / "protocols").iterdir() if (path / "__init__.py").exists()}
    assert packages == set(re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE))
    inside = (ROOT / "README.md").read_text(encoding="utf-8").partition("## What is inside")[2]
    packages |= {path.name for path in (ROOT / "cosim").iterdir() if (path / "__init__.py").exists()}
    assert packages <= set(re.findall(r"\b(\w+)/", inside))


def test_units_load_no_simulator():
    code = "import sys, cosim.units; print(*sorted({name.split('.')[0] for name in sys.modules}))"
    loaded = set(
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    )
    assert "cosim" in loaded
    assert not loaded & {"simpy", "numpy", "numba", "pyarrow", "pandas", "pydantic"}


def library_function(node: ast.AST) -> str | None:
    """Return what *node* computes with a library whose last bits depend on the machine: elementary functions, BLAS."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult):
        return "@"
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in ("math", "np"):
        name = f"{node.value.id}.{node.attr}"
        return name if node.attr in LIBRARY_FUNCTIONS and name != "math.hypot" else None
    return None


def test_what_decides_anything_takes_its_functions_from_elementary():
    """But for the laws that no run computes (the exact bit errors of Bluetooth)."""
    faults = [
        f"{name}: {found}, whose last bit depends on the machine: take it from cosim.elementary, or write out the sum"
        for name, tree in TREES.items()
        if name.split(".")[0] != "experiments" and layer(name) not in ("report", "web", "export", "picture")
        for node in ast.walk(tree)
        if (found := library_function(node)) and name != "cosim.channels.bluetooth.bits.errors"
    ]
    assert not faults, faults[0]


def test_numpy_generators_are_made_in_randomness_only():
    makers = ("default_rng(", "np.random.Generator(", "np.random.seed(", "RandomState(")
    faults = [
        f"{module_name(path)} makes a generator with {maker})"
        for path in SOURCES
        for maker in makers
        if maker in path.read_text(encoding="utf-8") and module_name(path) != "cosim.randomness"
    ]
    assert not faults, faults[0]


# ---------------------------------------------------------------- the laws bite


@pytest.mark.parametrize(
    ("importer", "imported"),
    [
        ("cosim.units", "cosim.errors"),
        ("cosim.geometry.grids", "cosim.machine"),
        ("cosim.machine", "cosim.protocol"),
        ("cosim.channels.ideal", "cosim.robots.body"),
        ("cosim.robots.body", "cosim.channels.base"),
        ("cosim.kernel", "cosim.world.maps"),
        ("cosim.scenario", "cosim.simulation"),
        ("cosim.sweep", "experiments.messaging_delay"),
        ("cosim.node", "protocols.wire"),
        ("cosim.world.maps", "cosim"),
        ("protocols.pseudonet.spec", "cosim.kernel"),
        ("protocols.pseudonet.spec", "simpy"),
        ("protocols.pseudonet.spec", "random"),
        ("protocols.wire", "pandas"),
        ("cosim.node", "simpy"),
        ("cosim.simulation", "pandas"),
        ("cosim.kernel", "time"),
        ("cosim.randomness", "random"),
    ],
)
def test_a_forbidden_import_is_told_in_one_sentence(importer: str, imported: str):
    fault = import_fault(importer, imported)
    assert fault is not None
    assert importer in fault
    assert "\n" not in fault


@pytest.mark.parametrize(
    ("importer", "imported"),
    [
        ("cosim.simulation", "cosim.scenario"),
        ("cosim.world.sight", "cosim.geometry.segments"),
        ("cosim.world.offices", "cosim.randomness"),
        ("cosim.kernel", "simpy"),
        ("cosim.sweep", "time"),
        ("protocols.pseudonet.spec", "cosim.machine"),
        ("protocols.pseudonet.spec", "cosim.protocol"),
        ("experiments.messaging_delay.measure", "protocols.pseudonet.spec"),
    ],
)
def test_an_import_upwards_is_allowed(importer: str, imported: str):
    assert import_fault(importer, imported) is None


TOLD = '"""' + "A line.\n" * 6 + '"""\n'


@pytest.mark.parametrize(
    ("package", "source"),
    [
        ("cosim", "__version__ = '1.0'"),
        ("cosim", TOLD + "import os"),
        ("cosim", TOLD + "__version__ = version('cosim')"),
        ("protocols", TOLD + "__version__ = '1.0'"),
        ("protocols", TOLD.replace("A line.\n", "A line.\n" * 3)),
        ("cosim.web", TOLD + "from cosim.web.server import serve"),
        ("cosim.web", ""),
        ("protocols.transport", '"""Transport."""'),
        ("protocols.transport", TOLD.replace("A line.\n", "A line.\n" * 3)),
    ],
)
def test_a_root_that_is_silent_or_does_something_is_noticed(package: str, source: str):
    assert f"the root of {package} " in str(root_fault(package, ast.parse(source)))


def test_imports_below_type_checking_count():
    tree = ast.parse("if TYPE_CHECKING:\n    from cosim.kernel import Kernel\ndef f():\n    import simpy\n")
    assert list(imports(tree)) == ["cosim.kernel", "simpy"]


def test_a_cycle_is_found():
    assert cycle({"a": {"b"}, "b": {"c"}, "c": {"b"}}) == ["b", "c"]
    assert cycle({"a": {"b", "c"}, "b": {"c"}}) == []


@pytest.mark.parametrize(
    ("parameters", "told"),
    [
        ("a, b, c, d, e, f, g, h", []),
        ("a, b, c, d, e, f, g, h, i", ["the constructor of C takes 9 parameters, 8 are enough"]),
        ("a, /, b, c, d, e, f, *, g, h, i", ["the constructor of C takes 9 parameters, 8 are enough"]),
        ("a, *b", ["the constructor of C takes any number of parameters"]),
        ("**a", ["the constructor of C takes any number of parameters"]),
    ],
)
def test_a_constructor_that_takes_much_is_noticed(parameters: str, told: list[str]):
    source = f"class C:\n    def __init__(self, {parameters}):\n        x = 1\n"
    assert oversized(ast.parse(source), 3) == told


def test_a_crowded_folder_is_noticed():
    inside = [f"cosim.web.m{number}" for number in range(FOLDER_ENTRIES)]
    assert crowded([*inside, "cosim.web", "cosim.web.m0.inner"]) == []
    assert crowded([*inside, "cosim.web.one_more"]) == ["cosim.web has 26 entries, 25 are enough"]
    assert crowded([name.replace("cosim.web", "cosim") for name in inside] + ["cosim.one_more"]) == []


def test_classes_of_one_name_are_noticed():
    trees = {name: ast.parse("class C: ...\nclass _D: ...") for name in ("p.q.a", "p.q.b", "p.r.a", "p.q")}
    assert doubled(trees) == ["a class C is in each of p.q.a, p.q.b"]


def test_a_long_function_is_noticed():
    source = "class C:\n    def f(self):\n" + "        x = 1\n" * FUNCTION_LINES
    assert oversized(ast.parse(source), 100) == [f"f has {FUNCTION_LINES + 1} lines, {FUNCTION_LINES} are enough"]
    assert oversized(ast.parse("x = 1"), FILE_LINES + 1) == [f"{FILE_LINES + 1} lines, {FILE_LINES} are enough"]
