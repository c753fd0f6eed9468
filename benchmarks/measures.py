"""Measures of the code: how much there is to know, and how it is said.

    python benchmarks/measures.py
    python benchmarks/measures.py --root ../other

Counted are the Python files of ``orchestrator/``: files and lines, functions without docstrings (median and 90 %),
names of types and files that stand for several things, assignments to words that say nothing, and comments per hundred
lines of code. Whether a comment says why, only a reader can tell.
"""

from __future__ import annotations

import argparse
import ast
import io
import statistics
import tokenize
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

VAGUE = ("found", "own", "known", "wanted", "each")
"""Names that are left over from sentences."""


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, default=Path(__file__).parents[1], metavar="FOLDER")
    files = sorted((parser.parse_args().root / "orchestrator").rglob("*.py"))
    texts = [file.read_text(encoding="utf-8") for file in files]
    trees = [ast.parse(text) for text in texts]
    lines = [text.count("\n") for text in texts]
    print(f"files {len(files)}, lines {sum(lines)}, module median {statistics.median(lines):.0f}, largest {max(lines)}")
    lengths = sorted(length for tree in trees for length in function_lengths(tree))
    print(f"functions {len(lengths)}, median {statistics.median(lengths):.0f}, 90 % {lengths[len(lengths) * 9 // 10]}")
    types = Counter(node.name for tree in trees for node in ast.walk(tree) if isinstance(node, ast.ClassDef))
    print("types of one name:", ", ".join(f"{name} {n}" for name, n in sorted(types.items()) if n > 1) or "none")
    names = Counter(file.name for file in files if file.name != "__init__.py")
    repeated = sorted(name for name, number in names.items() if number > 1)
    print(f"file names twice or more: {len(repeated)} ({', '.join(repeated)})")
    assigned = Counter(name for tree in trees for name in assignments(tree) if name in VAGUE)
    print("vague names:", ", ".join(f"{name} {assigned[name]}" for name in VAGUE), f"(sum {assigned.total()})")
    comments = sum(map(comment_lines, texts))
    code = sum(1 for text in texts for line in text.splitlines() if line.strip())
    print(f"comments {comments}, {100 * comments / code:.1f} per hundred lines")


def function_lengths(tree: ast.Module) -> Iterator[int]:
    """Lines of each function, without its docstring."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            first = node.body[0]
            documented = isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant)
            docstring = (first.end_lineno or 0) - first.lineno + 1 if documented else 0
            yield (node.end_lineno or 0) - node.lineno + 1 - docstring


def assignments(tree: ast.Module) -> Iterator[str]:
    """Names that are assigned, loop variables among them."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id


def comment_lines(text: str) -> int:
    """Comments for people, not for tools."""
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    comments = [token.string for token in tokens if token.type == tokenize.COMMENT]
    return sum(not comment.startswith(("# type:", "# noqa", "#!", "# fmt")) for comment in comments)


if __name__ == "__main__":
    main()
