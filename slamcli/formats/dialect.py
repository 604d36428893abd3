"""What a text dialect is: its tags, and how the numbers behind a tag become values, measurements and information."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from slamcli.models import FactorKind, VariableKind
from slamcli.models.base import Array
from slamcli.models.information import from_upper_triangle, to_upper_triangle

Decode = Callable[[FactorKind, Array, Array], tuple[Array, Array]]
Encode = Callable[[FactorKind, Array, Array], tuple[Array, Array]]


def _same(values: Array) -> Array:
    return values


def decode_upper_triangle(kind: FactorKind, measurement: Array, numbers: Array) -> tuple[Array, Array]:
    """Measurement as it stands; information as the upper triangle, row by row, in the residual's order."""
    return kind.normalize(measurement), from_upper_triangle(numbers, kind.dimension)


def encode_upper_triangle(kind: FactorKind, measurement: Array, information: Array) -> tuple[Array, Array]:
    """Inverse of ``decode_upper_triangle``."""
    return measurement, to_upper_triangle(information)


@dataclass(frozen=True)
class VertexTag:
    """``TAG id numbers``: one variable.

    Attributes
    ----------
    tag
        As in the file.
    kind
        Kind of the variable.
    numbers
        How many numbers follow the id.
    decode, encode
        Between the file's numbers (n, numbers) and values (n, kind.size).
    defaults
        Of the last of the numbers, which may be left out (all of them together).
    """

    tag: str
    kind: VariableKind
    numbers: int
    decode: Callable[[Array], Array] = _same
    encode: Callable[[Array], Array] = _same
    defaults: tuple[float, ...] = ()

    @property
    def allowed_counts(self) -> tuple[int, ...]:
        """How many numbers may follow the tag."""
        full = 1 + self.numbers
        return (full, full - len(self.defaults)) if self.defaults else (full,)

    @property
    def layout(self) -> str:
        """What a record looks like."""
        return f"{self.tag} id and {self.numbers} numbers"


@dataclass(frozen=True)
class EdgeTag:
    """``TAG ids [parameter id] measurement information``: one factor.

    Attributes
    ----------
    tag
        As in the file.
    kind
        Kind of the factor.
    measurement
        How many numbers the measurement has in the file.
    optional_information
        Whether single records may leave out the information matrix, which means the identity (see
        ``Dialect.bare_edges`` for whole files without).
    decode, encode
        Between the file's measurement and information numbers and those of the factor kind.
    """

    tag: str
    kind: FactorKind
    measurement: int
    optional_information: bool = False
    decode: Decode = decode_upper_triangle
    encode: Encode = encode_upper_triangle

    @property
    def ids(self) -> int:
        """Ids in front of the measurement, the parameter's included."""
        return len(self.kind.variables) + (self.kind.parameter is not None)

    @property
    def information(self) -> int:
        """Numbers of the information's upper triangle."""
        return self.kind.dimension * (self.kind.dimension + 1) // 2

    @property
    def without_information(self) -> int:
        """How many numbers follow the tag of a record without an information matrix."""
        return self.ids + self.measurement

    @property
    def allowed_counts(self) -> tuple[int, ...]:
        """How many numbers may follow the tag."""
        full = self.without_information + self.information
        return (full, self.without_information) if self.optional_information else (full,)

    @property
    def layout(self) -> str:
        """What a record looks like."""
        ids = " ".join(["id"] * len(self.kind.variables) + ["parameter-id"] * (self.kind.parameter is not None))
        return (
            f"{self.tag} {ids}, {self.measurement} numbers of the measurement, "
            f"{self.information} of the information's upper triangle"
        )


@dataclass(frozen=True)
class ParameterTag:
    """``TAG id numbers``: a constant that edges refer to."""

    tag: str
    kind: VariableKind

    @property
    def allowed_counts(self) -> tuple[int, ...]:
        """How many numbers may follow the tag."""
        return (1 + self.kind.size,)

    @property
    def layout(self) -> str:
        """What a record looks like."""
        return f"{self.tag} id and {self.kind.size} numbers"


@dataclass(frozen=True)
class Dialect:
    """A text format: a table of tags.

    Where several tags stand for one kind, the writer uses the first. ``unused`` says of known tags why their records
    are only kept. With ``bare_edges`` a tag may lack its information in all of its records (not in some of them: those
    are cut off), which then is the identity.
    """

    name: str
    vertices: tuple[VertexTag, ...]
    edges: tuple[EdgeTag, ...]
    parameters: tuple[ParameterTag, ...] = ()
    fix: str | None = None
    unused: dict[str, str] = field(default_factory=dict)
    bare_edges: bool = False

    @property
    def records(self) -> tuple[VertexTag | EdgeTag | ParameterTag, ...]:
        """All tags of records that hold numbers only."""
        return self.vertices + self.edges + self.parameters

    @property
    def tags(self) -> frozenset[str]:
        """The words of ``records``."""
        return frozenset(record.tag for record in self.records)

    def vertex_tag(self, kind: VariableKind) -> VertexTag | None:
        """The tag that writes variables of a kind, None if the dialect has none."""
        return next((record for record in self.vertices if record.kind is kind), None)

    def edge_tag(self, kind: FactorKind) -> EdgeTag | None:
        """The tag that writes factors of a kind, None if the dialect has none."""
        return next((record for record in self.edges if record.kind is kind), None)
