"""Arguments of public functions, checked where they come in, by the same annotations as the settings of a suite."""

from __future__ import annotations

import dataclasses
from typing import Annotated, Any, get_type_hints

import numpy as np
import pydantic
from annotated_types import Ge, Gt

from causalbench.errors import UserError

Steps = Annotated[int, Gt(0)]
Seed = Annotated[int, Ge(0)]


def check_argument(name: str, value: object, hint: Any) -> None:
    """Raise `UserError` unless `value` is of the type `hint` and in its bounds; a number of NumPy's is one as well."""
    plain = value.item() if isinstance(value, np.generic) else value
    try:
        pydantic.TypeAdapter(hint).validate_python(plain, strict=True)
    except pydantic.ValidationError as error:
        said = error.errors()[0]["msg"].replace("Input should", "should")
        raise UserError(f"{name}: {said}, got {value!r}") from None


def check_record(record: Any, expected: type[Any]) -> None:
    """Raise `UserError` unless `record` is one of the dataclass `expected` with every field in its bounds."""
    if not isinstance(record, expected):
        raise UserError(f"expected {expected.__name__}, got {type(record).__name__}")
    hints = get_type_hints(type(record), include_extras=True)
    for field in dataclasses.fields(record):
        value = getattr(record, field.name)
        check_argument(f"{type(record).__name__}.{field.name}", value, hints[field.name])
        if dataclasses.is_dataclass(value):
            check_record(value, type(value))
