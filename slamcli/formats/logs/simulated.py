"""The logs that ``slamcli simulate --log`` writes; ``formats.log`` says what their columns are.

A relative pose of two neighbours (``odometry`` with its information) is a step. ``velocity`` and ``odometry`` records
without information are the controls behind it: they are taken where they lead to the same displacements.
``differential`` ones are not: the log does not say how far apart the wheels are.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from slamcli.errors import InputError
from slamcli.formats.diagnostics import Diagnostic, ParseError
from slamcli.formats.logs.timeline import counted
from slamcli.formats.tables import skipped_notes
from slamcli.geometry import se2, so2
from slamcli.graph.columns import IdArray
from slamcli.graph.sensor_log import Observations, SensorLog
from slamcli.graph.trajectory import Trajectory
from slamcli.models import BEARING_2D, POINT_OBSERVATION_2D, RANGE_2D, RANGE_BEARING_2D, FactorKind
from slamcli.models.base import Array
from slamcli.models.information import from_upper_triangle
from slamcli.models.motion import MOTION_MODELS

HEADER = (b"time_s", b"kind", b"pose", b"other")
_SENSORS: dict[bytes, FactorKind] = {
    b"xy": POINT_OBSERVATION_2D,
    b"range-bearing": RANGE_BEARING_2D,
    b"bearing": BEARING_2D,
    b"range": RANGE_2D,
}
_CONTROLS = {b"velocity": 3, b"odometry": 3, b"differential": 2}
#: Numbers of a reading of each kind.
_SIZES = {b"closure": 3, b"gps": 2} | _CONTROLS | {word: kind.measurement_size for word, kind in _SENSORS.items()}
#: Metres and radians by which a control may miss the relative pose beside it: the log has nine decimals.
_TOLERANCE = 1e-6
_LARGEST_ID = 2.0**53  # from here on a float does not hold it
_NUMBER = re.compile(rb"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\Z")


@dataclass(frozen=True, eq=False)
class _Block:
    """The records of a kind: times (m,), poses (m,), others (m,), readings (m, k), information (m, d, d) or None."""

    times: Array
    poses: IdArray
    others: IdArray
    readings: Array
    information: Array | None
    lines: list[int]

    def order(self) -> _Block:
        """In the order of the poses."""
        rows = np.argsort(self.poses, kind="stable")
        information = None if self.information is None else self.information[rows]
        lines = [self.lines[k] for k in rows.tolist()]
        return _Block(self.times[rows], self.poses[rows], self.others[rows], self.readings[rows], information, lines)


#: By kind and by whether there is information.
_Blocks = dict[tuple[bytes, bool], _Block]


def recognizes(record: bytes) -> bool:
    """Whether a file's first record is the head of such a log."""
    return tuple(cell.strip() for cell in record.split(b",")[:4]) == HEADER


def read(path: str, data: bytes, *, lenient: bool = False, truth: Trajectory | None = None) -> SensorLog:
    """Read a log.

    Parameters
    ----------
    path, data
        Its file and what it holds.
    lenient
        Skip malformed records instead of raising.
    truth
        Where the robot starts: at the true pose of its first id, or time. Without it, at the origin.

    Raises
    ------
    InputError
        If the file is not such a log, or of a spatial simulation; ``ParseError`` with a diagnostic for each malformed
        record.
    """
    blocks, skipped = _Reader(path, data, lenient).blocks()
    steps = blocks.get((b"odometry", True)) or next(
        (blocks[word, False] for word in (b"odometry", b"velocity") if (word, False) in blocks), None
    )
    if steps is None:
        raise InputError(f"{path}: holds no odometry", ("  expected records of the kind odometry or velocity",))
    steps = steps.order()
    poses, times = _chain(path, steps, blocks)
    model, controls, notes = _controls(blocks, steps, times)
    observations = _observations(path, blocks, poses)
    start, where = _start(truth, int(poses[0]), float(times[0]))
    clutter = sum(np.count_nonzero(one.landmarks < 0) for one in observations)
    left_out = {word.decode(): len(block.poses) for (word, _), block in blocks.items() if word in (b"closure", b"gps")}
    return SensorLog(
        times=times,
        ids=poses,
        model=model,
        controls=controls,
        information=steps.information,
        observations=observations,
        start=start,
        source=path,
        notes=[
            *skipped_notes(path, skipped),
            *notes,
            where,
            *counted(clutter, "readings come from nothing (landmark -1)"),
            *(f"{count} {word} records are left out" for word, count in left_out.items()),
        ],
    )


