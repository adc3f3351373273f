"""Image work written here against OpenCV and scikit-image: accuracy by known truth, processor time.

python -m benchmarks.image_libraries [--only views|pictures|films|targets|volumes]
"""

from __future__ import annotations

from collections.abc import Mapping

from benchmarks.command import Job, run
from benchmarks.image_films import film_rows
from benchmarks.image_pictures import picture_rows
from benchmarks.image_targets import target_rows
from benchmarks.image_views import view_rows
from benchmarks.image_volumes import volume_rows

JOBS: Mapping[str, Job] = {
    "views": view_rows,
    "pictures": picture_rows,
    "films": film_rows,
    "targets": target_rows,
    "volumes": volume_rows,
}

if __name__ == "__main__":
    run(JOBS, __doc__)
