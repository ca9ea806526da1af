"""Experiment 2: a camera at rest, one frame beside two.

    OMP_NUM_THREADS=1 python -m benchmarks.paper deflected [--picture PICTURE]

Prints a row for each flow and method, and draws the last frame of each flow.
The single frame is compared with Horn-Schunck against the mean of 50 frames. Plumes before a
sinusoid of 8 px are deflected by wind and by a plate. The plate is present in the reference, or was
moved since by 3 px along each axis, or came in later.
"""

import argparse

import cv2
import numpy as np

from benchmarks.paper.plate import BASE_PX, BESIDE_PX, SETUPS, SIZE_PX, film_setup
from benchmarks.paper.rows import (
    HEADER,
    AnsweredFrame,
    add_detector_arguments,
    draw_strip,
    score_row,
    write_picture,
)
from detect.bos import BosDetector
from detect.detection import Frames
from detect.dybs import DybsDetector


def deflected(detector: DybsDetector) -> list[np.ndarray]:
    print(HEADER.format(what="flow | method").replace("|---", "|---|---", 1))
    strips = []
    for setup in SETUPS:
        answered: dict[str, list[AnsweredFrame]] = {"two frames": [], "dybs": []}
        for reference, image, truth, covered in film_setup(setup):
            frames = Frames(images=[image])
            held = covered.astype(np.uint8)
            held[SIZE_PX - BASE_PX :] = 0
            near = cv2.dilate(held, np.ones((2 * BESIDE_PX + 1,) * 2)) > 0
            for name, method in (
                ("two frames", BosDetector(reference=reference)),
                ("dybs", detector),
            ):
                answer = method.detect(frames, 0)
                answered[name].append(
                    AnsweredFrame(
                        image=image, truth=truth, answer=answer, counts=~covered, beside=near
                    )
                )
        for name, frames_seen in answered.items():
            print(f"| {setup.name} | {name} | {score_row(frames_seen)} |", flush=True)
        last = {name: seen[-1] for name, seen in answered.items()}
        answers = [last[name].answer.displacement for name in ("dybs", "two frames")]
        strips.append(draw_strip(last["dybs"].image, last["dybs"].truth, *answers, side=240))
    return strips


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_detector_arguments(parser)


def main(options: argparse.Namespace) -> None:
    write_picture(options.picture, deflected(DybsDetector(options.network)))
