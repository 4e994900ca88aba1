"""Study files: what YAML 1.2 says a value is, and errors that name file, line, key and remedy."""

import contextlib
import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from shear_sim.document import MAX_VALUES, Document, StudyError, read_yaml, round12

FILE = Path("study.yaml")


def read(text: str | bytes) -> Document:
    return read_yaml(text.encode() if isinstance(text, str) else text, FILE)


def report(text: str | bytes) -> str:
    with pytest.raises(StudyError) as caught:
        read(text)
    return str(caught.value)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 0.001),
        ("1e6", 1e6),
        ("+.5", 0.5),
        ("5.", 5.0),
        ("-0.0", 0.0),
        ("017", 17),
        ("0o17", 15),
        ("0x1F", 31),
        ("-12", -12),
        (".inf", float("inf")),
        ("-.INF", float("-inf")),
        ("true", True),
        ("FALSE", False),
        ("~", None),
        ("null", None),
        ("", None),
        # Numbers, booleans and dates of YAML 1.1 that are texts in YAML 1.2.
        ("12:30", "12:30"),
        ("on", "on"),
        ("yes", "yes"),
        ("No", "No"),
        ("1_000", "1_000"),
        ("2024-06-11", "2024-06-11"),
        ("none", "none"),
        ('"1e-3"', "1e-3"),
        ("'true'", "true"),
    ],
)
def test_scalars_are_those_of_yaml_1_2(text, value):
    read_value = read(f"key: {text}").data["key"]
    assert read_value == value
    assert type(read_value) is type(value)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_float_is_read_to_12_digits_however_it_is_written(value):
    assert read(f"key: {value!r}").data["key"] == round12(value)
    assert read(f"key: {value:.17e}").data["key"] == round12(value)


# What a plain mapping may hold, texts without control characters and halves of characters.
_VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**70), 2**70)
    | st.text(st.characters(codec="utf-8")),
    lambda inner: st.lists(inner) | st.dictionaries(st.text("abc.xyz", min_size=1), inner),
    max_leaves=20,
)


@given(st.dictionaries(st.text("abc.xyz", min_size=1), _VALUES))
def test_json_is_yaml(data):
    assert read(json.dumps(data)).data == data


def test_every_key_and_item_has_its_line():
    document = read("a:\n  b: 1\n  c:\n    - x\n    - {d: 2}\ne: 3\n")
    assert document.lines == {
        (): 1,
        ("a",): 1,
        ("a", "b"): 2,
        ("a", "c"): 3,
        ("a", "c", 0): 4,
        ("a", "c", 1): 5,
        ("a", "c", 1, "d"): 5,
        ("e",): 6,
    }
    assert document.line(("a", "c", 1, "unknown", "deeper")) == 5


def test_aliases_stand_for_their_anchor():
    document = read("a: &three [1, 2, 3]\nb: {c: *three, d: *three}\n")
    assert document.data["b"] == {"c": [1, 2, 3], "d": [1, 2, 3]}


def test_a_key_given_twice_is_refused_with_both_lines():
    text = report("model:\n  friction: 1\n  links: {cut: none, cut: bulk}\n  friction: 2\n")
    assert "study.yaml:4: model.friction: given twice, in lines 2 and 4" in text
    assert "study.yaml:3: model.links.cut: given twice, in lines 3 and 3" in text


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "study.yaml:1: is empty: a study is a mapping"),
        (b"# only a comment\n", "is empty"),
        (b"- 1\n", r"starts with \[1\]: a study is a mapping"),
        (b"a word", "starts with a word"),
        (b"model:\n\tfriction: 1\n", "study.yaml:2: not YAML: .*indent with spaces, not tabs"),
        (b"a: [1, 2\nb: 3\n", "study.yaml:2: not YAML"),
        (b"a: b: c\n", "study.yaml:1: not YAML: mapping values are not allowed here"),
        (b"a: 1\n---\nb: 2\n", "expected a single document"),
        (b"a: *nowhere\n", "undefined alias"),
        (b"a: 1\nb: \xe9\n", "study.yaml:2: byte 0xe9 is not UTF-8"),
        (b"a: \x00\n", "not YAML"),
        (b"a: &a [*a]\n", "study.yaml:1: a.0.: an alias inside its own anchor has no end"),
        (b"a: " + b"[" * 2000, "nested too deeply"),
        (b"1: 2\n", "`1` is not a word, so it cannot be a key"),
        (b"[a]: 2\n", "this is not a word"),
        (b"a: !!python/object:os.system x\n", "the tag .*os.system has no meaning in a study"),
        (b"!!str a: 1\n", "not a word"),
        (b"a: " + b"9" * 5000, "study.yaml:1: a: cannot be read"),
        (b'a: "\\ud800"', "study.yaml:1: a: cannot be read"),
        (b'a: "\\U99999999"', "not YAML"),
    ],
)
def test_what_is_no_study_is_refused_in_words(content, message):
    with pytest.raises(StudyError, match=message):
        read(content)


def test_aliases_that_multiply_are_refused():
    """Nine levels of ten aliases are 10⁹ values in 300 bytes."""
    levels = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    levels += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 9)]
    assert f"more than {MAX_VALUES:,} values" in report("\n".join(levels))


@given(
    st.binary(max_size=200)
    | st.text(max_size=200).map(lambda text: text.encode("utf-8", "replace"))
)
def test_any_bytes_are_read_or_refused(content):
    with contextlib.suppress(StudyError):
        assert isinstance(read(content).data, dict)
