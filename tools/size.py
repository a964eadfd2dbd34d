"""Code lines, tokens and numeric constants of the package by room; compiled sources counted too.

Lines and tokens exclude blanks, comments and docstrings; a constant is a module-level name assigned a number.

`make size` prints a Markdown table, and exits with 1 where the package exceeds its limits, which fall with every part
that is removed, and rise only with a capability. Tokens are limited too, so that packing lines gains nothing.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parent.parent / "rwa_monitor"
MOST_FILES, MOST_LINES, MOST_TOKENS, MOST_CONSTANTS = 188, 28_409, 315_373, 786
LAYOUT = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
}
DOCUMENTED = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


def is_number(value: ast.expr | None) -> bool:
    """Return whether an expression is a number, an operation on one, or a tuple or list of such expressions."""
    match value:
        case ast.Constant(value=bool()):
            return False
        case ast.Constant(value=int() | float()):
            return True
        case ast.UnaryOp(operand=operand):
            return is_number(operand)
        case ast.BinOp(left=left, right=right):
            return is_number(left) or is_number(right)
        case ast.Tuple(elts=parts) | ast.List(elts=parts):
            return bool(parts) and all(map(is_number, parts))
    return False


def of_python(text: str) -> tuple[int, int, int]:
    """Return code lines, tokens and constants of a module."""
    tree = ast.parse(text)
    constants = sum(isinstance(node, ast.Assign | ast.AnnAssign) and is_number(node.value) for node in tree.body)
    documented = [node for node in ast.walk(tree) if isinstance(node, DOCUMENTED)]
    docstrings = [node.body[0] for node in documented if ast.get_docstring(node, clean=False) is not None]
    left_out = {line for one in docstrings for line in range(one.lineno, (one.end_lineno or one.lineno) + 1)}
    lines: set[int] = set()
    tokens = 0
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        at = set(range(token.start[0], token.end[0] + 1)) - left_out
        if token.type not in LAYOUT and at:
            lines |= at
            tokens += 1
    return len(lines), tokens, constants


def of_cpp(text: str) -> tuple[int, int, int]:
    """Return code lines, tokens and constants of a compiled source."""
    text = re.sub(r"//[^\n]*", "", re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL))
    lines, tokens = sum(bool(line.strip()) for line in text.splitlines()), len(re.findall(r"\w+|[^\w\s]", text))
    return lines, tokens, len(re.findall(r"^\s*constexpr [\w:]+ [A-Z_]+ = ", text, re.MULTILINE))


def main() -> int:
    """Print the table; return 1 where a limit is passed."""
    rooms: dict[str, list[int]] = defaultdict(lambda: [0, 0, 0, 0])
    for path in sorted(ROOT.rglob("*")):
        count = {".py": of_python, ".cpp": of_cpp, ".hpp": of_cpp, ".h": of_cpp}.get(path.suffix)
        if count is None:
            continue
        parts = path.relative_to(ROOT).parts
        counted = count(path.read_text(encoding="utf-8"))
        for room in (parts[0] if len(parts) > 1 else "(top)", "sum"):
            rooms[room] = [a + b for a, b in zip(rooms[room], (1, *counted), strict=True)]
    print("| room | files | code lines | tokens | constants |\n|---|---|---|---|---|")
    for room, counts in sorted(rooms.items(), key=lambda item: (item[0] == "sum", item[0])):
        print(f"| {room} | " + " | ".join(f"{count:,}" for count in counts) + " |")
    most = MOST_FILES, MOST_LINES, MOST_TOKENS, MOST_CONSTANTS
    if any(found > limit for found, limit in zip(rooms["sum"], most, strict=True)):
        limits = "{:,} files, {:,} lines, {:,} tokens, {:,} constants".format(*most)
        print(f"the package has grown beyond {limits}: take something away", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
