"""The content of files, also of foreign ones: limits before parsing, strict fields, canonical JSON and its hash.

Floats that the program writes into a file keep 12 significant digits: more than the accuracy of any friction, and few
enough to drop the last bits, in which machines differ.
"""

import hashlib
import json
import pkgutil
import re
import tomllib
from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, Any, ClassVar, Final, Self

import tomli_w
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from rwa_monitor.errors import InputError, did_you_mean

MAX_CONTENT_BYTES: Final = 1_000_000  # a wheel, a scenario or a map is a page of text, the built-in model some 20 kB
MAX_KEY_PARTS: Final = 16  # of a dotted key a.b.c; valid files use two, and tomllib's time grows with their square
SIGNIFICANT_DIGITS: Final = 12  # of numbers in files
_PART: Final = r"""(?:(?<![\w-])[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
_LONG_KEY: Final = re.compile(rf"(?:{_PART}[ \t]*+\.[ \t]*+){{{MAX_KEY_PARTS}}}")


def rounded(value: float, digits: int = SIGNIFICANT_DIGITS) -> float:
    """Return a value rounded to a number of significant digits; idempotent."""
    return float(f"{value:.{digits}g}")


# Types of a float that is kept in a file.
Rounded = Annotated[float, AfterValidator(rounded)]
Finite = Annotated[Rounded, Field(allow_inf_nan=False)]
NotNegative = Annotated[Rounded, Field(ge=0, allow_inf_nan=False)]
Positive = Annotated[Rounded, Field(gt=0, allow_inf_nan=False)]
Probability = Annotated[Rounded, Field(ge=0, le=1)]


def canonical_json(content: Any) -> str:
    """Write plain content (dicts, lists, numbers, text) with sorted keys, without spaces: equal content, equal text.

    Raises
    ------
    ValueError
        If a number is not finite.
    """
    return json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)


def packaged(package: str, file: str) -> str:
    """Return the text of a data file of the installed program.

    Raises
    ------
    InputError
        If the installation lacks it.
    """
    content = pkgutil.get_data(package, file)
    if content is None:
        raise InputError(file, "is missing from the installed package")
    return content.decode()


def parse_toml(text: str, source: str, what: str) -> dict[str, Any]:
    """Return the tables of a TOML text.

    Parameters
    ----------
    text
        The file's content.
    source
        Its name, for messages.
    what
        What it should be, for messages: "a wheel file".

    Raises
    ------
    InputError
        If it is too large, has a key of too many parts, or is no TOML.
    """
    if len(text) > MAX_CONTENT_BYTES:
        raise InputError(source, f"is larger than {MAX_CONTENT_BYTES} bytes; this is not {what}")
    if _LONG_KEY.search(text):
        raise InputError(source, f"has a key of more than {MAX_KEY_PARTS} parts; this is not {what}")
    try:
        return tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise InputError(source, f"is no valid TOML: {error}") from error


class Strict(BaseModel):
    """Base of the content of a file: frozen, without unknown keys, with finite numbers only."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


def ordered(content: Any) -> Any:
    """Return content with one field low… and one field high… unchanged; raises ValueError where high is below low."""
    (low, begin), (high, end) = (field for field in content if field[0].startswith(("low", "high")))
    if end < begin:
        raise ValueError(f"{high} ({end}) is below {low} ({begin})")
    return content


class Range(Strict):
    """From `low` to `high`."""

    low: float
    high: float

    _ordered = model_validator(mode="after")(ordered)

    @property
    def middle(self) -> float:
        """The middle of the range."""
        return 0.5 * (self.low + self.high)


class Hashed(Strict):
    """The content of a whole file, with a hash of its values that does not depend on the file's layout."""

    what: ClassVar[str]  # what the file should be, for messages
    limit: ClassVar[int] = MAX_CONTENT_BYTES

    @classmethod
    def from_json(cls, text: str | bytes, source: str) -> Self:
        """Read the content as JSON.

        Parameters
        ----------
        text, source
            The file's content, and its name for messages.

        Raises
        ------
        InputError
            If the text is too large, is no JSON, or a field is missing, unknown or out of range; names the field.
        """
        if len(text) > cls.limit:
            raise InputError(source, f"is larger than {cls.limit} bytes; this is not a {cls.what}")
        try:
            return cls.model_validate_json(text)
        except ValidationError as error:
            raise InputError.of_validation(source, error, what=f"is no {cls.what}: ") from error

    def to_tables(self) -> dict[str, Any]:
        """Return the content as dicts, lists, numbers and text."""
        return self.model_dump(mode="json")

    def sha256(self) -> str:
        """Return the hash of the canonical JSON."""
        return self._content_sha256

    @cached_property
    def _content_sha256(self) -> str:
        return hashlib.sha256(canonical_json(self.to_tables()).encode()).hexdigest()

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Return a copy, with some fields replaced, without the cached hash, which pydantic would copy, too."""
        copied = super().model_copy(update=update, deep=deep)
        copied.__dict__.pop("_content_sha256", None)
        return copied


class TomlFile(Hashed):
    """The content of a TOML file: a head, a table of plain values, and the other fields as tables of their own."""

    head: ClassVar[str]  # the name of the first table
    first_table: ClassVar[str]  # this field and all after it are tables

    @classmethod
    def tables(cls) -> list[str]:
        """Return the fields that are tables, in the order of the file."""
        names = list(cls.model_fields)
        return names[names.index(cls.first_table) :]

    @classmethod
    def from_toml(cls, text: str, source: str) -> Self:
        """Read the text of a file.

        Parameters
        ----------
        text, source
            The file's content, and its name for messages.

        Raises
        ------
        InputError
            If the text is no TOML, or a key is missing, unknown or out of range; names the key.
        """
        return cls.from_tables(parse_toml(text, source, f"a {cls.what}"), source)

    @classmethod
    def from_tables(cls, tables: Mapping[str, Any], source: str) -> Self:
        """Read the tables of a parsed file; raises InputError as `from_toml` does."""
        head = tables.get(cls.head, {})
        if not isinstance(head, dict):
            raise InputError(source, "is a table", cls.head)
        rest, known = {key: value for key, value in tables.items() if key != cls.head}, cls.tables()
        for key in sorted([*(rest.keys() - set(known)), *(head.keys() & set(known))]):
            hint = "" if key in known else did_you_mean(key, known)
            tables_are = f"the tables are {', '.join((cls.head, *known))}"
            raise InputError(source, f"does not belong here{hint or f'; {tables_are}'}", key)
        try:
            return cls.model_validate({**head, **rest})
        except ValidationError as error:
            raise InputError.of_validation(source, error, place=cls.head, model=cls) from error

    def to_tables(self) -> dict[str, Any]:
        """Return the tables of the file, without unset fields."""
        flat = self.model_dump(mode="json", by_alias=True, exclude_none=True)
        tables = self.tables()
        head = {key: value for key, value in flat.items() if key not in tables}
        return {self.head: head, **{key: flat[key] for key in tables if flat.get(key)}}

    def to_toml(self) -> str:
        """Write the text of the file; `from_toml` gives the same content back."""
        return tomli_w.dumps(self.to_tables())
