"""Imports go down the house: no room knows one above it, or beside it."""

import ast
import re
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import build_fmus
from orchestrator.cli import main

ROOT = Path(build_fmus.__file__).parent

PACKAGE = "__init__"
"""The package itself, which lists the public names."""

COMMANDS = ("__main__", *main.COMMANDS)
"""Modules that are run with ``python -m``."""

FLOORS = (
    ("plant_fmu", "controller_fmu", "build_fmus"),
    ("errors", "bounded", "text", "exact_time", "entry", "cache", "codec", "jit", "version"),
    ("fmi", "views", "recheck"),
    ("loop",),
    ("benchmark", "conformance"),
    ("execution", "search"),
    ("documents",),
    ("pairing",),
    ("study",),
    ("api",),
    ("service",),
    ("cli", "gym"),
    (PACKAGE, *COMMANDS),
)
"""Rooms of the house, bottom up; those without a package of their own belong to ``orchestrator``."""

GROUND = FLOORS[1]
FLOOR = {room: number for number, rooms in enumerate(FLOORS) for room in rooms}

EXCEPTIONS = {
    ("build_fmus", "controller_fmu"): "the command that builds is the builders' only client beside the api",
    ("build_fmus", "plant_fmu"): "the native plant's description and header follow from the plant's tables",
}


def modules() -> Iterator[tuple[str, Path]]:
    """Names and files of all modules."""
    packages = (file for top in ("plant_fmu", "controller_fmu", "orchestrator") for file in (ROOT / top).rglob("*.py"))
    for file in (ROOT / "build_fmus.py", *packages):
        yield ".".join(file.relative_to(ROOT).with_suffix("").parts), file


def imported(module: str, source: str) -> Iterator[str]:
    """Absolute names of what a module imports anywhere in it, in functions and for type checkers as well."""
    package = module.split(".")[:-1]
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            start = ".".join([*base, *([node.module] if node.module else [])])
            yield from (f"{start}.{alias.name}" for alias in node.names)


def room(name: str) -> str | None:
    """The room of a module, None for other packages: ``orchestrator.fmi.slaves.base`` is in ``fmi``."""
    top, *rest = name.split(".")
    if top == "orchestrator":
        return rest[0] if rest and rest[0] in FLOOR else PACKAGE
    return top if top in FLOOR else None


def arrows() -> dict[tuple[str, str], list[str]]:
    """Imports from one room to another, with the modules that make them."""
    found: dict[tuple[str, str], list[str]] = {}
    for module, file in modules():
        for name in imported(module, file.read_text(encoding="utf-8")):
            here, there = room(module), room(name)
            if here is not None and there is not None and here != there:
                found.setdefault((here, there), []).append(f"{module} -> {name}")
    return found


ARROWS = arrows()


def allowed(here: str, there: str) -> bool:
    """Whether a room may import another one."""
    if here in GROUND and there in GROUND:
        return True
    return FLOOR[there] < FLOOR[here] or (here, there) in EXCEPTIONS


def test_no_arrow_goes_up_or_sideways():
    wrong = {arrow: lines for arrow, lines in ARROWS.items() if not allowed(*arrow)}
    assert not wrong


def test_no_circle_of_modules():
    """Not even within a room, in functions or for type checkers."""
    files = {module.removesuffix(".__init__"): file for module, file in modules()}
    graph = {
        module: {
            there
            for name in imported(module if file.stem != "__init__" else f"{module}.__init__", file.read_text("utf-8"))
            if (there := name if name in files else name.rpartition(".")[0]) in files and there != module
        }
        for module, file in files.items()
    }
    assert sum(map(len, graph.values())) > 600, "there is a graph to look at"
    TopologicalSorter(graph).prepare()  # raises CycleError, which names the modules


def test_imports_inside_functions_say_why():
    """They are there for the sake of the start, or for an optional package; beside them, or for the whole module."""
    for module, file in modules():
        lines = file.read_text(encoding="utf-8").splitlines()
        if any(line.startswith("# Imports inside functions: ") for line in lines):
            continue
        for function in ast.walk(ast.parse("\n".join(lines))):
            if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
                for node in ast.walk(function):
                    if isinstance(node, ast.Import | ast.ImportFrom):
                        near = lines[max(node.lineno - 2, 0) : node.lineno]
                        assert any("#" in line for line in near), f"{module}:{node.lineno}"


def test_every_module_is_in_a_room():
    entries = (ROOT / "orchestrator").iterdir()
    rooms = {entry.stem for entry in entries if entry.suffix == ".py" or (entry / "__init__.py").is_file()}
    assert rooms <= set(FLOOR)
    assert len(ARROWS) > 30, "there is a graph to look at"


def test_exceptions_are_still_needed():
    assert set(ARROWS) >= set(EXCEPTIONS)


def test_options_stand_in_the_commands_alone():
    """No string of another room, docstrings included, names a command-line option."""
    for module, file in modules():
        if not module.startswith("orchestrator.") or room(module) == "cli" or module in WITH_OPTIONS:
            continue
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                assert not OPTION.search(node.value), (module, node.value)
    for module in WITH_OPTIONS:
        assert OPTION.search((ROOT / module.replace(".", "/")).with_suffix(".py").read_text(encoding="utf-8")), module


OPTION = re.compile(r"(^|[\s`'\"(])--[a-z]")
WITH_OPTIONS = {
    "orchestrator.documents.commands": "the command that repeats a case, held against the parser in test_cli.py",
    "orchestrator.execution.sandbox": "the words of bubblewrap's own command",
    "orchestrator.recheck.__main__": "a command of its own, which imports nothing of the others",
    "orchestrator.fmi.compilation": "the words of bubblewrap's own command",
    "orchestrator.fmi.host.wine": "the words of Wine's own command",
}
