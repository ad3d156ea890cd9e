"""The candidates of the paper's "Naïve neural architecture search", their complexity, and what training them gives."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise, product

from crfbench.checks import check_count
from crfbench.curves import N_SAMPLES
from crfbench.errors import InputError

#: Neurons of the encoder's hidden layers, one to three of them; the decoder mirrors them.
Hidden = tuple[int, ...]
#: A candidate, and for how many epochs to train it.
Trial = tuple[Hidden, int]


@dataclass(frozen=True)
class SearchSpace:
    """All combinations of layer widths; 0 is a layer that is not there. By default the paper's 156.

    Parameters
    ----------
    h1, h2, h3 : sequence of int
        Widths that each layer may have. Where h2 is 0, h3 is 0 too.

    Examples
    --------
    >>> len(SearchSpace())
    156
    >>> list(SearchSpace(h1=(10, 50), h2=(0, 20), h3=(0,)))
    [(10,), (10, 20), (50,), (50, 20)]
    """

    h1: Sequence[int] = (10, 20, 50, 100, 200, 500)
    h2: Sequence[int] = (0, 10, 20, 50, 100, 200)
    h3: Sequence[int] = (0, 10, 20, 50, 100)

    def __post_init__(self) -> None:
        for name, least in (("h1", 1), ("h2", 0), ("h3", 0)):
            given = getattr(self, name)
            widths = tuple(check_count(name, width, least) for width in given) if isinstance(given, Iterable) else ()
            if not widths or len(set(widths)) < len(widths):
                raise InputError(f"{name}={given!r} is out of range; use one or more different widths from {least}")
            object.__setattr__(self, name, widths)
        if not list(self):
            raise InputError(f"{self} holds no architecture; allow h3=0 where h2 is 0")

    def __iter__(self) -> Iterator[Hidden]:
        """Yield the candidates, narrowest first layer first."""
        for h1, h2, h3 in product(self.h1, self.h2, self.h3):
            if h2 or not h3:  # a third layer needs a second
                yield tuple(width for width in (h1, h2, h3) if width)

    def __len__(self) -> int:
        """Return the number of candidates."""
        return sum(1 for _ in self)


@dataclass(frozen=True)
class Outcome:
    """What training one candidate on every fold gave."""

    hidden: Hidden
    epochs: int
    mse: tuple[float, ...]  # one a fold, as rmse: the mean over its held-out curves
    rmse: tuple[float, ...]
    seconds: float  # the candidate's share of the time of those it was trained with

    @property
    def trial(self) -> Trial:
        """The trial that gave it."""
        return self.hidden, self.epochs


def complexity(hidden: Sequence[int], n_latent: int = 1) -> int:
    """Count the weights and biases of the encoder, the paper's measure of complexity.

    Sum over the hidden layers of C_{l-1} C_l + C_l, plus C_L C_z + C_z; C_0 = 1024 samples, C_z latents. The decoder
    has as many weights, but 1024 biases at its end where the encoder has C_z: both halves together hold
    2 complexity + 1024 - C_z parameters.

    Examples
    --------
    >>> complexity((50, 20))
    52291
    """
    return sum(before * after + after for before, after in pairwise((N_SAMPLES, *hidden, n_latent)))
