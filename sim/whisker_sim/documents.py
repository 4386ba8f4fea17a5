"""Strict reading of JSON documents into typed structs; errors state file, line, column and key."""

import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from whisker_sim.errors import InputError
from whisker_sim.whisker import PATTERNS

T = TypeVar("T")

_UNKNOWN_FIELD = re.compile(r"Object contains unknown field `(?P<key>[^`]*)`(?: - at `(?P<path>[^`]*)`)?")
_MISSING_FIELD = re.compile(r"Object missing required field `(?P<key>[^`]*)`(?: - at `(?P<path>[^`]*)`)?")
_OTHER = re.compile(r"(?P<text>.*?)(?: - at `(?P<path>[^`]*)`)?$", re.DOTALL)
# Message of a struct's own check: the key, relative to the struct, then the error.
_KEYED = re.compile(r"(?P<keys>[a-z0-9_]+(\.[a-z0-9_]+)*): (?P<text>.*)", re.DOTALL)
_PATH_STEP = re.compile(r"\.(?P<key>[^.\[]+)|\[(?P<index>\d+)\]")
_TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|[{}\[\],:]|[^\s{}\[\],:"]+', re.DOTALL)
"""Tokens of JSON: strings, punctuation, and the rest."""


def read_json(path: Path) -> tuple[Any, str]:
    """Parses the JSON document at `path`; returns the value and the text.

    Raises `InputError` if the file cannot be read, is not UTF-8 or not JSON, repeats a key, or contains NaN, an infinity or an
    integer of more digits than Python converts.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start}: expected UTF-8 text, found {error.object[error.start]:#04x}") from None

    def no_repeated_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        document = dict(pairs)
        if len(document) < len(pairs):
            keys = [key for key, _ in pairs]
            key = next(key for key in keys if keys.count(key) > 1)
            where = _position_of_repeated(text, key)
            raise InputError(f"{path}{where}: expected the key '{key}' once, found it {keys.count(key)} times")
        return document

    def whole(number: str) -> int:
        try:
            return int(number)
        except ValueError:
            digits, most = len(number.removeprefix("-")), sys.get_int_max_str_digits()
            where = _position_of(text, number)
            raise InputError(f"{path}{where}: expected a number of at most {most} digits, found one of {digits}") from None

    def only_finite(number: str) -> float:
        value = float(number)
        if value in (float("inf"), float("-inf")):
            raise InputError(f"{path}{_position_of(text, number)}: expected a finite number, found {number}")
        return value

    def not_a_number(constant: str) -> float:
        raise InputError(f"{path}{_position_of(text, constant)}: expected a finite number, found {constant}")

    try:
        value = json.loads(
            text, object_pairs_hook=no_repeated_keys, parse_int=whole, parse_float=only_finite, parse_constant=not_a_number
        )
    except json.JSONDecodeError as error:
        found = repr(text[error.pos : error.pos + 12]) if error.pos < len(text) else "the end of the file"
        raise InputError(f"{path}:{error.lineno}:{error.colno}: expected JSON ({error.msg}), found {found}") from None
    except RecursionError:
        raise InputError(f"{path}: expected a scene or suite, found JSON nested too deeply") from None
    return value, text


def read_document(path: Path, kind: type[T]) -> T:
    """Reads the JSON document at `path` as the struct `kind`; raises `InputError` if it does not match."""
    value, text = read_json(path)
    try:
        return msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        raise InputError(f"{path}{_explain(str(error), value, text, kind)}") from None


def located(path: Path, message: str) -> InputError:
    """The error about the document at `path` with the text `message`.

    If the message has the form `key.key: text`, the position of the key is added.
    """
    _, text = read_json(path)
    return InputError(f"{path}{_keyed(message, text, [])}")


def to_json(value: Any) -> bytes:
    """Encodes `value` in the JSON style of the project: indentation of two spaces, shortest floats, newline at the end."""
    return msgspec.json.format(msgspec.json.encode(value), indent=2) + b"\n"


def _explain(message: str, value: Any, text: str, kind: type) -> str:
    if match := _UNKNOWN_FIELD.match(message):
        path = _steps(match["path"])
        known = ", ".join(_known_keys(value, path, kind))
        return f"{_position(text, [*path, match['key']])}: {_dotted([*path, match['key']])}: unknown key; expected one of {known}"
    if match := _MISSING_FIELD.match(message):
        path = _steps(match["path"])
        where = f"{_dotted(path)}: " if path else ""
        found = ", ".join(_at(value, path))
        found = f"only {found}" if found else "none"
        return f"{_position(text, path)}: {where}expected the key '{match['key']}', found {found}"
    match = _OTHER.match(message)
    path = _steps(match["path"])
    if _KEYED.fullmatch(match["text"]):
        return _keyed(match["text"], text, path)
    found = _brief(_at(value, path))
    where = f"{_dotted(path)}: " if path else ""
    detail = match["text"].replace("`", "")
    detail = detail.split(", got")[0]
    detail = re.sub(r"^Invalid (enum )?value .*$", lambda _: f"expected one of {', '.join(_choices(kind, path))}", detail)
    detail = re.sub(r"str matching regex '(.*)'$", lambda match: PATTERNS[match[1].replace("\\\\", "\\")], detail)
    detail = detail[0].lower() + detail[1:]
    return f"{_position(text, path)}: {where}{detail}, found {found}"


def _keyed(message: str, text: str, parent: list[str | int]) -> str:
    match = _KEYED.fullmatch(message)
    if match is None:
        return f": {message}"
    path = [*parent, *match["keys"].split(".")]
    return f"{_position(text, path)}: {_dotted(path)}: {match['text']}"


def _steps(path: str | None) -> list[str | int]:
    steps = _PATH_STEP.finditer((path or "$").removeprefix("$"))
    return [step["key"] if step["key"] is not None else int(step["index"]) for step in steps]


def _dotted(path: list[str | int]) -> str:
    text = ""
    for step in path:
        text += f"[{step}]" if isinstance(step, int) else f".{step}"
    return text.removeprefix(".")


def _at(value: Any, path: list[str | int]) -> Any:
    for step in path:
        value = value[step]
    return value


def _brief(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _position(text: str, path: list[str | int]) -> str:
    """`:line:column` of the key or list element `path`, or of the last of its parents that is there; empty for the document."""
    offsets = dict(_places(text))
    parents = (tuple(path[:length]) for length in range(len(path), 0, -1))
    found = next((offsets[place] for place in parents if place in offsets), None)
    return "" if found is None else _line_and_column(text, found)


def _position_of_repeated(text: str, key: str) -> str:
    """`:line:column` of the second `key` of the first object that has it twice."""
    seen = set()
    for place, offset in _places(text):
        if place in seen and place[-1] == key:
            return _line_and_column(text, offset)
        seen.add(place)
    return ""


def _position_of(text: str, number: str) -> str:
    """`:line:column` of the first token that begins with `number`, outside of strings."""
    starts = (match.start() for match in _TOKEN.finditer(text) if match[0].startswith(number))
    return _line_and_column(text, next(starts))


def _places(text: str) -> Iterator[tuple[tuple[str | int, ...], int]]:
    """Path and offset of every key and of every element of a list in the JSON `text`, in their order.

    The text may be wrong beyond the last place that is asked for.
    """
    # Brackets of the objects and lists around the token, and the current key or index in each.
    around, path, before = [], [], ""
    for match in _TOKEN.finditer(text):
        token = match[0]
        if token in ("}", "]"):
            around, path = around[:-1], path[:-1]
        elif token == "," and around and around[-1] == "[":
            path[-1] += 1
        elif token not in (",", ":"):
            is_key = bool(around) and around[-1] == "{" and before != ":"
            if is_key:
                path[-1] = json.loads(token)
            if is_key or (around and around[-1] == "["):
                yield tuple(path), match.start()
            if token in ("{", "["):
                around.append(token)
                path.append("" if token == "{" else 0)
        before = token


def _line_and_column(text: str, offset: int) -> str:
    return f":{text.count(chr(10), 0, offset) + 1}:{offset - text.rfind(chr(10), 0, offset)}"


def _types_at(kind: Any, path: list[str | int]) -> list[msgspec.inspect.Type]:
    """Types that are allowed at `path` of a document of type `kind`."""
    types = _alternatives(msgspec.inspect.type_info(kind))
    for step in path:
        following: list[msgspec.inspect.Type] = []
        for candidate in types:
            if isinstance(candidate, msgspec.inspect.StructType):
                following += [t for f in candidate.fields if f.encode_name == step for t in _alternatives(f.type)]
            elif isinstance(candidate, msgspec.inspect.ListType | msgspec.inspect.VarTupleType):
                following += _alternatives(candidate.item_type)
        types = following
    return types


def _alternatives(kind: msgspec.inspect.Type) -> list[msgspec.inspect.Type]:
    return list(kind.types) if isinstance(kind, msgspec.inspect.UnionType) else [kind]


def _known_keys(value: Any, path: list[str | int], kind: type) -> list[str]:
    found = _at(value, path)
    for candidate in _types_at(kind, path):
        if isinstance(candidate, msgspec.inspect.StructType) and (
            candidate.tag_field is None or found.get(candidate.tag_field) == candidate.tag
        ):
            tag = [candidate.tag_field] if candidate.tag_field else []
            return tag + [field.encode_name for field in candidate.fields]
    return []


def _choices(kind: type, path: list[str | int]) -> list[str]:
    """Allowed values of a tag or a literal at `path`."""
    *parent, last = path
    tags = [
        str(candidate.tag)
        for candidate in _types_at(kind, parent)
        if isinstance(candidate, msgspec.inspect.StructType) and candidate.tag_field == last
    ]
    literals = [str(v) for c in _types_at(kind, path) if isinstance(c, msgspec.inspect.LiteralType) for v in c.values]
    return tags or literals or [str(v) for c in _types_at(kind, path) if isinstance(c, msgspec.inspect.EnumType) for v in c.cls]
