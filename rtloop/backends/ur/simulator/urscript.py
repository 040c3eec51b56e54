"""A small URScript interpreter. It supports the parts of the language that external-control programs use.

It supports blocks (def, thread, sec, if, elif, else, while, end), assignments (also global and local),
return, break, continue, halt, run, join, kill, critical sections, arithmetic, comparisons, lists, poses as
lists, and calls with named arguments. Anything else, for example for loops and structs, raises an error that
names the line.
"""

from __future__ import annotations

import ast
import operator
import re
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass, field
from inspect import isgeneratorfunction
from typing import Any

MAX_STEPS = 20_000
"""Maximum number of statements that a thread executes within one control period. A thread that exceeds it
must be in an endless loop without a wait.
"""
MAX_DEPTH = 50
Run = Generator[None, None, Any]
_BLOCKS = re.compile(r"^(def|thread|sec|if|while)\b")
_DEF = re.compile(r"^(def|thread|sec)\s+([A-Za-z_]\w*)\s*\(")


class ScriptError(Exception):
    """An error in a program; its text names the line."""


def is_complete(text: str) -> bool:
    """Whether all blocks in a text are closed."""
    depth = 0
    for line in text.splitlines():
        word = _bare(line)
        if _BLOCKS.match(word):
            depth += 1
        elif word == "end":
            depth -= 1
    return depth <= 0


def _bare(line: str) -> str:
    quoted, found = False, []
    for character in line:
        if character == '"':
            quoted = not quoted
        if character == "#" and not quoted:
            break
        found.append(character)
    return "".join(found).strip()


def _python(text: str) -> str:
    """Translate the blocks and statements line by line to text for Python's parser. The text is never run as
    Python.
    """
    lines, depth = [], 0
    for number, line in enumerate(text.splitlines(), 1):
        word = _bare(line)
        if word == "end":
            lines.append("    " * depth + "pass")
            depth -= 1
            if depth < 0:
                raise ScriptError(f"line {number}: end without a block")
            continue
        if word.startswith(("elif ", "elif(", "else")):
            lines.append("    " * (depth - 1) + word)
            continue
        lines.append("    " * depth + _statement(word) if word else "")
        if _BLOCKS.match(word):
            depth += 1
    if depth:
        raise ScriptError("the end of a block is missing")
    return "\n".join(lines) + "\n"


def _statement(word: str) -> str:
    if word in ("enter_critical", "exit_critical"):
        return "pass"
    if word == "halt":
        return "_halt()"
    word = re.sub(r"^(thread|sec)\b", "def", word)
    word = re.sub(r"^(join|kill)\s+(\w+)$", r"_\1(\2)", word)
    word = re.sub(r"\brun\s+(\w+)\s*\(\s*\)", r'_run("\1")', word)
    word = re.sub(r"^(global|local)\s+(\w+)\s*=(?!=)", r"\2: \1_ =", word)
    return re.sub(r"\bp\[", "[", word)


_OPERATORS: dict[type[ast.AST], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Mod: operator.mod,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}


class _Return(Exception):
    def __init__(self, value: Any) -> None:
        super().__init__()
        self.value = value


class _Break(Exception):
    pass


class _Continue(Exception):
    pass


class _Halt(Exception):
    pass


@dataclass(slots=True)
class Thread:
    """A running thread of a program."""

    run: Run
    steps: int = 0
    is_done: bool = False


@dataclass(slots=True)
class _Frame:
    local: dict[str, Any] = field(default_factory=dict)
    depth: int = 0


