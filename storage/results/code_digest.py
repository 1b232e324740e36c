"""Digests of Python code: of the syntax tree without docstrings, so that comments and layout do not matter.

`c_code_digest` does the same for C.
"""

from __future__ import annotations

import ast
import hashlib
from functools import lru_cache
from pathlib import Path

import z2p_core
from z2p_renderer.storage.results import c_code_digest
from z2p_renderer.storage.results.kept_digests import KeptDigests

INSTALLED_PACKAGE = "z2p_renderer"
SOURCE_ROOT = Path(__file__).parents[2]
"""Folder that holds `pipeline`, `storage` and so on: the checkout, or the installed package `INSTALLED_PACKAGE`."""
CORE_FOLDER = Path(z2p_core.__file__).parent

_kept_digests = KeptDigests(__file__, c_code_digest.__file__)


@lru_cache(maxsize=256)
def cached_part_digest(name: str) -> str:
    """`current_part_digest` as of its first call in this process, so that a plan describes one state of the code."""
    return current_part_digest(name)


def current_part_digest(name: str) -> str:
    """Digest (64 hex digits) of a module of the project, of a ``module:definition``, or of a ``folder/file``.

    For a file that is neither Python nor C it is the sha256 of its bytes.

    Raises:
        FileNotFoundError: no such module or file.
        ValueError: the module has no such definition.
    """
    if "/" in name:
        path = CORE_FOLDER.parent / name
        if path.suffix not in (".c", ".h", ".py"):
            return hashlib.sha256(path.read_bytes()).hexdigest()
        source = path.read_text(encoding="utf-8")
        if path.suffix == ".py":
            return code_digest(source)
        return _kept_digests.get("C", source, lambda: c_code_digest.c_digest(source))
    module, _, definition = name.partition(":")
    return code_digest(module_file(module).read_text(encoding="utf-8"), definition)


def module_file(module: str, root: Path = SOURCE_ROOT) -> Path:
    """File of a module or package of z2p, or of another package below the folder `root`; it need not exist.

    Modules of z2p may be named with or without `INSTALLED_PACKAGE` in front.
    """
    package, _, below = module.partition(".")
    own = {INSTALLED_PACKAGE: (SOURCE_ROOT, below), CORE_FOLDER.name: (CORE_FOLDER, below)}
    home, below = own.get(package, (root, module))
    path = home / below.replace(".", "/")
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


def code_digest(source: str, definition: str = "") -> str:
    """sha256 (64 hex digits) of Python source, or of one top-level function, class or constant in it.

    Raises:
        SyntaxError: the source is not Python.
        ValueError: there is no such definition.
    """
    return _kept_digests.get(f"Python {definition}", source, lambda: _compute_digest(source, definition))


def _compute_digest(source: str, definition: str) -> str:
    tree = ast.parse(source)
    if definition:
        tree.body = [statement for statement in tree.body if definition in defined_names(statement)]
        if not tree.body:
            raise ValueError(f"expected a definition {definition!r} at the top level of the source, found none")
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            node.body = [statement for statement in node.body if not _is_docstring(statement)]
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest()


def defined_names(statement: ast.stmt) -> set[str]:
    """Names that a top-level statement defines."""
    if isinstance(statement, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
        return {statement.name}
    targets = statement.targets if isinstance(statement, ast.Assign) else [getattr(statement, "target", None)]
    return {target.id for target in targets if isinstance(target, ast.Name)}


def list_imports(tree: ast.AST, module: str = "") -> set[tuple[str, str]]:
    """(module, name) for every import in a tree, those inside functions included; no name for ``import module``.

    With `module`, the full name of the tree's own module, relative imports are returned with their full names.
    """
    found: set[tuple[str, str]] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {(alias.name, "") for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            above = module.split(".")[: -node.level] if node.level else []
            found |= {(".".join([*above, *filter(None, [node.module])]), alias.name) for alias in node.names}
    return found


@lru_cache(maxsize=256)
def imported_modules(source: str, module: str) -> frozenset[str]:
    """Full names of all modules that a module's source may import (``from a import b``: both a and a.b).

    Raises:
        SyntaxError: the source is not Python.
    """
    found = list_imports(ast.parse(source), module)
    return frozenset({origin for origin, _ in found} | {f"{origin}.{name}" for origin, name in found if name})


def _is_docstring(statement: ast.stmt) -> bool:
    """Whether a statement is a bare string: a docstring, or a description under an attribute."""
    return (
        isinstance(statement, ast.Expr)
        and isinstance(statement.value, ast.Constant)
        and isinstance(statement.value.value, str)
    )
