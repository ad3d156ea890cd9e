"""Using a calibrated response: keep it as a passport, linearise images with it, hand it to other programs."""

from crfbench.passport.exchange import read_response, write_response
from crfbench.passport.linearise import linearise
from crfbench.passport.passport import Passport

__all__ = ["Passport", "linearise", "read_response", "write_response"]
