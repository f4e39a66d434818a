"""The walls of the house: sub-packages in order, no circles, nobody's private names."""

import ast
from functools import cache
from pathlib import Path

import networkx as nx
import pytest
from sources import nodes, tree

ROOT = Path(__file__).resolve().parent.parent
# each imports those before it only; files directly in a package come first
ORDER = {
    "roadmap": [
        "compiling",
        "builds",
        "kinematics",
        "robot",
        "geometry",
        "loading",
        "graph",
        "motion",
    ],
    "odm": [
        "obstacles",
        "close_test",
        "cell_map",
        "search",
        "frame",
        "approach",
        "planner",
        "execution",
        "cameras",
        "exact",
        "audit",
    ],
    "handover": ["human", "reach", "meet", "targets", "grasps", "scenes", "plans"],
    "sim": [
        "terminal",
        "tables",
        "people",
        "loop",
        "record",
        "draw",
        "view",
        "run",
        "story",
        "maintenance",
        "two",
        "keyboard",
        "cli",
        "bench",
    ],
}
PACKAGES = list(ORDER)
MOST_FILES = 18  # in a folder
LONGEST, LONG, MOST_LONG = 90, 60, 8  # lines of a function; how many are long
WIDE, MOST_WIDE = 7, 30  # parameters of a kernel; how many have more
# what kernels import; numba compiles heapq and math
FENCE = {"__future__", "heapq", "math", "numba", "numpy", "typing"}


def modules():
    """Return every module's name and file."""
    files = (f for p in PACKAGES for f in (ROOT / p).rglob("*.py"))
    names = {f: ".".join(f.relative_to(ROOT).with_suffix("").parts) for f in files}
    return {name.removesuffix(".__init__"): file for file, name in names.items()}


MODULES = modules()
INSIDE = {
    n: f for n, f in MODULES.items() if f.name not in ("__init__.py", "__main__.py")
}


@cache
def imported(file):
    """Return the modules of ours that a file imports, anywhere and for types, too."""
    found = set()
    for node in nodes(file):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                found.add(inner if inner in MODULES else node.module)
    return found & set(MODULES)


def place(name):
    """Return package and sub-package of a module; "" for files beside the door."""
    package, _, rest = name.partition(".")
    return package, rest.partition(".")[0] if "." in rest else ""


@cache
def functions():
    """Return (file, function, its tree) of every function."""
    kinds = ast.FunctionDef | ast.AsyncFunctionDef
    return [
        (file, node.name, node)
        for file in MODULES.values()
        for node in nodes(file)
        if isinstance(node, kinds)
    ]


@cache
def kernels():
    """Return the functions that numba compiles."""
    return [
        (file, name, node)
        for file, name, node in functions()
        if any("njit" in ast.unparse(d) for d in node.decorator_list)
    ]


@pytest.mark.parametrize("package", PACKAGES)
def test_every_sub_package_has_its_place_in_the_order(package):
    folders = {f.parent for f in (ROOT / package).rglob("*.py")} - {ROOT / package}
    there = {f.relative_to(ROOT / package).parts[0] for f in folders}
    assert there == set(ORDER[package])


@pytest.mark.parametrize("package", PACKAGES)
def test_sub_packages_import_those_before_them_only(package):
    order = ["", *ORDER[package]]
    wrong = []
    for name, file in INSIDE.items():
        ours, mine = place(name)
        for other in imported(file):
            theirs, its = place(other)
            if ours == theirs == package and order.index(its) > order.index(mine):
                wrong.append(f"{name} imports {other}")
    assert not wrong


def test_exact_geometry_shares_nothing_with_the_frame_that_it_judges():
    ours = {n: imported(f) for n, f in INSIDE.items() if place(n) == ("odm", "exact")}
    theirs = {o for found in ours.values() for o in found if o.startswith("odm.")}
    solids = {f"odm.obstacles.{n}" for n in ("shapes", "mesh_surface", "robot_surface")}
    assert theirs - ours.keys() <= solids
    kernels = {o for n in ours if "._" in n for o in imported(INSIDE[n])}
    assert kernels <= {"roadmap.compiling._rows", "roadmap.compiling.jit_options"}


