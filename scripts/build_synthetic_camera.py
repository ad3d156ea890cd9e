"""Render the photographs of a synthetic camera that are bundled: data/synthetic_camera, four RAW and JPEG pairs.

Run from the root of the repository: python -m scripts.build_synthetic_camera
"""

from crfbench.camera import EXAMPLE_FOLDER
from crfbench.datasets import load_opencrf
from tests.support.photographs import write_pair
from tests.support.scenes import render_chart

TARGET = EXAMPLE_FOLDER
#: The response of the camera, by its name in OpenCRF.
RESPONSE = "Kodak Gold 200 G"
EXPOSURES = (0.12, 0.3, 0.7, 1.3)  # irradiance of a perfect reflector, in units of full scale
SIZE = (320, 240)


def main() -> None:
    opencrf = load_opencrf()
    response = opencrf.curves[list(opencrf.names).index(RESPONSE)]
    for i, exposure in enumerate(EXPOSURES):
        scene = render_chart(response, seed=i, size=SIZE, exposure=exposure, illuminant=(1.05, 1.0, 0.9))
        paths = write_pair(TARGET, f"chart_{i + 1}", scene, exposure_time=exposure / 100, model="crfbench synthetic")
        print(*(f"{path.name} {path.stat().st_size} bytes" for path in paths))


if __name__ == "__main__":
    main()
