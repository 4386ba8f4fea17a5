"""Arbitrary scenes and suites: read as they are, or rejected with one error; no file is written outside the given folder."""

import json
import math
import re

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from whisker_sim.cli import main
from whisker_sim.documents import read_json, to_json
from whisker_sim.errors import InputError
from whisker_sim.runs import load_runs
from whisker_sim.scene import Scene
from whisker_sim.schema import scene_schema
from whisker_sim.whisker import PATTERNS

from conftest import SWEEP

SCALARS = (
    st.none()
    | st.booleans()
    | st.integers(-(2**70), 2**70)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(max_size=8)
)
DOCUMENTS = st.recursive(
    SCALARS, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3), max_leaves=8
)
KEYS = [
    "format",
    "name",
    "role",
    "group",
    "face",
    "whisker",
    "object",
    "motion",
    "seed",
    "duration_s",
    "rate_hz",
    "simulation",
    "vibration",
]
QUICK = settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def one_error(read):
    """Result of `read`, or `None` if it raises an error of one line."""
    try:
        return read()
    except InputError as error:
        line = str(error)
    assert line
    assert "\n" not in line
    return None


@QUICK
@given(content=st.binary(max_size=200))
def test_robust_any_bytes(tmp_path, content):
    path = tmp_path / "scene.json"
    path.write_bytes(content)
    one_error(lambda: load_runs(path))


def test_regress_a_line_break_in_a_key_is_escaped(tmp_path):
    path = tmp_path / "scene.json"
    path.write_text(json.dumps({**SWEEP, "whisker": {"\n": None}}))
    with pytest.raises(InputError, match=r"whisker\.\\n: unknown key; expected one of preset") as error:
        load_runs(path)
    assert "\n" not in str(error.value)


@QUICK
@given(key=st.sampled_from(KEYS), value=DOCUMENTS)
def test_robust_any_value_of_a_key(tmp_path, key, value):
    """An accepted value is stored as it was written."""
    path = tmp_path / "scene.json"
    path.write_text(json.dumps({**SWEEP, key: value}))
    loaded = one_error(lambda: load_runs(path))
    if loaded is not None:
        ((run,), written) = (loaded[1], value)
        assert isinstance(run.scene, Scene)
        if key in ("name", "group", "face", "role", "seed", "rate_hz"):
            assert getattr(run.scene, key) == written


@QUICK
@given(document=DOCUMENTS)
def test_verif_documents_read_back_equal(tmp_path, document):
    path = tmp_path / "document.json"
    path.write_text(json.dumps(document))
    assert one_error(lambda: read_json(path)[0]) == document
    if not _is_beyond_64_bits(document):
        path.write_bytes(to_json(document))
        assert read_json(path)[0] == document


def _is_beyond_64_bits(document) -> bool:
    if isinstance(document, int):
        return not -(2**63) <= document < 2**64
    if isinstance(document, list):
        return any(map(_is_beyond_64_bits, document))
    return isinstance(document, dict) and any(map(_is_beyond_64_bits, document.values()))


@QUICK
@given(
    number=st.from_regex(
        r"[-+]?(NaN|Infinity|inf|0x1p3|1_0|[٠-٩]+|01|1e999|\.5|5\.|[0-9]{1,3}(\.[0-9]{1,3})?(e[+-]?[0-9]{1,3})?)", fullmatch=True
    )
)
def test_robust_numbers_are_read_exactly(tmp_path, number):
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(SWEEP)[:-1] + f', "duration_s": {number}}}', encoding="utf-8")
    value = one_error(lambda: read_json(path)[0]["duration_s"])
    if value is not None:
        assert math.isfinite(value)
        assert number.isascii()
        assert value == float(number)


@pytest.mark.parametrize("text", ['{"a": 1, "a": 2}', '{"b": [{"a": 1, "a": 2}]}'])
def test_robust_a_key_twice(tmp_path, text):
    path = tmp_path / "scene.json"
    path.write_text(text)
    with pytest.raises(InputError, match="the key 'a' once, found it 2 times"):
        read_json(path)


def test_verif_every_pattern_has_words():
    """Errors describe what a text must be, and not by a regular expression."""
    patterns = set(re.findall(r'"pattern": ("(?:[^"\\\\]|\\\\.)*")', json.dumps(scene_schema())))
    assert {json.loads(pattern) for pattern in patterns} == set(PATTERNS)


@pytest.mark.parametrize("name", ["../x", "/tmp/x", "x/../../y", "", "a\nb", "a\n", "a\0b", "."])
@pytest.mark.parametrize("key", ["name", "group", "whisker"])
def test_robust_names_do_not_leave_the_folder(tmp_path, capsys, key, name):
    """Names of group and whisker are part of a picture's name."""
    path = tmp_path / f"{SWEEP['name']}.json"
    path.write_text(json.dumps({**SWEEP, key: {"preset": "straight", "name": name} if key == "whisker" else name}))
    assert main(["check", str(path)]) == 2
    error = capsys.readouterr().err
    assert key in error
    assert error.count("\n") == 1
