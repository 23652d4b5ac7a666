"""Inputs made of good ones, for where no coverage guides: the same ones for the same seed."""

import re

import numpy as np

_NUMBERS = (
    b"0", b"-1", b"1e308", b"-1e308", b"1e-320", b"nan", b"inf", b"-inf", b"99999999999999999999",
    b"4294967296", b"2147483648", b"0x10", b"1_0", b"", b"\xff", b"[", b"\0",
)  # fmt: skip
_BYTES = (0, 1, 0x7F, 0x80, 0xFF)


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """`data` with one to four changes: bytes, numbers, lines, lengths."""
    for _ in range(rng.integers(1, 5)):
        data = _CHANGES[rng.integers(len(_CHANGES))](data, rng)
    return data


def _flip(data: bytes, rng: np.random.Generator) -> bytes:
    at = rng.integers(max(len(data), 1))
    return data[:at] + bytes([data[at] ^ (1 << rng.integers(8))]) + data[at + 1 :] if data else data


def _put(data: bytes, rng: np.random.Generator) -> bytes:
    """One to eight bytes of an extreme value."""
    at, count = rng.integers(len(data) + 1), rng.integers(1, 9)
    return data[:at] + bytes([_BYTES[rng.integers(len(_BYTES))]] * count) + data[at + count :]


def _cut(data: bytes, rng: np.random.Generator) -> bytes:
    return data[: rng.integers(len(data) + 1)]


def _drop(data: bytes, rng: np.random.Generator) -> bytes:
    low, high = np.sort(rng.integers(len(data) + 1, size=2))
    return data[:low] + data[min(high, low + 40) :]


def _repeat(data: bytes, rng: np.random.Generator) -> bytes:
    low, high = np.sort(rng.integers(len(data) + 1, size=2))
    return data[:high] + data[low:high][:4096] + data[high:]


def _number(data: bytes, rng: np.random.Generator) -> bytes:
    """A number in a text becomes a strange one."""
    found = list(re.finditer(rb"-?\d[\d.e+-]*", data))
    if not found:
        return data
    match = found[rng.integers(len(found))]
    return data[: match.start()] + _NUMBERS[rng.integers(len(_NUMBERS))] + data[match.end() :]


_CHANGES = (_flip, _put, _cut, _drop, _repeat, _number, _number, _number)
