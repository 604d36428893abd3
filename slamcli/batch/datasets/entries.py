"""What the registry knows about a data set."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field

#: Which reader of slamcli takes a data set, so that its counts can be checked: that of graphs, that of sensor logs,
#: or none, in which case only the lines are counted.
READERS = ("graph", "log", "lines")

#: The conventions in which an optimum may be stated.
CONVENTIONS = {
    "g2o": "sum of e^T Omega e with g2o's error definitions, all quaternions normalized",
    "toro": "sum of e^T Omega e with TORO's error, in the frame of the first pose of an edge",
    "chordal": "SE-Sync's cost: isotropic weights, chordal distance of rotations",
    "pixels": "sum of squared reprojection errors in pixels, twice the cost that Ceres prints",
}


@dataclass(frozen=True)
class FileEntry:
    """One file of a data set.

    Attributes
    ----------
    path
        Relative to a folder of the search path and to a mirror, with ``/``.
    sha256
        64 hexadecimal digits.
    bytes
        Its size.
    """

    path: str
    sha256: str
    bytes: int


@dataclass(frozen=True)
class Source:
    """Where the files were taken from.

    Attributes
    ----------
    repository
        ``owner/name`` on GitHub, or what else says where.
    path
        The file there; empty where the project made it itself.
    licence
        What the repository says, and what is said about the data.
    obtained
        What was done to the file of the source: nothing, unpacked, converted and how.
    """

    repository: str
    path: str
    licence: str
    obtained: str


@dataclass(frozen=True)
class Optimum:
    """The lowest cost that is known.

    Attributes
    ----------
    chi2
        The cost, without a factor of one half.
    convention
        A key of ``CONVENTIONS``.
    source
        Who found it, and how.
    """

    chi2: float
    convention: str
    source: str


@dataclass(frozen=True)
class DatasetEntry:
    """One data set: a file, or a folder of the files of one sensor log.

    Attributes
    ----------
    name
        Unique, whatever the case of its letters.
    aliases
        Other names; one that several data sets carry is ambiguous and names none of them.
    group
        The registry file that it stands in.
    about
        What it is, in a sentence or two.
    path
        Of the file, or of the folder, relative as in ``FileEntry``.
    files
        The files; one of the same path for a data set of one file.
    format
        ``g2o``, ``TORO``, ``BAL``, ``iSAM``, ...
    dialect
        What is special about this file within its format, or an empty text.
    reader
        One of ``READERS``.
    counts
        Poses, landmarks, edges, ..., or lines, as slamcli counts them.
    source
        Where it comes from.
    start
        chi2 at the values in the file, if there are any, in the convention of the optimum.
    optimum
        The lowest known cost, if one is known.
    chordal_optimum
        The certified lowest cost of SE-Sync's objective, if it is known.
    """

    name: str
    group: str
    about: str
    path: str
    files: tuple[FileEntry, ...]
    format: str
    reader: str
    source: Source
    aliases: tuple[str, ...] = ()
    dialect: str = ""
    counts: dict[str, int] = field(default_factory=dict)
    start: float | None = None
    optimum: Optimum | None = None
    chordal_optimum: Optimum | None = None

    @property
    def bytes(self) -> int:
        """Size of all files."""
        return sum(file.bytes for file in self.files)

    @property
    def is_folder(self) -> bool:
        """Whether the data set is a folder of several files."""
        return len(self.files) != 1 or self.files[0].path != self.path

    @property
    def sha256(self) -> str:
        """Hash of the file; of a folder, that of the text that ``sha256sum`` prints for its files, in their order."""
        if not self.is_folder:
            return self.files[0].sha256
        listing = "".join(f"{file.sha256}  {file.path}\n" for file in self.files)
        return hashlib.sha256(listing.encode()).hexdigest()

    def summary(self) -> str:
        """The counts in words: ``943 poses, 1837 edges``."""
        shown = [f"{count} {name}" for name, count in self.counts.items() if count and name != "loop_closures"]
        return ", ".join(shown) or "empty"

    def mentions(self, word: str) -> bool:
        """Whether a name, the path or the description holds a word, whatever the case of its letters."""
        texts = (self.name, self.path, self.about, *self.aliases)
        return any(word.casefold() in text.casefold() for text in texts)
