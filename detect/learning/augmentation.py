"""What is done to a sample before it is shown; nothing that resamples."""

import numpy as np

from detect.learning.config import AugmentationConfig
from geometry.arrays import FloatMap

SYMMETRIES = {"all": 8, "flips": 4, "mirror": 2, "none": 1}


def augment_sample(
    image: FloatMap,
    displacement: FloatMap,
    family: str,
    how: AugmentationConfig,
    random: np.random.Generator,
) -> tuple[FloatMap, FloatMap]:
    """Turns, flips, inverts and dims a sample; see `AugmentationConfig`.

    Args:
        image: (C, H, W).
        displacement: (2, H, W).
        family: Of the sample.
        how: What may happen.
        random: Decides.
    """
    symmetry = int(random.integers(SYMMETRIES[how.symmetries]))
    image = apply_symmetry(image, symmetry, how.vectors, how.tensors)
    displacement = apply_symmetry(displacement, symmetry, ((0, 1),))
    if how.negate and random.random() < 0.5:
        image, displacement = _negate_vectors(image, how.vectors), -displacement
    if random.random() < 0.5 and family in how.invert:
        image = 1 - image
    return image * np.float32(random.uniform(*how.gain)), displacement


def apply_symmetry(
    planes: FloatMap,
    symmetry: int,
    vectors: tuple[tuple[int, int], ...],
    tensors: tuple[tuple[int, int, int], ...] = (),
) -> FloatMap:
    """One of the 8 symmetries of the square; vectors and tensors turn with the image.

    Args:
        planes: (C, H, W).
        symmetry: Bit 0 mirrors left and right, bit 1 up and down, bit 2 swaps x and y.
        vectors: Pairs of planes that are x and y of a vector.
        tensors: Triples of planes that are xx, xy and yy of a symmetric tensor.
    """
    turned = planes[:, :: -1 if symmetry & 2 else 1, :: -1 if symmetry & 1 else 1].copy()
    for x, y in vectors:
        turned[x] *= -1 if symmetry & 1 else 1
        turned[y] *= -1 if symmetry & 2 else 1
    for _, xy, _ in tensors:
        turned[xy] *= -1 if symmetry & 3 in {1, 2} else 1
    if symmetry & 4:
        turned = np.ascontiguousarray(turned.transpose(0, 2, 1))
        for x, y in vectors:
            turned[[x, y]] = turned[[y, x]]
        for xx, _, yy in tensors:
            turned[[xx, yy]] = turned[[yy, xx]]
    return turned


def _negate_vectors(planes: FloatMap, vectors: tuple[tuple[int, int], ...]) -> FloatMap:
    signs = np.ones((len(planes), 1, 1), np.float32)
    signs[[plane for pair in vectors for plane in pair]] = -1
    return planes * signs
