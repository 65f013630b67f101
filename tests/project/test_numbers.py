"""Numbers of result files: 17 significant digits, correctly rounded, read back to the same bits."""

import random
import struct
import subprocess

import pytest


def text_of(x):
    """The number in the format ES25.16E3, from Python's own correctly rounded digits."""
    digits, exponent = f"{x:.16e}".split("e")
    return f"{digits}E{int(exponent):+04d}".rjust(25)


def bits_of(x):
    """The bits of a double as a signed integer."""
    return struct.unpack("<q", struct.pack("<d", x))[0]


def cases():
    """Random bits, short decimals, ties, powers of ten and their neighbours, the smallest and the largest."""
    pick = random.Random(20240611)
    values = [struct.unpack("<d", struct.pack("<Q", pick.getrandbits(64)))[0] for _ in range(20000)]
    values += [struct.unpack("<d", struct.pack("<Q", pick.getrandbits(52)))[0] for _ in range(2000)]
    values += [pick.randrange(10**6) * 4.0e-6 for _ in range(2000)]
    values += [pick.randrange(10**17, 10**18) * 0.5 for _ in range(2000)]
    values += [pick.randrange(2**53) * 2.0 ** pick.randrange(-60, 10) for _ in range(5000)]
    for power in range(-323, 309):
        x = float(f"1e{power}")
        step = 5e-324 if x < 1e-300 else x * 2.3e-16
        values += [x, x - step, x + step, -x]
    values += [0.0, -0.0, 5e-324, 1.7976931348623157e308, 2.2250738585072014e-308]
    return [x for x in values if x == x and abs(x) != float("inf")]


@pytest.fixture(scope="module")
def written(probe):
    values = cases()
    lines = "".join(f"{bits_of(x)}\n" for x in values)
    done = subprocess.run([str(probe), "numbers"], input=lines, capture_output=True, text=True, check=True)
    return values, done.stdout.splitlines()


def test_digits_are_correctly_rounded(written):
    values, lines = written
    wrong = [(x, line) for x, line in zip(values, lines) if line != text_of(x)]
    assert len(lines) == len(values)
    assert not wrong, wrong[:5]


def test_numbers_read_back_to_the_same_bits(written):
    values, lines = written
    assert [bits_of(float(line)) for line in lines] == [bits_of(x) for x in values]
