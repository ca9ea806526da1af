"""Names for the array types that the packages pass around."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]
FloatMap: TypeAlias = NDArray[np.float32]
GreyImage: TypeAlias = NDArray[np.uint8]
GreySamples: TypeAlias = NDArray[np.uint8] | NDArray[np.uint16]
"""(H, W) grey; samples of 16 bits hold 256 steps a grey level."""
Picture: TypeAlias = NDArray[np.uint8]
"""(H, W, 3) blue, green, red, OpenCV's order; (H, W, 4) with alpha."""
