"""Our image processing against OpenCV and scikit-image: true error and CPU time.

python -m benchmarks.image_libraries [--quick] [--only pictures|films|volumes]
"""

from __future__ import annotations

from benchmarks.command import run
from benchmarks.image_films import film_rows
from benchmarks.image_pictures import picture_rows
from benchmarks.image_volumes import volume_rows

if __name__ == "__main__":
    run({"pictures": picture_rows, "films": film_rows, "volumes": volume_rows}, __doc__)
