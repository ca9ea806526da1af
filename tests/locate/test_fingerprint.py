from pathlib import Path

import pytest

from geometry.errors import BadInputError
from locate.pipeline import fingerprint
from locate.pipeline.fingerprint import fingerprint_code, fingerprint_path, imported_modules


def test_a_path_is_known_by_content_and_names(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"1")
    first = fingerprint_path(tmp_path)
    (tmp_path / "a").write_bytes(b"2")
    second = fingerprint_path(tmp_path)
    (tmp_path / "a").rename(tmp_path / "b")
    assert len({first, second, fingerprint_path(tmp_path)}) == 3


def test_a_path_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="missing"):
        fingerprint_path(tmp_path / "missing")


def test_imports_are_followed_at_any_depth_and_in_functions() -> None:
    found = imported_modules("detect.registry")
    assert {"detect", "detect.registry", "geometry.errors", "geometry"} <= found
    assert any(name.startswith("detect.dybs.") for name in found)  # imported in a function
    assert not any(name.startswith("locate") for name in found)


def test_a_package_that_is_imported_whole_is_followed() -> None:
    assert "locate.recording.keyframes" in imported_modules("locate.pipeline.frames")


def test_code_changes_with_any_module_below(monkeypatch: pytest.MonkeyPatch) -> None:
    read, before = fingerprint.source_of, fingerprint_code("detect.registry")
    edited = {"geometry.errors"}
    monkeypatch.setattr(fingerprint, "source_of", lambda name: read(name) + b"#" * (name in edited))
    assert fingerprint_code("detect.registry") != before
    edited.clear()
    assert fingerprint_code("detect.registry") == before


def test_code_of_another_program_is_known_by_name() -> None:
    assert fingerprint_code("numpy") != fingerprint_code("scipy")
    assert imported_modules("numpy") == frozenset()
