"""What eliminating an independent set of blocks does to a block pattern: built once, used in every factorization."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from slamcli.graph.columns import BoolArray, IndexArray
from slamcli.solver.block_pieces import BlockPieces
from slamcli.solver.pattern import BlockPattern


@dataclass(frozen=True, eq=False)
class Structure:
    """Positions and pairs.

    H is ``[[A, W], [W^T, V]]`` with V the block diagonal part of what is eliminated ("points") and A of what stays
    ("cameras"). A *link* is a block of W, one camera and one point; links are sorted by camera, then point. Cameras
    smaller than the largest one are padded with zeros.

    Attributes
    ----------
    pattern
        Of H.
    reduced
        Of the Schur complement A - W V^-1 W^T; block k is block ``kept[k]`` of H.
    kept, gone
        Blocks of H that stay and those that are eliminated, ascending.
    size, width
        Rows of a point's block, and of the largest camera that sees one.
    points
        (size, size, p) positions of the entries of V among the values of H.
    links
        For each camera its blocks (size, width) of W^T.
    camera, point
        (m,) of each link.
    left, right
        (q,) links of one point, of an earlier and of a later camera, sorted by the block of the complement that their
        product goes to.
    runs
        (b + 1,) where the pairs of each of those blocks begin.
    targets
        (b, width, width) positions of their entries among the values of the complement, ``reduced.stored`` for padding.
    from_hessian, to_reduced
        Positions of the entries of A in H, and in the complement.
    """

    pattern: BlockPattern
    reduced: BlockPattern
    kept: IndexArray
    gone: IndexArray
    size: int
    width: int
    points: IndexArray
    links: list[BlockPieces]
    camera: IndexArray
    point: IndexArray
    left: IndexArray
    right: IndexArray
    runs: IndexArray
    targets: IndexArray
    from_hessian: IndexArray
    to_reduced: IndexArray

    @cached_property
    def kept_rows(self) -> IndexArray:
        """Scalar rows of H that stay, in the order of the complement's."""
        return _scalar_rows(self.pattern, self.kept)

    @cached_property
    def gone_rows(self) -> IndexArray:
        """(p, size) scalar rows of H that are eliminated."""
        return _scalar_rows(self.pattern, self.gone).reshape(len(self.gone), self.size)

    @cached_property
    def camera_rows(self) -> IndexArray:
        """(c, width) scalar rows of each camera in the complement, its dimension for padding."""
        reduced = self.reduced
        inside = np.arange(self.width) < reduced.sizes[:, None]
        return np.where(inside, reduced.offsets[:-1, None] + np.arange(self.width), reduced.dimension)

    @cached_property
    def camera_runs(self) -> IndexArray:
        """(c + 1,) where the links of each camera begin."""
        return np.searchsorted(self.camera, np.arange(len(self.kept) + 1))

    @cached_property
    def diagonal_targets(self) -> IndexArray:
        """(c, width, width) positions of the entries of its diagonal blocks, ``reduced.stored`` for padding."""
        return _padded(self.reduced, np.flatnonzero(self.reduced.rows == self.reduced.columns), self.width)

    @classmethod
    def of(cls, pattern: BlockPattern, eliminated: BoolArray) -> Structure:
        """The structure for a mask (n,) of blocks, which must be of one size and have no block in common."""
        gone, kept = np.flatnonzero(eliminated), np.flatnonzero(~eliminated)
        size = int(pattern.sizes[gone[0]])
        local = np.empty(len(eliminated), dtype=np.intp)
        local[gone], local[kept] = np.arange(len(gone)), np.arange(len(kept))
        row_gone, column_gone = eliminated[pattern.rows], eliminated[pattern.columns]
        crossing = np.flatnonzero(row_gone != column_gone)
        upright = column_gone[crossing]  # the block has the rows of the camera
        camera = local[np.where(upright, pattern.rows[crossing], pattern.columns[crossing])]
        point = local[np.where(upright, pattern.columns[crossing], pattern.rows[crossing])]
        order = np.lexsort((point, camera))
        crossing, upright, camera, point = crossing[order], upright[order], camera[order], point[order]
        width = int(pattern.sizes[kept][camera].max(initial=1))
        left, right = _pairs(point, camera)
        keys = camera[right] * len(kept) + camera[left]
        by_block = np.argsort(keys.astype(np.min_scalar_type(len(kept) ** 2)), kind="stable")  # small ones sort faster
        left, right, keys = left[by_block], right[by_block], keys[by_block]
        runs = np.concatenate([[0], np.flatnonzero(np.diff(keys)) + 1, [len(keys)]])
        inner = np.flatnonzero(~row_gone & ~column_gone)
        own = local[pattern.columns[inner]] * len(kept) + local[pattern.rows[inner]]
        made = keys[runs[:-1]] if len(keys) else keys
        together = np.union1d(own, made)
        columns, rows = np.divmod(together, len(kept))
        rank = None if pattern.pose_rank is None else pattern.pose_rank[kept]
        reduced = BlockPattern(pattern.sizes[kept], rows, columns, rank)
        inside_h, inside_r = _inner_positions(pattern, inner, reduced, np.searchsorted(together, own))
        diagonal = np.searchsorted(pattern.columns * len(eliminated) + pattern.rows, gone * (len(eliminated) + 1))
        return cls(
            pattern=pattern,
            reduced=reduced,
            kept=kept,
            gone=gone,
            size=size,
            width=width,
            points=np.ascontiguousarray(_entries(pattern, diagonal, (size, size), None).transpose(1, 2, 0)),
            links=[
                BlockPieces(pattern, crossing[begin:end], (size, width), upright[begin:end])
                for begin, end in pairwise(np.searchsorted(camera, np.arange(len(kept) + 1)).tolist())
            ],
            camera=camera,
            point=point,
            left=left,
            right=right,
            runs=runs if len(keys) else np.zeros(1, dtype=np.intp),
            targets=_padded(reduced, np.searchsorted(together, made), width),
            from_hessian=inside_h,
            to_reduced=inside_r,
        )


