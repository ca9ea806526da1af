"""Every benchmark, and every sub-command of it, tells what it is on the command line."""

import ast
import runpy
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parents[1]
MODULES = sorted(path.stem for path in HERE.glob("*.py") if path.stem != "__init__")
PACKAGES = sorted(path.parent.name for path in HERE.glob("*/__main__.py"))


def commands() -> list[tuple[str, ...]]:
    """Every benchmark, and each of its sub-commands, which its `__main__` names."""
    found: list[tuple[str, ...]] = [(name,) for name in MODULES]
    for name in PACKAGES:
        main = ast.parse((HERE / name / "__main__.py").read_text())
        constants = [node.value for node in ast.walk(main) if isinstance(node, ast.Constant)]
        words = [value for value in constants if isinstance(value, str)]
        found += [(name,), *((name, word) for word in words)] if name != "checks" else []
    return found


@pytest.mark.parametrize("command", commands(), ids=" ".join)
def test_it_has_help(
    command: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if command[0] == "warp_leak":
        pytest.importorskip("torch")
    monkeypatch.setattr(sys, "argv", [*command, "--help"])
    with pytest.raises(SystemExit) as end:
        runpy.run_module(f"benchmarks.{command[0]}", run_name="__main__")
    assert end.value.code == 0
    usage = f"python -m benchmarks.{' '.join(command)}"
    shown = capsys.readouterr().out
    assert shown.startswith(f"usage: {usage}")
    is_package = command[0] in PACKAGES and len(command) == 1
    assert is_package or shown.count(usage) > 1, "its docstring does not say how it is run"