class _Reader:
    """Records by kind, with what is wrong with the others."""

    def __init__(self, path: str, data: bytes, lenient: bool) -> None:
        self.path = path
        self.lenient = lenient
        self.defects: list[Diagnostic] = []
        data = data.removeprefix(b"\xef\xbb\xbf")
        self.lines = data.splitlines()
        used = [k for k, line in enumerate(self.lines) if line.partition(b"#")[0].strip()]
        self.heads = [cell.strip() for cell in self.lines[used[0]].split(b",")] if used else []
        if tuple(self.heads[:4]) != HEADER:
            raise InputError(f"{path}: expected a head of {b','.join(HEADER).decode()},z1,...,i11,...")
        self.records = used[1:]
        self.first_weight = 4 + sum(head.startswith(b"z") for head in self.heads)
        self.strange = b"_" in data[data.index(HEADER[-1]) :]  # Python takes 1_0 for a number

    def blocks(self) -> tuple[_Blocks, list[str]]:
        """The blocks and messages of the records that were skipped."""
        groups: dict[tuple[bytes, bool], list[tuple[int, list[bytes]]]] = {}
        for line in self.records:
            cells = self.lines[line].partition(b"#")[0].split(b",")
            if len(cells) != len(self.heads):
                self._defect(line, 0, f"expected {len(self.heads)} cells between commas, found {len(cells)}")
                continue
            weighted = self.first_weight < len(cells) and bool(cells[self.first_weight].strip())
            groups.setdefault((cells[1].strip(), weighted), []).append((line, cells))
        out = {}
        for (word, weighted), rows in groups.items():
            spatial = word == b"odometry" and self.first_weight > 7 and any(rows[0][1][7 : self.first_weight])
            if word == b"point" or spatial:
                raise InputError(f"{self.path}: is the log of a spatial simulation, expected a planar one")
            if word not in _SIZES:
                for line, _ in rows:
                    known = ", ".join(sorted(known.decode() for known in _SIZES))
                    self._defect(
                        line, 1, f"expected a kind of record ({known}), found {word.decode(errors='replace')!r}"
                    )
                continue
            out[word, weighted] = self._block(word, weighted, rows)
        if self.defects and not self.lenient:
            raise ParseError(sorted(self.defects, key=lambda defect: (defect.line, defect.column)))
        return {key: block for key, block in out.items() if len(block.poses)}, [str(one) for one in self.defects]

    def _block(self, word: bytes, weighted: bool, rows: list[tuple[int, list[bytes]]]) -> _Block:
        size = _SIZES[word]
        dimension = size if weighted else 0
        weights = dimension * (dimension + 1) // 2
        wanted = [0, 2, *([] if word == b"gps" else [3])]
        wanted += [*range(4, 4 + size), *range(self.first_weight, self.first_weight + weights)]
        wanted = [column for column in wanted if column < len(self.heads)]
        empty = [column for column in range(3, len(self.heads)) if column not in wanted]
        try:
            numbers = np.array([[float(cells[k]) for k in wanted] for _, cells in rows])
            fine = not self.strange and bool(np.isfinite(numbers).all())
            ids = numbers[:, 1 : 2 if word == b"gps" else 3]
            fine = fine and bool(((ids == np.rint(ids)) & (np.abs(ids) < _LARGEST_ID)).all())
            fine = fine and not any(cells[k].strip() for _, cells in rows for k in empty)
        except ValueError:
            fine = False
        if not fine:
            rows = [row for row in rows if self._checked(word, *row, wanted, empty)]
            numbers = np.array([[float(cells[k]) for k in wanted] for _, cells in rows]).reshape(-1, len(wanted))
        first = 2 if word == b"gps" else 3
        others = np.full(len(rows), -1) if word == b"gps" else numbers[:, 2]
        return _Block(
            times=numbers[:, 0],
            poses=numbers[:, 1].astype(np.int64),
            others=others.astype(np.int64),
            readings=numbers[:, first : first + size],
            information=from_upper_triangle(numbers[:, first + size :], dimension) if weighted else None,
            lines=[line for line, _ in rows],
        )

    def _checked(self, word: bytes, line: int, cells: list[bytes], wanted: list[int], empty: list[int]) -> bool:
        """Whether a record is well formed; what is wrong with it is noted."""
        name = word.decode()
        for k in range(len(cells)):
            cell, head = cells[k].strip(), self.heads[k].decode(errors="replace")
            if k in empty and cell:
                return self._defect(line, k, f"expected an empty cell in the column {head} of a record {name}")
            if k in wanted and not cell:
                return self._defect(line, k, f"expected a number in the column {head} of a record {name}")
            if k in wanted and not (_NUMBER.match(cell) and np.isfinite(float(cell))):
                found = cell.decode(errors="replace")
                return self._defect(line, k, f"expected a finite number in the column {head}, found {found!r}")
            if k in wanted and k in (2, 3) and not (float(cell).is_integer() and abs(float(cell)) < _LARGEST_ID):
                return self._defect(line, k, f"expected an id, a whole number, in the column {head}")
        return True

    def _defect(self, line: int, cell: int, message: str) -> bool:
        text = self.lines[line]
        column = 1 + sum(len(part) + 1 for part in text.split(b",")[:cell])
        self.defects.append(Diagnostic(self.path, line + 1, column, message, text.decode("utf-8", "replace")))
        return False