class Script:
    """A program, which is stepped once per control period.

    Attributes:
        name: program name.
        is_secondary: whether it runs in addition to the main program.
        line: number of the line that is running or has failed.
    """

    def __init__(self, text: str, functions: Mapping[str, Callable[..., Any]]) -> None:
        """
        Args:
            functions: the functions of the language by name. Functions that take time are generators.

        Raises:
            ScriptError: the text is not a valid program.
        """
        first = next((word for word in map(_bare, text.splitlines()) if word), "")
        found = _DEF.match(first)
        self.is_secondary = found is not None and found.group(1) == "sec"
        self.name = found.group(2) if found else "script"
        try:
            tree = ast.parse(_python(text))
        except SyntaxError as exc:
            raise ScriptError(f"line {exc.lineno}: syntax error: {exc.msg}") from exc
        except (RecursionError, MemoryError, ValueError) as exc:
            raise ScriptError(f"the program cannot be read: {exc}") from exc
        self.line = 1
        self._globals: dict[str, Any] = {}
        self._functions: Mapping[str, Callable[..., Any]] = {
            **functions,
            "_run": self._start,
            "_join": self._join,
            "_kill": self._kill,
            "_halt": self._halt,
        }
        self._generators = {name for name, call in self._functions.items() if isgeneratorfunction(call)}
        self._defs: dict[str, ast.FunctionDef] = {}
        self._check(tree)
        self._waiting: dict[ast.AST, bool] = {}
        body = tree.body
        if found and len(body) == 1 and isinstance(body[0], ast.FunctionDef):
            body = body[0].body
        self._current: Thread | None = None
        self._threads = [Thread(self._guard(self._block(body, _Frame())))]

    def _check(self, tree: ast.AST) -> None:
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef):
                self._defs[node.name] = node
        for node in ast.walk(tree):
            if not isinstance(node, _KNOWN):
                line = getattr(node, "lineno", self.line)
                raise ScriptError(f"line {line}: this interpreter does not support {type(node).__name__}")
            if isinstance(node, ast.Call):
                name = node.func.id if isinstance(node.func, ast.Name) else "?"
                if name not in self._functions and name not in self._defs:
                    raise ScriptError(f"line {node.lineno}: name '{name}' is not defined")

    def step(self) -> bool:
        """Run all threads until each waits. Returns whether the program continues.

        Raises:
            ScriptError: a statement has failed.
        """
        for thread in self._threads:  # the list grows when threads are started
            self._current = thread
            thread.steps = 0
            try:
                next(thread.run)
            except StopIteration:
                thread.is_done = True
            except _Halt:
                return False
        main = self._threads[0]
        self._threads = [each for each in self._threads if each is main or not each.is_done]
        return not main.is_done

    # Statements. Those that cannot wait are evaluated directly, the others as generators.

    def _guard(self, block: Run) -> Run:
        try:
            yield from block
        except _Return:
            pass
        except (_Break, _Continue) as exc:
            raise ScriptError(f"line {self.line}: break or continue outside of a loop") from exc
        except (TypeError, ValueError, IndexError, ZeroDivisionError, OverflowError, KeyError) as exc:
            raise ScriptError(f"line {self.line}: {exc}") from exc

    def _block(self, body: list[ast.stmt], frame: _Frame) -> Run:
        for statement in body:
            self.line = statement.lineno
            self._count()
            yield from self._do(statement, frame)

    def _count(self) -> None:
        thread = self._current
        if thread is not None:
            thread.steps += 1
            if thread.steps > MAX_STEPS:
                raise ScriptError(f"line {self.line}: a loop does not end, because nothing in it waits")

    def _do(self, node: ast.stmt, frame: _Frame) -> Run:
        if isinstance(node, ast.FunctionDef | ast.Pass):
            return
        if isinstance(node, ast.Assign | ast.AnnAssign):
            value = yield from self._value(node.value, frame)
            self._assign(node, value, frame)
        elif isinstance(node, ast.Expr):
            yield from self._value(node.value, frame)
        elif isinstance(node, ast.If):
            chosen = yield from self._value(node.test, frame)
            yield from self._block(node.body if chosen else node.orelse, frame)
        elif isinstance(node, ast.While):
            yield from self._loop(node, frame)
        elif isinstance(node, ast.Return):
            raise _Return((yield from self._value(node.value, frame)) if node.value else None)
        elif isinstance(node, ast.Break):
            raise _Break
        else:
            raise _Continue

    def _loop(self, node: ast.While, frame: _Frame) -> Run:
        while (yield from self._value(node.test, frame)):
            self._count()
            try:
                yield from self._block(node.body, frame)
            except _Break:
                return
            except _Continue:
                continue

    def _assign(self, node: ast.Assign | ast.AnnAssign, value: Any, frame: _Frame) -> None:
        target = node.targets[0] if isinstance(node, ast.Assign) else node.target
        if isinstance(target, ast.Subscript):
            self._direct(target.value, frame)[self._direct(target.slice, frame)] = value
        elif isinstance(target, ast.Name):
            is_global = isinstance(node, ast.AnnAssign) and getattr(node.annotation, "id", "") == "global_"
            known = target.id in self._globals and target.id not in frame.local
            is_local = isinstance(node, ast.AnnAssign) and not is_global
            place = self._globals if is_global or (known and not is_local) else frame.local
            place[target.id] = list(value) if isinstance(value, list) else value

    # Expressions

    def _value(self, node: ast.expr | None, frame: _Frame) -> Run:
        if node is None or not self._waits(node):
            return self._direct(node, frame)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            arguments = yield from self._values(node.args, frame)
            named = {}
            for keyword in node.keywords:
                named[str(keyword.arg)] = yield from self._value(keyword.value, frame)
            return (yield from self._call(node.func.id, arguments, named, frame))
        if isinstance(node, ast.Compare):
            left = yield from self._value(node.left, frame)
            right = yield from self._value(node.comparators[0], frame)
            return _OPERATORS[type(node.ops[0])](left, right)
        if isinstance(node, ast.BinOp):
            left = yield from self._value(node.left, frame)
            right = yield from self._value(node.right, frame)
            return _OPERATORS[type(node.op)](left, right)
        if isinstance(node, ast.UnaryOp):
            value = yield from self._value(node.operand, frame)
            return not value if isinstance(node.op, ast.Not) else -value
        if isinstance(node, ast.List):
            return (yield from self._values(node.elts, frame))
        raise ScriptError(f"line {self.line}: a function that waits cannot be called inside this expression")

    def _values(self, nodes: list[ast.expr], frame: _Frame) -> Run:
        values = [None] * len(nodes)
        for index, node in enumerate(nodes):
            values[index] = yield from self._value(node, frame)
        return values

    def _waits(self, node: ast.expr) -> bool:
        known = self._waiting.get(node)
        if known is None:
            names = [
                each.func.id
                for each in ast.walk(node)
                if isinstance(each, ast.Call) and isinstance(each.func, ast.Name)
            ]
            known = any(name in self._defs or name in self._generators for name in names)
            self._waiting[node] = known
        return known

    def _call(self, name: str, arguments: list[Any], named: dict[str, Any], frame: _Frame) -> Run:
        made = self._defs.get(name)
        if made is None:
            found = self._functions[name](*arguments, **named)
            return (yield from found) if name in self._generators else found
        if frame.depth > MAX_DEPTH:
            raise ScriptError(f"line {self.line}: function calls are nested too deeply")
        parameters = [each.arg for each in made.args.args]
        if len(arguments) + len(named) != len(parameters):
            raise ScriptError(f"line {self.line}: {name} takes {len(parameters)} arguments")
        inner = _Frame(dict(zip(parameters, arguments, strict=False)) | named, frame.depth + 1)
        try:
            yield from self._block(made.body, inner)
        except _Return as exc:
            return exc.value
        return None

    def _direct(self, node: ast.AST | None, frame: _Frame) -> Any:
        if node is None:
            return None
        if isinstance(node, ast.Constant):
            return node.value
        if isinstance(node, ast.Name):
            if node.id in frame.local:
                return frame.local[node.id]
            if node.id in self._globals:
                return self._globals[node.id]
            raise ScriptError(f"line {self.line}: name '{node.id}' is not defined")
        if isinstance(node, ast.Subscript):
            return self._direct(node.value, frame)[self._direct(node.slice, frame)]
        if isinstance(node, ast.BinOp):
            return _OPERATORS[type(node.op)](self._direct(node.left, frame), self._direct(node.right, frame))
        if isinstance(node, ast.Compare):
            return _OPERATORS[type(node.ops[0])](
                self._direct(node.left, frame), self._direct(node.comparators[0], frame)
            )
        if isinstance(node, ast.BoolOp):
            wanted = isinstance(node.op, ast.Or)
            return (
                wanted
                if any(bool(self._direct(each, frame)) is wanted for each in node.values)
                else not wanted
            )
        if isinstance(node, ast.UnaryOp):
            value = self._direct(node.operand, frame)
            return not value if isinstance(node.op, ast.Not) else -value
        if isinstance(node, ast.List):
            return [self._direct(each, frame) for each in node.elts]
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            named = {str(each.arg): self._direct(each.value, frame) for each in node.keywords}
            arguments = [self._direct(each, frame) for each in node.args]
            return self._functions[node.func.id](*arguments, **named)
        raise ScriptError(f"line {self.line}: this interpreter does not support {type(node).__name__}")

    # Threads

    def _start(self, name: str) -> Thread:
        made = self._defs.get(name)
        if made is None:
            raise ScriptError(f"line {self.line}: there is no thread {name}")
        thread = Thread(self._guard(self._block(made.body, _Frame(depth=1))))
        self._threads.append(thread)
        return thread

    def _join(self, thread: Any) -> Run:
        while isinstance(thread, Thread) and not thread.is_done:
            yield

    def _kill(self, thread: Any) -> None:
        if isinstance(thread, Thread):
            thread.run.close()
            thread.is_done = True

    def _halt(self) -> None:
        raise _Halt


_KNOWN = (
    ast.Module, ast.FunctionDef, ast.arguments, ast.arg, ast.Pass, ast.Assign, ast.AnnAssign, ast.Expr,
    ast.If, ast.While, ast.Return, ast.Break, ast.Continue, ast.Constant, ast.Name, ast.Load, ast.Store,
    ast.Subscript, ast.BinOp, ast.Compare, ast.BoolOp, ast.UnaryOp, ast.List, ast.Call, ast.keyword,
    ast.And, ast.Or, ast.Not, ast.USub, *_OPERATORS,
)  # fmt: skip
