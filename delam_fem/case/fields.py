"""Define the field types of case sections with their error messages, and the class of sections."""

from __future__ import annotations

import difflib
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    ValidationError,
    ValidatorFunctionWrapHandler,
    model_validator,
)
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

LEAST, MOST = 1e-30, 1e30
"""Smallest and largest sizes; their products and powers still are doubles."""
MOST_COUNTED = 10**15
"""Largest number of periods, points or the like."""


@dataclass(frozen=True)
class Expected:
    """A validator that replaces any inner error by "expected …" with the given words.

    Attributes:
        words: what is expected, as in "a positive number".
    """

    words: str

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Return the schema of the field with this validator around it."""
        return core_schema.no_info_wrap_validator_function(self._check, handler(source))

    def _check(self, value: object, inner: ValidatorFunctionWrapHandler) -> object:
        """Validate a value.

        Raises:
            PydanticCustomError: the value is not what is expected.
        """
        try:
            return inner(value)
        except ValidationError:
            what = {"what": self.words}
            raise PydanticCustomError("unexpected", "expected {what}", what) from None


def expected(what: str) -> Expected:
    """Return a validator that replaces any inner error by "expected …" with the given words."""
    return Expected(what)


def inconsistent(key: str, text: str) -> PydanticCustomError:
    """Return an error for a key that contradicts another key.

    Args:
        key: the key in the notation of overrides, without its section.
        text: message: what was expected and what was given.
    """
    return PydanticCustomError("inconsistent", "{text}", {"key": key, "text": text})


def _sensible(value: float) -> float:
    """Check that a size is one that arithmetic in doubles can bear."""
    if value and not LEAST <= value <= MOST:
        raise PydanticCustomError("unexpected", f"expected a size from {LEAST:g} to {MOST:g}")
    return value


def _countable(value: int) -> int:
    """Check that a number is one that can be counted to."""
    if value > MOST_COUNTED:
        raise PydanticCustomError("unexpected", f"expected at most {MOST_COUNTED:g}")
    return value


def _short(path: Path) -> Path:
    """Check that a file name is one that a file system can have."""
    text = os.fsencode(path)
    if b"\0" in text or len(text) > 1024 or any(len(part) > 255 for part in text.split(b"/")):
        raise PydanticCustomError("unexpected", "expected the name of a file")
    return path


_FINITE = Field(strict=True, allow_inf_nan=False)
_WHOLE = Field(strict=True)
Positive = Annotated[
    float, _FINITE, Field(gt=0.0), expected("a positive number"), AfterValidator(_sensible)
]
NotNegative = Annotated[
    float, _FINITE, Field(ge=0.0), expected("a number of at least 0"), AfterValidator(_sensible)
]
DampingRatio = Annotated[
    float, _FINITE, Field(ge=0.0, lt=1.0), expected("a number from 0 to below 1")
]
Restitution = Annotated[float, _FINITE, Field(ge=0.0, le=1.0), expected("a number from 0 to 1")]
Elements = Annotated[
    int, _WHOLE, Field(ge=1, le=100_000), expected("a whole number from 1 to 100000")
]
PointsPerElement = Annotated[
    int, _WHOLE, Field(ge=1, le=64), expected("a whole number from 1 to 64")
]
CellCount = Annotated[int, _WHOLE, Field(ge=1, le=100), expected("a whole number from 1 to 100")]
Poisson = Annotated[
    float, _FINITE, Field(ge=0.0, lt=0.5), expected("a number of at least 0 and below 0.5")
]
Degree = Annotated[int, _WHOLE, Field(ge=2, le=3), expected("2 or 3")]
Steps = Annotated[
    int, _WHOLE, Field(ge=4, le=100_000_000), expected("a whole number from 4 to 100000000")
]
Refine = Annotated[
    int, _WHOLE, Field(ge=1, le=4096), expected("a whole number from 1 (never) to 4096")
]
Count = Annotated[
    int, _WHOLE, Field(ge=1), expected("a whole number of at least 1"), AfterValidator(_countable)
]
CountOrSettled = Annotated[
    Annotated[int, _WHOLE, Field(ge=1), AfterValidator(_countable)] | Literal["settled"],
    expected('a whole number of at least 1, or "settled"'),
]
CountOrNone = Annotated[
    int, _WHOLE, Field(ge=0), expected("a whole number of at least 0"), AfterValidator(_countable)
]
FileName = Annotated[
    Path,
    AfterValidator(_short),
    AfterValidator(lambda path: Path(os.path.abspath(path))),
    expected("the name of a file"),
]
Label = Annotated[
    str,
    Field(strict=True, pattern=r"^[A-Za-z][\w-]*$"),
    expected("a word of letters, digits, - and _"),
]


class Section(BaseModel):
    """A table of a case file.

    Attributes:
        also_written: keys of the file, positive numbers, that become other fields when it is read.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    also_written: ClassVar[tuple[str, ...]] = ()

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, data: object) -> object:
        """Refuse a key that the section does not have, and suggest the most similar key."""
        for key in data if isinstance(data, Mapping) else ():
            if key not in cls.model_fields:
                near = difflib.get_close_matches(str(key), cls.model_fields, n=1)
                hint = f"did you mean {near[0]}?" if near else "expected one of "
                raise inconsistent(
                    str(key), f"unknown key; {hint}{'' if near else ', '.join(cls.model_fields)}"
                )
        return data
