"""The table of a reach, from the geometry: which cells block which sector of which cell (paper, Appendix A).

G denotes the cells, S the sectors, W the words of a board, whose bit c % 64 of word c // 64 stands for cell c.
"""

from __future__ import annotations

import math

import numpy as np

EDGE_RAD = 1e-9
"""A sector that lies this near an obstacle's edge counts as covered, so that rounding never decides."""
CHUNK = 64
"""Cells whose part of the table is computed at once, for memory's sake."""


def evenly(half_fan_deg: float, n_sectors: int) -> np.ndarray:
    """Float64[S]: sectors from -half_fan_deg to half_fan_deg, those of either side mirror images to the last bit."""
    steps = 2 * half_fan_deg / (n_sectors - 1) * np.arange(n_sectors)
    left = np.arange(n_sectors) < n_sectors // 2
    return np.where(left, -half_fan_deg + steps, half_fan_deg - steps[::-1])


def pack(occupied: np.ndarray) -> np.ndarray:
    """Bool[..., G] -> uint64[..., W]."""
    packed = np.packbits(occupied, axis=-1, bitorder="little")
    missing = -packed.shape[-1] % 8
    return np.pad(packed, [(0, 0)] * (packed.ndim - 1) + [(0, missing)]).view(np.uint64)


def unpack(words: np.ndarray, n_cells: int) -> np.ndarray:
    """uint64[..., W] -> uint8[..., G] of 0 and 1."""
    return np.unpackbits(np.ascontiguousarray(words).view(np.uint8), axis=-1, count=n_cells, bitorder="little")


def blockers(centres: np.ndarray, sectors_deg: np.ndarray, clearance_m: float) -> np.ndarray:
    """uint64[G, S, W]: the cells on which an obstacle covers a sector of each of Float64[G, 2] centres."""
    chunks = np.split(np.arange(len(centres)), range(CHUNK, len(centres), CHUNK))
    return np.concatenate([pack(_covered_from(cells, centres, sectors_deg, clearance_m)) for cells in chunks])


def _covered_from(cells: np.ndarray, centres: np.ndarray, sectors_deg: np.ndarray, clearance_m: float) -> np.ndarray:
    """Bool[C, S, G]: whether an obstacle on cell k covers sector s of Int64[C] cells."""
    dx, dy = (centres[None] - centres[cells, None]).transpose(2, 0, 1)
    half_width = np.arcsin(np.minimum(clearance_m / np.maximum(np.hypot(dx, dy), 1e-12), 1.0))
    to_base = np.arctan2(-centres[cells, 1], -centres[cells, 0])
    off = (np.arctan2(dy, dx) - to_base[:, None])[:, None] - np.radians(sectors_deg)[:, None]
    off -= math.tau * np.round(off / math.tau)
    covered = np.abs(off) <= half_width[:, None] + EDGE_RAD
    return covered & (cells[:, None] != np.arange(len(centres)))[:, None]


def followed(
    centres: np.ndarray,
    sectors_deg: np.ndarray,
    staging_x: float,
    lateral_limit_m: float | None,
    max_yaw_deg: float | None,
) -> np.ndarray:
    """Bool[G, S]: the corridors the arm itself can follow, whatever stands on the board; see `Reach`."""
    x, y = centres.T[:, :, None]
    heading = np.arctan2(y, x) + np.radians(sectors_deg)
    allowed = np.ones_like(heading, dtype=np.bool_)
    if max_yaw_deg is not None:
        allowed &= np.abs(heading) <= math.radians(max_yaw_deg) + EDGE_RAD
    if lateral_limit_m is not None:
        crossing = y - (x - staging_x) * np.tan(heading)
        allowed &= (np.cos(heading) > 0) & (np.abs(crossing) <= lateral_limit_m + EDGE_RAD)
    return allowed


def undominated(blocking: np.ndarray, allowed: np.ndarray) -> np.ndarray:
    """uint64[D, G, W]: for each cell, the sets of cells that must be empty for one of its corridors to be free.

    A set that contains another is left out: its corridor is free only where the other one is. Cells with fewer than
    D sets repeat one; a cell that no corridor leads to has the full board.

    Args:
        blocking: uint64[G, S, W], as of `blockers`. allowed: Bool[G, S], the sectors that the arm can follow.
    """
    n_cells = len(blocking)
    every = (1 << 8 * -(-n_cells // 8)) - (1 << -n_cells % 8)
    kept = [_smallest(unpack(sets[there], n_cells)) or [every] for sets, there in zip(blocking, allowed, strict=True)]
    most, n_bytes = max(map(len, kept)), -(-n_cells // 8)
    padded = [[*sets, *[sets[-1]] * (most - len(sets))] for sets in kept]
    data = b"".join(one.to_bytes(n_bytes, "big") for sets in padded for one in sets)
    bits = np.unpackbits(np.frombuffer(data, np.uint8).reshape(n_cells, most, n_bytes), axis=-1, count=n_cells)
    return pack(bits).transpose(1, 0, 2).copy()


def _smallest(sets: np.ndarray) -> list[int]:
    """Those of uint8[N, G] sets that contain no other, each once, in order; as numbers whose first bit is cell 0."""
    found = sorted({int.from_bytes(row.tobytes(), "big") for row in np.packbits(sets, axis=-1)})
    return [one for one in found if not any(other & one == other != one for other in found)]
