"""The commands that the documentation states, held against the programs that they call.

A block of shell commands is expanded by bash, which finds no program and so prints what it would
have called. Each call is then given to the parser of its program; nothing is carried out.
"""

import ast
import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import typer

from locate.commands.app import app

ROOT = Path(__file__).parents[1]
BLOCK = re.compile(r"^(<!-- run -->\n)?( *)```(\w+)\n(.*?)^\2```", re.M | re.S)
INLINE = re.compile(r"(?<!`)`((?:locate|make|python -m|pytest) [^`\n]+)`(?!`)")
FOREIGN = {"apt-get", "cd", "colcon", "dask", "docker", "git", "ros2", "source"}
"""Programs and words of the shell that are not ours to check."""
RECORD = """
PATH=/nowhere
seq() { /usr/bin/seq "$@"; }
record() { builtin printf '%s\\0' "$@"; builtin printf '\\n\\0'; }
command_not_found_handle() { record "$@"; }
source() { record source "$@"; }
cd() { record cd "$@"; }
"""
PARSE = """
import argparse, json, runpy, sys
class Parsed(BaseException): pass
parse = argparse.ArgumentParser.parse_args
def parse_only(*args, **kwargs):
    parse(*args, **kwargs)
    raise Parsed
argparse.ArgumentParser.parse_args = parse_only
for module, *arguments in json.load(sys.stdin):
    sys.argv = [module, *arguments]
    try:
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    except Parsed:
        continue
    except SystemExit as stop:
        print(f"python -m {module} {' '.join(arguments)}: exit code {stop.code}")
    else:
        print(f"python -m {module}: has no parser")
"""
"""Prints what goes wrong when each module's argparse reads its arguments, and runs none of them."""


@dataclass(frozen=True)
class Block:
    """A block of code on a page.

    Attributes:
        text: Its lines, without their indentation; of a console the commands alone.
        language: `sh` also for `bash` and `console`.
        run: Whether it is marked `<!-- run -->`.
    """

    text: str
    language: str
    run: bool


def blocks(page: Path, language: str) -> Iterator[Block]:
    """The blocks of one language, `sh` or `python`."""
    for mark, indent, named, text in BLOCK.findall(page.read_text(encoding="utf-8")):
        lines = [line.removeprefix(indent) for line in text.splitlines()]
        if named == "console":
            lines = [line.removeprefix("$ ") for line in lines if line.startswith("$ ")]
        if language == {"bash": "sh", "console": "sh"}.get(named, named):
            yield Block("\n".join(lines), language, bool(mark))


def unknown_imports(program: str) -> list[str]:
    """The imports of a Python program that lead nowhere; a SyntaxError if it is none."""
    wrong = []
    for node in ast.walk(ast.parse(program)):
        if isinstance(node, ast.Import):
            wrong += [alias.name for alias in node.names if not find_spec(alias.name)]
        elif isinstance(node, ast.ImportFrom) and node.module:
            module = import_module(node.module)
            wrong += [f"{node.module}.{a.name}" for a in node.names if not hasattr(module, a.name)]
    return wrong


def calls(block: str, folder: Path) -> list[list[str]]:
    """The programs that a block calls, each with its arguments, as bash expands them."""
    done = subprocess.run(
        ["/bin/bash", "-euc", RECORD + block.replace(".venv/bin/", "")],
        cwd=folder,
        env={"ROS_DISTRO": "jazzy"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"{block}\n{done.stderr}"
    found: list[list[str]] = [[]]
    for word in done.stdout.split("\0"):
        if word == "\n":
            found.append([])
        elif word:
            found[-1].append(word)
    return [call for call in found if call]


def complaints(call: list[str], modules: list[list[str]]) -> list[str]:
    """What is wrong with a call; those of modules with a parser are left in `modules`."""
    match call:
        case ["locate", *arguments]:
            return _complaints_of_locate(arguments)
        case ["make", *words]:
            return [f"no target {word}" for word in _targets(words) - _targets_of_makefile()]
        case ["python" | "python3", "-m", "pip", *words] | ["pip", *words]:
            return _unknown_extras(" ".join(words))
        case ["python" | "python3", "-m", "pytest" | "pydoc" | "colcon", *_] | ["pytest", *_]:
            return [f"no file {w}" for w in call if w.startswith("tests/") and not _exists(w)]
        case ["python" | "python3", "-m", *arguments]:
            modules.append(arguments)
            return []
        case ["python" | "python3", script, *_]:
            return [] if _exists(script) else [f"no script {script}"]
        case [program, *_] if program in FOREIGN:
            return []
    return [f"{call[0]} is no known program; it is checked in {Path(__file__).name}"]


def names_of_commands() -> set[str]:
    """What `locate` can be told to do."""
    return set(getattr(typer.main.get_command(app), "commands", {}))


def complaints_of_modules(modules: list[list[str]]) -> list[str]:
    """What the parsers of Python modules, run with `python -m`, say of their arguments."""
    done = subprocess.run(
        [sys.executable, "-c", PARSE],
        cwd=ROOT,
        input=json.dumps(modules),
        capture_output=True,
        text=True,
        check=False,
    )
    failed = [] if done.returncode == 0 else [done.stderr]
    return [*done.stdout.splitlines(), *failed]


def inline_complaints(page: Path) -> list[str]:
    """What is wrong with commands inside a sentence or a table, which may be cut short."""
    wrong = []
    for words in (text.split() for text in INLINE.findall(page.read_text(encoding="utf-8"))):
        match words:
            case ["locate", name, *rest]:
                wrong += _unknown_names(name, rest)
            case ["python", "-m", module, *_]:
                wrong += [] if find_spec(module) else [f"no module {module}"]
            case _:
                wrong += complaints(words, [])
    return wrong


def _complaints_of_locate(arguments: list[str]) -> list[str]:
    command = typer.main.get_command(app)
    for each in _tree(command):
        each.callback = lambda **_: None
    try:
        command.main(arguments, standalone_mode=False)
    except Exception as error:
        return [f"locate {' '.join(arguments)}: {type(error).__name__}: {error}"]
    return []


def _unknown_names(name: str, words: list[str]) -> list[str]:
    command = typer.main.get_command(app)
    if name.startswith("-"):
        return []
    below = getattr(command, "commands", {})
    if name not in below:
        return [f"no command locate {name}"]
    if "--ros-args" in words:
        words = words[: words.index("--ros-args")]
    options = {
        option
        for each in _tree(below[name])
        for parameter in each.params
        for option in getattr(parameter, "opts", ())
    }
    return [
        f"locate {name} has no option {word}"
        for word in words
        if re.fullmatch(r"--?[a-z][a-z-]*", word) and word not in options | {"--help"}
    ]


def _tree(command: object) -> Iterator[object]:
    yield command
    for below in getattr(command, "commands", {}).values():
        yield from _tree(below)


def _targets(words: list[str]) -> set[str]:
    return {word for word in words if "=" not in word and not word.startswith("-")}


def _targets_of_makefile() -> set[str]:
    text = (ROOT / "Makefile").read_text(encoding="utf-8")
    return set(re.findall(r"^([a-z]+):", text, re.M))


def _unknown_extras(words: str) -> list[str]:
    with (ROOT / "pyproject.toml").open("rb") as file:
        known = tomllib.load(file)["project"]["optional-dependencies"]
    named = re.findall(r"(?:plume-locate|\.)\[([a-z0-9,-]+)\]", words)
    return [
        f"no extra {extra}" for list_ in named for extra in list_.split(",") if extra not in known
    ]


def _exists(name: str) -> bool:
    return any(ROOT.glob(name.split("::", maxsplit=1)[0]))
