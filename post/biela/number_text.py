"""The numbers of results files, many times faster than by float(): the solver writes all of them with the same width and form.

A word such as b' -1.2345678901234567E-003' has its digits at fixed places. Eight digits at a time are turned into a number by
three multiplications of the 64-bit word that they are (D. Lemire, Number parsing at a gigabyte per second, 2021).
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

WIDTH = 24  # of the letters of a number; blanks may stand before them
FIELDS = np.dtype(
    {
        "names": ["head", "high", "low", "tail"],
        "formats": ["<u4", "<u8", "<u8", "<u8"],
        "offsets": [0, 3, 11, 16],
        "itemsize": WIDTH,
    }
)
POWERS = np.array([float(f"1e{k}") for k in range(-324, 309)])
PART = 200_000  # numbers that are turned at a time: enough that threads seldom wait for each other, few enough for the cache
REUSED = 16_000_000  # bytes: the C library keeps freed memory of twice the largest block that was given back, else 128 kB


def numbers(words: np.ndarray) -> np.ndarray:
    """Return the numbers of words of the type S24 or wider, to an ulp or two; nan where one has another form, or is no number."""
    spare = words.dtype.itemsize - WIDTH
    letters = np.ascontiguousarray(words).view(np.uint8).reshape(-1, words.dtype.itemsize)
    found = np.empty(len(letters))
    with np.errstate(invalid="ignore"):
        for first in range(0, len(letters), PART):
            found[first : first + PART] = _part(letters[first : first + PART], spare)
    return found.reshape(words.shape)


def _part(letters: np.ndarray, spare: int) -> np.ndarray:
    """Return the numbers of some words."""
    field = np.ascontiguousarray(letters[:, spare:]).view(FIELDS)[:, 0]
    (high, good), (low, fine) = _eight(field["high"]), _eight(field["low"])
    head, tail = field["head"].astype(np.uint32), field["tail"].astype(np.uint64) >> np.uint64(24)  # ' 1.', 'E-003'
    sign, mark = head & np.uint32(0xFF), (tail & np.uint64(0xFFFF)).astype(np.int64)
    first = ((head >> np.uint32(8)) & np.uint32(0xFF)) - np.uint32(48)
    tens = (tail >> np.uint64(16)).astype(np.int64) ^ 0x303030
    power = 100 * (tens & 0xFF) + 10 * (tens >> 8 & 0xFF) + (tens >> 16)
    negative, down = sign == ord("-"), mark == ord("E") + 256 * ord("-")
    good &= fine & (first <= 9) & ((tens + 0x767676 | tens) & 0x808080 == 0) & (head & np.uint32(0xFF0000) == ord(".") << 16)
    good &= (negative | (sign == ord(" "))) & (down | (mark == ord("E") + 256 * ord("+"))) & (power <= 308 + 16 * down)
    if spare:
        good &= (letters[:, :spare] == ord(" ")).all(axis=1)
    power = np.where(good, np.where(down, -power, power), 0)
    size = (1.0e8 * (1.0e8 * first + high) + low) * 1.0e-16 * POWERS[power + 324]
    size = np.where(good, size, np.nan)
    return np.where(negative, -size, size)


def _eight(words: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers of eight digits each, and whether all eight are digits."""
    x = words.astype(np.uint64) ^ np.uint64(0x3030303030303030)  # the digits themselves where they were digits
    good = ((x + np.uint64(0x7676767676767676)) | x) & np.uint64(0x8080808080808080) == 0
    x = (x * np.uint64(10) + (x >> np.uint64(8))) & np.uint64(0x00FF00FF00FF00FF)
    x = (x * np.uint64(100) + (x >> np.uint64(16))) & np.uint64(0x0000FFFF0000FFFF)
    x = (x * np.uint64(10000) + (x >> np.uint64(32))) & np.uint64(0xFFFFFFFF)
    return x.astype(np.float64), good


def read_rows(path: Path, first: int, width: int) -> np.ndarray | None:
    """Return the rows of so many numbers from a byte of a file on; None where the solver has not written them as it does."""
    with path.open("rb") as file:
        file.seek(first)
        line = len(file.readline())
        size = (os.fstat(file.fileno()).st_size - first) // max(line, 1)
    word = (line - 1) // max(width, 1)
    if not size or word < WIDTH or line != word * width + 1 or path.stat().st_size - first != size * line:
        return None
    found = np.empty((size, width), order="F")
    workers = os.cpu_count() or 1
    share = max(-(-size // workers), PART // width)

    def fill(begin: int) -> bool:
        """Fill a share of the rows; the memory of a part is used again, as to get it anew costs more than the numbers."""
        rows = max(1, min(PART // width, share))
        part = np.empty(rows, np.dtype([("words", f"S{word}", (width,)), ("end", "S1")]))
        end = min(begin + share, size)
        with path.open("rb", buffering=0) as file:
            file.seek(first + begin * line)
            for k in range(begin, end, rows):
                part = part[: end - k]
                if file.readinto(part.view(np.uint8)) != part.nbytes or not (part["end"] == b"\n").all():
                    return False
                values = numbers(part["words"])
                found[k : k + len(part)] = values
                if not np.isfinite(values).all():
                    return False
        return True

    np.empty(REUSED, np.uint8)  # freed at once: the memory of one part is used again for the next, which saves a third of the time
    with ThreadPoolExecutor(workers) as pool:
        return found if all(pool.map(fill, range(0, size, share))) else None
