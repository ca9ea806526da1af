"""How errors of libraries are worded."""

from pathlib import Path
from typing import Self

import pytest
from pydantic import BaseModel, ValidationError, model_validator

from geometry.errors import BadInputError, first_complaint, report_as_bad_input, short_reason


class Span(BaseModel):
    first: int
    last: int

    @model_validator(mode="after")
    def _rises(self) -> Self:
        if self.last < self.first:
            raise ValueError("last is before first")
        return self


class Spans(BaseModel):
    spans: list[Span]


def complaint(model: type[BaseModel], content: object, kind: str = "") -> str:
    with pytest.raises(ValidationError) as refused:
        model.model_validate(content)
    return first_complaint(refused.value, kind)


def test_a_complaint_begins_with_its_place_where_it_has_one() -> None:
    assert complaint(Span, {"first": 2, "last": 1}) == "last is before first"
    assert complaint(Span, {"first": 2, "last": 1}, "setting") == "last is before first"
    assert complaint(Spans, {"spans": [{"first": 1}]}) == "spans.0.last: Field required"
    assert complaint(Span, {"first": 1}, "setting") == "setting last: Field required"


def test_a_reason_is_one_short_line_and_never_empty() -> None:
    assert short_reason(EOFError()) == "EOFError"
    assert short_reason(ValueError("two\n lines")) == "two lines"
    assert len(short_reason(ValueError("x" * 500))) == 120


@pytest.mark.parametrize(
    ("raised", "said"),
    [
        (KeyError(), "a.log: not a readable log (KeyError)"),
        (ModuleNotFoundError(), "a.log: to read logs, pip install it"),
        (BadInputError("as it is"), "as it is"),
    ],
)
def test_whatever_a_library_raises_is_named_with_the_file(raised: Exception, said: str) -> None:
    given = Path("a.log")
    with (
        pytest.raises(BadInputError) as refused,
        report_as_bad_input(given, "log", missing="pip install it"),
    ):
        raise raised
    assert str(refused.value) == said
