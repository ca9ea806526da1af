"""Whatever a file holds: every reader gives a result or one clear line, soon and in little memory.

`make fuzz` runs more examples.
"""

import io
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given

from geometry.errors import BadInputError
from geometry.npz import save_arrays
from tests.fuzz.bounds import impatient, read_bounded
from tests.fuzz.damage import (
    Bend,
    Cut,
    Twist,
    bends,
    bent,
    cuts,
    damaged,
    fuzzed,
    of_another_type,
    twisted,
    twists,
)
from tests.fuzz.readers import READERS, Reader

DOCUMENTS = [name for name, reader in READERS.items() if reader.structure in ("json", "yaml")]
FILES = [name for name in READERS if name != "metadata of a network"]
"""Of that name is no file of its own."""
TEXTS = [
    name
    for name in FILES
    if READERS[name].structure in ("json", "yaml") or "txt" in READERS[name].file
]
UNCHECKED = ("stamp", "report of a reconstruction", "metadata of a network", "index of samples")
"""Made anew where it is strange, only shown, given as texts, and compared as a whole."""
CHECKED = [
    name for name, reader in READERS.items() if reader.structure == "json" and name not in UNCHECKED
]
ARCHIVES = [name for name, reader in READERS.items() if reader.structure == "npz"]


@pytest.fixture
def place(tmp_path: Path, request: pytest.FixtureRequest) -> tuple[Reader, Path, bytes]:
    """The reader of that name, its file, and what that holds while it is whole."""
    reader = READERS[request.param]
    reader.write(tmp_path)
    path = tmp_path / reader.file
    reader.read(path)
    return reader, path, path.read_bytes()


@pytest.mark.parametrize("place", READERS, indirect=True)
@fuzzed(30)
@given(found=cuts())
def test_damaged_bytes(place: tuple[Reader, Path, bytes], found: list[Cut]) -> None:
    reader, path, whole = place
    path.write_bytes(damaged(whole, found))
    read_bounded(reader.read, path)


@pytest.mark.parametrize("place", FILES, indirect=True)
def test_a_pipe_is_not_waited_for(place: tuple[Reader, Path, bytes]) -> None:
    reader, path, _ = place
    path.unlink()
    os.mkfifo(path)
    with impatient():
        read_bounded(reader.read, path)


@pytest.mark.parametrize("place", TEXTS, indirect=True)
@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_marks_before_a_text_are_read(place: tuple[Reader, Path, bytes], encoding: str) -> None:
    reader, path, whole = place
    path.write_bytes(whole.decode().encode(encoding))
    reader.read(path)


@pytest.mark.parametrize("place", DOCUMENTS, indirect=True)
@fuzzed(60)
@given(found=twists())
def test_strange_values(place: tuple[Reader, Path, bytes], found: list[Twist]) -> None:
    reader, path, whole = place
    if reader.structure == "json":
        text = json.dumps(twisted(json.loads(whole), found))
    else:
        text = yaml.safe_dump(twisted(yaml.safe_load(whole), found))
    path.write_bytes(text.encode(errors="surrogatepass"))
    read_bounded(reader.read, path)


@pytest.mark.parametrize("place", CHECKED, indirect=True)
def test_truth_values_and_texts_are_no_numbers(place: tuple[Reader, Path, bytes]) -> None:
    reader, path, whole = place
    changed = list(of_another_type(json.loads(whole)))
    assert changed
    for document in changed:
        path.write_text(json.dumps(document))
        with pytest.raises(BadInputError) as refused:
            reader.read(path)
        assert len(str(refused.value).splitlines()) == 1


@pytest.mark.parametrize("place", ARCHIVES, indirect=True)
@fuzzed(60)
@given(found=bends())
def test_strange_arrays(place: tuple[Reader, Path, bytes], found: list[Bend]) -> None:
    reader, path, whole = place
    with np.load(io.BytesIO(whole)) as file:
        arrays: dict[str, Any] = bent(dict(file), found)
    save_arrays(path, **arrays)
    read_bounded(reader.read, path)