def _chain(path: str, steps: _Block, blocks: _Blocks) -> tuple[IdArray, Array]:
    """Ids and times of the poses that the odometry goes through, one after the other."""
    poses = np.concatenate([steps.others[:1], steps.poses])
    broken = np.flatnonzero(steps.others != poses[:-1])
    if len(broken):
        k = int(broken[0])
        raise InputError(
            f"{path}:{steps.lines[k] + 1}: the odometry leads from pose {steps.others[k]} to {steps.poses[k]}, "
            f"expected a step from pose {poses[k]}",
            ("  every pose of a log is reached from the one before it, once",),
        )
    back = np.flatnonzero(np.diff(steps.times) < 0.0)
    if len(back):
        line = steps.lines[int(back[0]) + 1] + 1
        raise InputError(f"{path}:{line}: the time goes back, expected the poses in the order of time")
    at_start = [block.times[block.poses == poses[0]] for block in blocks.values()]
    known = np.concatenate(at_start)
    interval = steps.times[1] - steps.times[0] if len(steps.times) > 1 else 1.0
    start = known[0] if len(known) and known[0] <= steps.times[0] else steps.times[0] - interval
    return poses, np.concatenate([[start], steps.times])


def _controls(blocks: _Blocks, steps: _Block, times: Array) -> tuple[str, Array, list[str]]:
    """Model and controls of the steps, and what to say about controls that are not used."""
    weighted = steps.information is not None
    for word in (b"velocity", b"odometry"):
        block = blocks.get((word, False))
        if block is None:
            continue
        name, control = word.decode(), block.order()
        if not weighted:
            return name, control.readings, []
        if np.array_equal(control.poses, steps.poses):
            moved = MOTION_MODELS[name]().displacement(control.readings, np.diff(times))
            miss = moved - steps.readings
            miss[:, 2] = so2.wrap(miss[:, 2])
            if np.abs(miss).max(initial=0.0) < _TOLERANCE:
                return name, control.readings, []
        why = "they do not lead to its relative poses"
        return "body", se2.normalize(steps.readings), [f"the {name} controls of the log are not used: {why}"]
    notes = []
    if (b"differential", False) in blocks:
        notes = ["the differential controls of the log are not used: it does not say how far apart the wheels are"]
    return "body", se2.normalize(steps.readings), notes


def _observations(path: str, blocks: _Blocks, poses: IdArray) -> list[Observations]:
    out = []
    order = np.argsort(poses, kind="stable")
    for (word, _), block in blocks.items():
        if word not in _SENSORS:
            continue
        at = order[np.minimum(np.searchsorted(poses[order], block.poses), len(poses) - 1)]
        wrong = np.flatnonzero(poses[at] != block.poses)
        if len(wrong):
            k = int(wrong[0])
            raise InputError(f"{path}:{block.lines[k] + 1}: no odometry leads to pose {block.poses[k]} of this reading")
        rows = np.argsort(at, kind="stable")
        kind = _SENSORS[word]
        out.append(
            Observations(
                kind=kind,
                steps=at[rows],
                landmarks=np.maximum(block.others[rows], -1),
                measurements=kind.normalize(block.readings[rows]),
                information=None if block.information is None else block.information[rows],
            )
        )
    return out


def _start(truth: Trajectory | None, pose: int, time: float) -> tuple[Array, str]:
    """The pose of step 0, and where it comes from."""
    if truth is None or len(truth) == 0:
        return np.zeros(3), "the start is the origin: the log does not say where the robot starts"
    if truth.ids is not None and (truth.ids == pose).any():
        row = int(np.flatnonzero(truth.ids == pose)[0])
    elif truth.stamps is not None:
        row = int(np.abs(truth.stamps - time).argmin())
    else:
        row = 0
    x, y = truth.positions[row, :2].tolist()
    return np.array([x, y, float(truth.headings()[row])]), "the start is the true pose"