def test_no_file_is_part_of_a_circle():
    graph = nx.DiGraph()
    for name, file in INSIDE.items():
        graph.add_edges_from((name, other) for other in imported(file))
    circles = [c for c in nx.strongly_connected_components(graph) if len(c) > 1]
    assert not circles


def test_compiled_loops_import_numpy_numba_and_compiled_loops_only():
    wrong = []
    for file in {file for file, _, _ in kernels()}:
        assert file.name.startswith("_"), f"{file} has a kernel; call it _{file.name}"
        for node in tree(file).body:
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                names = [
                    m if (m := f"{node.module}.{a.name}") in MODULES else node.module
                    for a in node.names
                ]
            else:
                continue
            wrong += [
                f"{file.relative_to(ROOT)}: {name}"
                for name in names
                if name.partition(".")[0] not in FENCE
                and not name.rpartition(".")[2].startswith("_")
                and name != "roadmap.compiling.jit_options"
            ]
    assert not wrong


def private(name):
    """Return whether a name is private; those of Python itself are not."""
    return name.startswith("_") and not name.startswith("__")


def reaches(inside):
    """Return where a module's nodes name what is private to another object or file.

    Its own are `self._x`, `cls._x` and `super()._x`. A name as text counts where it is
    handed to `getattr` and its like; an underscore file is no private name.
    """
    own = ("self", "cls", "super()")
    by_text = {"getattr", "setattr", "hasattr", "delattr", "__setattr__"}
    for node in inside:
        if isinstance(node, ast.Attribute) and private(node.attr):
            owner, name = ast.unparse(node.value), node.attr
        elif isinstance(node, ast.Call) and len(node.args) > 1:
            called = ast.unparse(node.func).rpartition(".")[2]
            text = getattr(node.args[1], "value", None)
            if called not in by_text or not isinstance(text, str) or not private(text):
                continue
            owner, name = ast.unparse(node.args[0]), text
        elif isinstance(node, ast.ImportFrom):
            for alias in node.names:
                name = f"{node.module}.{alias.name}"
                if private(alias.name) and name not in MODULES:
                    yield name
            continue
        else:
            continue
        if owner not in own:
            yield f"{owner}.{name}"


def test_nobody_reaches_for_private_names_of_another_object():
    public = {"_replace", "_asdict", "_fields", "_field_defaults"}  # of named tuples
    public |= {"_getvalue"}  # of numba's own builders, which have no other name for it
    # and of its libraries of code, which `roadmap/compiling/linking.py` links
    public |= {"_get_module_for_linking", "_module_pass_manager", "_reload_init"}
    public |= {"_engine", "_ee"}
    public |= {"_exit", "_current_frames"}  # of os and sys
    wrong = [
        f"{file.relative_to(ROOT)}: {name}"
        for file in MODULES.values()
        for name in reaches(nodes(file))
        if name.rpartition(".")[2] not in public
    ]
    assert not wrong


@pytest.mark.parametrize(
    "code",
    [
        "planner._x = 1",
        "self.planner._x",
        "def same(self, other): return self._y == other._y",
        "getattr(planner, '_x')",
        "object.__setattr__(loaded, '_x', 1)",
        "type(self)._x",
        "from odm.planner.planner import _x",
    ],
)
def test_a_reach_for_a_private_name_is_found(code):
    assert len(list(reaches(ast.walk(ast.parse(code))))) == 1


def test_no_folder_holds_too_many_files():
    folders = {f.parent for f in MODULES.values()}
    many = {str(d.relative_to(ROOT)): len(list(d.glob("*.py"))) for d in folders}
    full = {d: n for d, n in many.items() if n > MOST_FILES}
    assert not full, f"over {MOST_FILES} files: put yours beside what it is about"


def test_functions_are_short():
    lines = {
        f"{file.relative_to(ROOT)}:{name}": node.end_lineno - node.lineno + 1
        for file, name, node in functions()
    }
    assert not {name: n for name, n in lines.items() if n > LONGEST}
    assert len([n for n in lines.values() if n > LONG]) <= MOST_LONG


def test_kernels_take_few_parameters():
    wide = [f"{f}:{n}" for f, n, node in kernels() if len(node.args.args) > WIDE]
    assert len(wide) <= MOST_WIDE
