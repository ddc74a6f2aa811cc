"""Files under a closed schema: JSON read strictly and checked against msgspec types; what is wrong is one line."""

from __future__ import annotations

import difflib
import json
import math
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Annotated, Any, TypeVar, get_args

import msgspec
from msgspec import Meta

from dore.errors import InputError, shown

T = TypeVar("T")
MAX_BYTES = 64 << 20
"""No file of this program is larger; a device or another program's file is refused before it is read whole."""
Count = Annotated[int, Meta(ge=0, le=2**53)]
"""A whole number that every program reads alike."""
Degrees = Annotated[float, Meta(ge=-360.0, le=360.0)]
WORDS = {
    "int": "a whole number",
    "float": "a number",
    "str": "text",
    "bool": "true or false",
    "array": "a list",
    "object": "an object",
    "null": "null",
}
"""What messages call JSON's types."""
BOUNDS = {">=": "of at least ", "<=": "of at most ", ">": "above ", "<": "below "}


@contextmanager
def named(path: str | os.PathLike[str]) -> Iterator[None]:
    """What is wrong with the file that the block reads is said with its name."""
    try:
        yield
    except InputError as error:
        raise type(error)(f"{path}: {error}") from None


def read_json(path: str | os.PathLike[str]) -> Any:
    """A JSON file in UTF-8; a byte order mark is skipped.

    Raises:
        InputError: no such file, no JSON, a key given twice, NaN or infinity, or a file that is too large or deep; does
            not name the file, which `named` does.
    """
    try:
        with open(path, "rb") as file:
            data = file.read(MAX_BYTES + 1)
        if len(data) > MAX_BYTES:
            raise InputError(f"more than {MAX_BYTES >> 20} MiB, want a smaller file")
        return parse_json(data.decode("utf-8-sig"))
    except FileNotFoundError:
        raise InputError("no such file") from None
    except IsADirectoryError:
        raise InputError("is a folder, want a file") from None
    except UnicodeDecodeError:
        raise InputError("cannot be read as JSON (not in UTF-8)") from None
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror or error})") from None


def parse_json(text: str) -> Any:
    """Strict JSON.

    Raises:
        InputError: no JSON, a key given twice, NaN or infinity, or nested too deep.
    """
    try:
        return json.loads(
            text, object_pairs_hook=_once, parse_constant=_finite, parse_float=_finite, parse_int=_short_int
        )
    except InputError:
        raise
    except (ValueError, RecursionError) as error:
        why = "nested too deep" if isinstance(error, RecursionError) else str(error)
        raise InputError(f"cannot be read as JSON ({why})") from None


def checked(data: Any, kind: type[T], name: str = "") -> T:
    """Parsed JSON as a msgspec type, whose structs must forbid unknown fields.

    Args:
        name: what the data is called in messages, as "scene"; empty for the file itself.

    Raises:
        InputError: names the first field that is wrong, its value and what was wanted.
    """
    try:
        return msgspec.convert(data, kind, strict=True)
    except msgspec.ValidationError as error:
        raise InputError(_line(str(error), data, kind, name)) from None
    except UnicodeEncodeError:
        raise InputError(f"{name or 'file'}: holds a character that is no Unicode, want plain text") from None


def nearest(name: str, options: Sequence[str]) -> str:
    """ " (did you mean ...?)", or nothing where no option is near."""
    near = difflib.get_close_matches(name, options, n=1)
    return f" (did you mean {near[0]}?)" if near else ""


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object's fields, each of them given once."""
    found = dict(pairs)
    if len(found) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise InputError(f"{twice}: given twice, want it once")
    return found


def _finite(digits: str) -> float:
    value = float(digits)
    if not math.isfinite(value):
        raise InputError(f"got {shown(digits)}, want a finite number")
    return value


def _short_int(digits: str) -> int:
    if len(digits) > 20:
        raise InputError(f"got a number of {len(digits)} digits, want at most 20")
    return int(digits)


def _line(message: str, data: Any, kind: Any, name: str) -> str:
    """A msgspec message in the program's own words: field, value, and what was wanted."""
    message, _, place = message.partition(" - at `$")
    place = place.rstrip("`")
    steps = re.findall(r"\.(\w+)|\[(\d+)\]", place)
    for key, index in steps:
        data = data[key] if key else data[int(index)]
    field = f"{name}{place}" if name else place.lstrip(".")
    inside = f"{field}." if field else ""
    kind = _type_at(kind, [key for key, _ in steps])
    if unknown := re.fullmatch(r"Object contains unknown field `(.*)`", message, re.DOTALL):
        known = [one.encode_name for one in msgspec.structs.fields(_struct_in(kind))]
        return f"{inside}{unknown[1]}: no such key{nearest(unknown[1], known)}; want {', '.join(known)}"
    if missing := re.fullmatch(r"Object missing required field `(.*)`", message):
        return f"{inside}{missing[1]}: not given, want one"
    return f"{field or 'file'}: got {shown(data)}, want {_wanted(message, kind)}"


def _wanted(message: str, kind: Any) -> str:
    """What a value should have been."""
    if message.startswith("Invalid enum value"):
        return f"one of {', '.join(map(str, get_args(kind) or kind))}"
    wanted = re.sub(r", got .*", "", message.removeprefix("Expected "))
    wanted = re.sub(r"`([^`]*)`", lambda found: " or ".join(WORDS.get(w, w) for w in found[1].split(" | ")), wanted)
    return re.sub(r"(>=|<=|>|<) ", lambda found: BOUNDS[found[1]], wanted)


def _type_at(kind: Any, keys: Sequence[str]) -> Any:
    """The type of a field of a field of a type; an empty key is a place in a list."""
    for key in keys:
        if key:
            kind = next(field.type for field in msgspec.structs.fields(_struct_in(kind)) if field.encode_name == key)
        else:
            kind = next(iter(get_args(kind)), kind)
    return kind


def _struct_in(kind: Any) -> Any:
    """The struct that a type is, or that an optional type holds."""
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        return kind
    return next(filter(None, map(_struct_in, get_args(kind))), None)
