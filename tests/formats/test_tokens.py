"""The tokenizer: any numbers in any layout come out as they went in, and tags are told apart."""

import string

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from slamcli.formats.tokens import TokenizedText

TAGS = ("A", "AB", "EDGE_SE2", "EDGE_SE2_XY", "VERTEX_SE3:QUAT", "ÄÖ")
BOM = b"\xef\xbb\xbf"
NO_LINES = np.empty(0, dtype=np.intp)

doubles = st.floats(allow_nan=False, allow_infinity=False)
# what a number may look like, and the number
written_numbers = st.one_of(
    doubles.map(lambda x: (repr(x), x)),
    doubles.map(lambda x: (f"{x:.17E}", x)),
    st.integers(-(2**63), 2**64 - 1).map(lambda i: (str(i), float(i))),
    st.integers(0, 10**9).map(lambda i: (f"+{i}.", float(i))),
    st.integers(0, 999).map(lambda i: (f".{i:03d}", i / 1000)),
)
gaps = st.text(alphabet=" \t\v\f", min_size=1, max_size=3)
margins = st.text(alphabet=" \t", max_size=2)
line_ends = st.sampled_from(["\n", "\r\n", " \n"])
comments = st.text(alphabet=string.ascii_letters + string.digits + " .,#é", max_size=8).map(lambda text: "#" + text)
records = st.tuples(st.sampled_from(TAGS), st.lists(written_numbers, max_size=5))


@st.composite
def texts(draw: st.DrawFn) -> tuple[bytes, list[tuple[int, str, list[float]]]]:
    """A text, and for each record its line, tag and numbers."""
    pieces, expected = [], []
    for line in range(draw(st.integers(0, 8))):
        if draw(st.integers(0, 4)) == 0:
            pieces.append(draw(margins) + draw(st.one_of(st.just(""), comments)))
        else:
            tag, numbers = draw(records)
            text = draw(margins) + tag + "".join(draw(gaps) + written for written, _ in numbers) + draw(margins)
            if draw(st.integers(0, 4)) == 0:
                text += " " + draw(comments)
            pieces.append(text)
            expected.append((line, tag, [number for _, number in numbers]))
        pieces.append(draw(line_ends))
    if pieces and draw(st.booleans()):
        pieces.pop()  # no newline at the end of the file
    data = "".join(pieces).encode()
    return (BOM + data if draw(st.booleans()) else data), expected


@given(texts(), st.sets(st.sampled_from(TAGS)))
def test_numbers_survive_any_layout(case: tuple[bytes, list[tuple[int, str, list[float]]]], wanted: set[str]) -> None:
    data, expected = case
    numbers, rows, bad = TokenizedText(data).parse([tag.encode() for tag in wanted], NO_LINES)
    assert bad == []
    found = [
        (int(line), name.decode(), numbers[offset : offset + count].tolist())
        for name, part in rows.items()
        for line, count, offset in zip(part.lines, part.counts, part.offsets, strict=True)
    ]
    assert sorted(found, key=lambda record: record[0]) == [record for record in expected if record[1] in wanted]


@given(texts())
def test_spans_cut_the_records_out_of_the_text(case: tuple[bytes, list[tuple[int, str, list[float]]]]) -> None:
    data, expected = case
    text = TokenizedText(data)
    starts, stops = text.record_spans()
    cut = [data[a:b].decode() for a, b in zip(starts, stops, strict=True) if a < b]
    tags = [tag for _, tag, _ in expected]
    assert [piece.split()[0] for piece in cut] == tags
    assert all(piece == piece.strip(" \t\r\n\v\f") and " #" not in piece for piece in cut)
    assert [text.line(line).split()[0] for line, _, _ in expected] == [tag for _, tag, _ in expected]


@given(
    st.text(alphabet="AB", min_size=1, max_size=40),
    st.lists(st.integers(0, 40), min_size=2, max_size=20),
    st.integers(0, 2),
)
def test_long_similar_tags_are_told_apart(stem: str, cuts: list[int], copies: int) -> None:
    """Tags that differ in one character or in length only, repeated and in any order."""
    names = [stem[:cut] + "C" + stem[cut:] for cut in cuts] + [stem, stem + "A", "C" * 63 + "A", "C" * 63 + "B"]
    names += names[::-1] * copies
    found, index = TokenizedText("\n".join(f"{name} 1" for name in names).encode()).tags
    assert [found[k].decode() for k in index] == names
    assert len(found) == len(set(names))


NO_NUMBERS = [
    "nan",
    "inf",
    "-Infinity",
    "1,5",
    "1d0",
    "0x10",
    "1_0",
    "1e999",
    "1.5-2.5",
    "--1",
    "1e",
    ".",
    "+",
    "1.2.3",
]


@pytest.mark.parametrize("token", NO_NUMBERS)
def test_what_is_no_finite_number(token: str) -> None:
    """Also where a lenient parser sees two numbers, and the count would come out right in the end."""
    for data in (f"T 7 {token} 8\nT 1\n", f"T 1\nT 7 {token}", f"T 7 {token} # {token}\r\nU nan\n"):
        text = TokenizedText(data.encode())
        numbers, rows, bad = text.parse([b"T"], NO_LINES)
        assert [defect.text for defect in bad] == [token]
        assert text.column(bad[0].line, bad[0].offset) == 5
        assert text.line(bad[0].line).startswith(f"T 7 {token}")
        assert (len(numbers), rows) == (0, {})
        _, rows, bad = text.parse([b"T"], np.array([bad[0].line]))
        assert bad == []


@settings(max_examples=200)
@given(st.binary(max_size=60))
def test_any_bytes_at_all(data: bytes) -> None:
    """No input makes the tokenizer fail; lines and tokens are those of a plain split."""
    text = TokenizedText(data)
    body = data.removeprefix(BOM).split(b"\n")
    lines = body[:-1] if body[-1] == b"" else body
    plain = [line.split() for line in lines]  # bytes.split() knows the same white space
    assert text.lines == len(lines)
    uncommented = [[t for k, t in enumerate(line) if not any(u[:1] == b"#" for u in line[: k + 1])] for line in plain]
    assert text.counts.tolist() == [len(line) for line in uncommented]
    names, index = text.tags
    assert [names[k] for k in index if k >= 0] == [line[0] for line in uncommented if line]
    wanted = {line[0] for line in uncommented if line}
    numbers, _, bad = text.parse(wanted, NO_LINES)
    assert len(bad) > 0 or len(numbers) == sum(len(line) - 1 for line in uncommented if line)


@pytest.mark.parametrize("damage", [b"\x00", b"\x01", b"\x15", b"\x1a", b"\x1f", b'"', b"[", b"{"])
def test_damaged_bytes_spoil_their_token(damage: bytes) -> None:
    """A flipped bit must not split a number in two or vanish, and JSON's other values are no numbers."""
    for token in (b"1.2" + damage, damage + b"5", b"1" + damage + b"5"):
        _, _, bad = TokenizedText(b"T 7 " + token + b" 3\nT 8 1 2\n").parse([b"T"], NO_LINES)
        assert [one.line for one in bad] == [0]
    _, _, bad = TokenizedText(b'T 7 "1.5" 3\n').parse([b"T"], NO_LINES)
    assert [one.text for one in bad] == ['"1.5"']
