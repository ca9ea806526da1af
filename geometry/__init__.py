"""Floor 1: cameras, poses, rays, grids, and how air bends light."""

import os

MOST_PIXELS = 2**28
"""Of one image, some 268 megapixels: more than cameras have, and 2 GB while it is decoded."""

# OpenCV reads its limit when it is loaded, and no module of ours loads it before this one.
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(MOST_PIXELS))