def _scalar_rows(pattern: BlockPattern, blocks: IndexArray) -> IndexArray:
    sizes = pattern.sizes[blocks]
    within = np.arange(int(sizes.sum())) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    return np.repeat(pattern.offsets[blocks], sizes) + within


def _entries(
    pattern: BlockPattern, blocks: IndexArray, shape: tuple[int, int], transposed: BoolArray | None
) -> IndexArray:
    """Positions (e, *shape) of the entries of stored blocks, of their transposes where that is said."""
    first, height = pattern.base[blocks], pattern.heights[pattern.columns[blocks]]
    flip = np.zeros(len(blocks), dtype=bool) if transposed is None else transposed
    down, right = np.where(flip, height, 1), np.where(flip, 1, height)
    rows, columns = np.arange(shape[0])[:, None], np.arange(shape[1])
    return first[:, None, None] + rows * down[:, None, None] + columns * right[:, None, None]


def _padded(reduced: BlockPattern, blocks: IndexArray, width: int) -> IndexArray:
    """Positions (b, width, width) of the entries of blocks of the complement, ``stored`` outside of them."""
    out = _entries(reduced, blocks, (width, width), None)
    inside = np.arange(width)
    out[inside[:, None] >= reduced.sizes[reduced.rows[blocks]][:, None, None] + 0 * inside] = reduced.stored
    out[inside >= reduced.sizes[reduced.columns[blocks]][:, None, None] + 0 * inside[:, None]] = reduced.stored
    return out


def _pairs(point: IndexArray, camera: IndexArray) -> tuple[IndexArray, IndexArray]:
    """All pairs of links of one point; the camera of the first is the earlier one."""
    order = np.lexsort((camera, point))
    ranked = point[order]
    lefts, rights = [order[:0]], [order[:0]]
    distance = 1
    while distance < len(order):
        same = np.flatnonzero(ranked[distance:] == ranked[:-distance])
        if len(same) == 0:
            break
        lefts.append(order[same])
        rights.append(order[same + distance])
        distance += 1
    return np.concatenate(lefts), np.concatenate(rights)


def _inner_positions(
    pattern: BlockPattern, blocks: IndexArray, reduced: BlockPattern, into: IndexArray
) -> tuple[IndexArray, IndexArray]:
    """Positions of the entries of blocks of H, and of the blocks of the complement that they go to."""
    height, width = pattern.sizes[pattern.rows[blocks]], pattern.sizes[pattern.columns[blocks]]
    out: list[tuple[IndexArray, IndexArray]] = []
    for shape in sorted(set(zip(height.tolist(), width.tolist(), strict=True))):
        mine = (height == shape[0]) & (width == shape[1])
        out.append(
            (
                _entries(pattern, blocks[mine], shape, None).ravel(),
                _entries(reduced, into[mine], shape, None).ravel(),
            )
        )
    none = np.empty(0, dtype=np.intp)
    return np.concatenate([none, *(a for a, _ in out)]), np.concatenate([none, *(b for _, b in out)])
