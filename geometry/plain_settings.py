"""Settings that users write into files."""

from collections.abc import Iterator
from typing import Any, get_args

from pydantic import BaseModel, ConfigDict, model_validator


class PlainSettings(BaseModel):
    """Settings that refuse unknown names, truth values in place of numbers, and zero bytes.

    YAML reads ``yes``, ``on`` and ``true`` as truth values, which pydantic would turn into 1. No
    file system and no other library takes a text with a zero byte.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _refuse_ambiguous_values(cls, content: Any) -> Any:
        for name, value in content.items() if isinstance(content, dict) else ():
            field = cls.model_fields.get(name)
            found = list(_scalars_in(value))
            takes_truth = field is None or any(map(_takes_truth, _types_in(field.annotation)))
            if not takes_truth and any(isinstance(each, bool) for each in found):
                raise ValueError(f"{name}: yes and no, true and false are no number")
            if any(isinstance(each, str) and "\0" in each for each in found):
                raise ValueError(f"{name}: holds a zero byte")
        return content


def _scalars_in(value: Any) -> Iterator[Any]:
    """A value, or those in a list or mapping at any depth, with the names of a mapping."""
    if isinstance(value, dict | list | tuple):
        for inner in (*value, *value.values()) if isinstance(value, dict) else value:
            yield from _scalars_in(inner)
    else:
        yield value


def _types_in(annotation: Any) -> Iterator[Any]:
    """What an annotation is made of, at any depth."""
    yield annotation
    for part in get_args(annotation):
        yield from _types_in(part)


def _takes_truth(kind: Any) -> bool:
    """Whether a type is that of truth values, or of settings that check their own."""
    return kind in (bool, Any) or (isinstance(kind, type) and issubclass(kind, BaseModel))
