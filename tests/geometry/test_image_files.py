from pathlib import Path

import numpy as np
import pytest

from geometry.errors import BadInputError
from geometry.image_files import read_image, write_image

NOT_UTF8 = "caf\udce9.png"
PICTURE = np.arange(48, dtype=np.uint8).reshape(6, 8)


def test_names_that_are_not_utf8_are_written_and_read(tmp_path: Path) -> None:
    path = tmp_path / NOT_UTF8
    write_image(path, PICTURE)
    assert (read_image(path) == PICTURE).all()


def test_what_is_no_image_is_named(tmp_path: Path) -> None:
    for content in (b"", b"no image"):
        (tmp_path / "a.png").write_bytes(content)
        with pytest.raises(BadInputError, match=r"a\.png: not a readable image"):
            read_image(tmp_path / "a.png")
    with pytest.raises(BadInputError, match=r"missing\.png: cannot be read \(No such file"):
        read_image(tmp_path / "missing.png")


def test_what_cannot_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"missing/a.png: cannot be written"):
        write_image(tmp_path / "missing" / "a.png", PICTURE)
    with pytest.raises(BadInputError, match="unknown image format"):
        write_image(tmp_path / "a.unknown", PICTURE)
