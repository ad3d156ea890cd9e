"""A photograph and the light that made it, with a border to drag between them."""

from io import BytesIO

import numpy as np
import traitlets
from numpy.typing import ArrayLike

from crfbench.checks import as_finite
from crfbench.curves import as_curves
from crfbench.errors import InputError
from crfbench.widgets.assets import bundle, join
from crfbench.widgets.page import LivingWidget

_MOST_PIXELS = 480  # along the longer side of the picture that the page gets


class BeforeAfter(LivingWidget):
    """A photograph, left of a border as its camera wrote it and right of it linearised; the page does the work.

    Parameters
    ----------
    image : array_like, shape (h, w, 3)
        Brightness of red, green and blue, from 0 to 1, as `crfbench.camera.read_image` gives it.
    curves : array_like, shape (1024,), (1, 1024) or (3, 1024)
        Inverse responses; one serves all channels.
    """

    _title = "A photograph and its light"
    _esm = bundle("before_after.js")
    _css = join("widgets.css")
    _photo = traitlets.Dict().tag(sync=True)

    def __init__(self, image: ArrayLike, curves: ArrayLike) -> None:
        from PIL import Image

        pixels, samples, jpeg = as_finite("image", image), as_curves(curves), BytesIO()
        if pixels.shape[2:] != (3,) or not 0 <= pixels.min() <= pixels.max() <= 1:
            raise InputError(f"image of shape {pixels.shape} is not valid; use (h, w, 3), with values from 0 to 1")
        picture = Image.fromarray(np.round(255 * pixels).astype(np.uint8))
        picture.thumbnail((_MOST_PIXELS, _MOST_PIXELS))
        picture.save(jpeg, "jpeg", quality=90)
        packed = {"jpeg": jpeg.getvalue(), "curves": samples.astype("<f4").tobytes(), "count": len(samples)}
        super().__init__(_photo=packed)

    def __repr__(self) -> str:
        return "BeforeAfter(image, curves)"
