"""What one frame can show: a plume before a lattice, without any reference.

    python examples/single_frame.py          # writes work/single_frame.png

From left to right: the frame, the displacement that the detector sees in it, the true one, and the
mask. Hue is direction, saturation is size, and the number is the largest displacement.
"""

import argparse
from pathlib import Path

import numpy as np

from detect.detection import Frames
from detect.registry import make_detector
from detect.scores import auroc
from detect.synthesis import Recipe, Sample, Sources, sample_at
from locate.export.pictures import displacement_picture
from locate.recording.images import write_png

PLUME_PX = 0.06
MASK_NATS = 2.0


def draw_sample(seed: int) -> Sample:
    """A camera's picture of a sinusoid or a checkerboard through turbulent warm air."""
    recipe = Recipe.from_plain(
        {
            "seed": seed,
            "split": "test",  # nothing was trained on these
            "size_px": 320,
            "families": {"sinusoid": 1, "checkerboard": 1},
            "negatives": 0,
            "peak_px": [0.3, 0.8],
            "plume_length": [0.8, 1.2],
        }
    )
    return sample_at(0, recipe, Sources.from_recipe(recipe))


def main(output: Path, seeds: list[int]) -> list[float]:
    # The weights come with the package; no torch, no GPU, no reference image.
    detector = make_detector("dybs")
    rows, scores = [], []
    for seed in seeds:
        sample = draw_sample(seed)
        seen = detector.detect(Frames(images=[sample.image]), 0)
        plume = np.linalg.norm(sample.displacement, axis=-1) > PLUME_PX
        scores.append(auroc(seen.llr, plume))
        print(f"{sample.family}: AUROC of the evidence {scores[-1]:.3f}")
        panels = [
            in_colour(sample.image),
            displacement_picture(seen.displacement),
            displacement_picture(sample.displacement),
            in_colour(255 * (seen.llr > MASK_NATS)),
        ]
        rows.append(np.hstack(panels))
    output.parent.mkdir(parents=True, exist_ok=True)
    write_png(output, np.vstack(rows))
    print(f"Look at {output}")
    return scores


def in_colour(grey: np.ndarray) -> np.ndarray:
    return np.repeat(grey[..., None].astype(np.uint8), 3, axis=-1)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("-o", "--output", type=Path, default=Path("work/single_frame.png"))
    arguments = parser.parse_args()
    main(arguments.output, arguments.seeds)
