"""What can be rendered: a size in pixels, and the noise of a sensor."""

from collections.abc import Sequence

from crfbench.checks import check_count, check_number
from crfbench.errors import InputError


def check_size(size: Sequence[int], least: int) -> None:
    """Raise `InputError` unless `size` is width and height, whole numbers of pixels from `least`."""
    if not isinstance(size, Sequence) or len(size) != 2:
        raise InputError(f"size={size!r} does not fit; use width and height in pixels")
    for side in size:
        check_count("size", side, least)


def check_noise(full_well: float, read_noise: float) -> None:
    """Raise `InputError` unless the electrons at full scale and the read noise are those of some sensor."""
    check_number("full_well", full_well, 1.0)
    check_number("read_noise", read_noise, 0.0, 1.0)
