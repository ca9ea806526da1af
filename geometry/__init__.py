"""Floor 1: cameras, poses, rays, grids, and how air bends light."""

import os

MOST_PIXELS = 200_000_000
"""Of one image: as many as cameras have, and 2 GB at most while it is decoded."""

# OpenCV reads its limit when it is loaded, and no module of ours loads it before this one.
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(MOST_PIXELS))
