import numpy as np
import pytest

from locate.messages.poses import UNKNOWN_COVARIANCE, PoseBuffer, StampedPose
from locate.messages.stamps import NS_PER_S, StampGate
from locate.messages.transforms import TransformTree
from locate.robot import Locator
from tests.robot.drive import BLANK, moments
from tests.robot.test_locator import UNDECIDED, inline
from tests.robot.test_transforms import stamped

FAR = [10**9 * NS_PER_S, -(10**9) * NS_PER_S, 2**62, 0]


def admitted(stamps_s: list[float]) -> tuple[list[float], int]:
    gate: StampGate[float] = StampGate()
    passed: list[float] = []
    for one in stamps_s:
        passed += gate.admit(round(one * NS_PER_S), one).messages
    return passed, gate.left_out


@pytest.mark.parametrize(
    ("stamps_s", "passed", "left_out"),
    [
        ([100, 101, 100.5, 102], [100, 101, 100.5, 102], 0),
        ([100, 1e6, 101], [100, 101], 1),
        ([100, 0, 101], [100, 101], 1),
        ([100, 1e6, 101, 1e6, 102], [100, 101, 102], 2),
        ([100, 1e6, 0, 101], [100, 101], 2),
        ([0, 1e6, 1e6 + 1, 1e6 + 2], [0, 1e6, 1e6 + 1, 1e6 + 2], 0),
        ([1e6, 0, 1, 2], [1e6, 0, 1, 2], 0),
        ([0, 20, 40, 60, 80], [0, 20, 40, 60, 80], 0),
        ([100, 60, 20, 101], [100, 101], 2),
    ],
)
def test_one_wrong_stamp_is_left_out_and_a_clock_that_was_set_is_followed(
    stamps_s: list[float], passed: list[float], left_out: int
) -> None:
    assert admitted(stamps_s) == (passed, left_out)


def test_going_back_is_told_and_going_on_is_not() -> None:
    gate: StampGate[str] = StampGate()
    went_back = [gate.admit(s * NS_PER_S, "").went_back for s in (100, 200, 201, 50, 51, 52)]
    assert went_back == [False, False, False, False, True, False]


def pose(stamp_ns: int) -> StampedPose:
    return StampedPose(stamp_ns=stamp_ns, world_from_cam=np.eye(4), covariance=UNKNOWN_COVARIANCE)


@pytest.mark.parametrize("far_ns", FAR)
def test_a_stamp_far_away_costs_the_buffer_nothing(far_ns: int) -> None:
    buffer = PoseBuffer()
    for tenth in range(1000, 1010):
        buffer.add(pose(tenth * NS_PER_S // 10))
    buffer.add(pose(far_ns))
    assert buffer.interpolate_at(100 * NS_PER_S + 1) is not None
    buffer.add(pose(101 * NS_PER_S))
    assert buffer.interpolate_at(101 * NS_PER_S - 1) is not None
    assert (len(buffer), buffer.left_out) == (11, 1)


def test_a_buffer_follows_a_replay() -> None:
    buffer = PoseBuffer()
    for tenth in (1000, 1001, 1002, 0, 1, 2):
        buffer.add(pose(tenth * NS_PER_S // 10))
    assert len(buffer) == 3
    assert buffer.interpolate_at(NS_PER_S // 20) is not None


@pytest.mark.parametrize("far_ns", [2**31 * NS_PER_S, 0])
def test_tf_goes_on_after_a_stamp_far_away_and_after_a_replay(far_ns: int) -> None:
    tree = TransformTree()
    seconds = [100.0, 100.1, far_ns / NS_PER_S, 100.2, 100.3]
    for second in [*seconds, 20.0, 20.1]:
        tree.add([stamped("camera", "map", np.eye(4), round(second * NS_PER_S))], static=False)
        if second == 100.3:
            assert tree.find("map", "camera", round(100.25 * NS_PER_S)) is not None
    assert tree.find("map", "camera", round(20.05 * NS_PER_S)) is not None


@pytest.mark.parametrize("far_ns", FAR)
def test_a_stamp_far_away_costs_a_locator_one_message(views, far_ns: int) -> None:
    usual = inline(views, UNDECIDED)
    hit = inline(views, UNDECIDED)
    for number, moment in enumerate(moments(views)):
        for locator in (usual, hit):
            locator.feed(BLANK, moment.world_from_cam, None, moment.stamp_ns)
        if number == 5:
            hit.feed(BLANK, moment.world_from_cam, None, far_ns)
    assert hit.counts.misdated == 2
    assert hit.counts.jumps == 0
    assert hit.counts.key_frames == usual.counts.key_frames == 12
    assert found(hit) == found(usual)


def found(locator: Locator) -> list[list[float]]:
    locator.finish()
    return [plume.source.tolist() for plume in locator.plume_map().plumes]
