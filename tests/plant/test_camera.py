"""Frame times from integers; noise as stated; the same seed gives the same poses."""

import math
from typing import Any

import numpy as np
import pytest

from plant.camera import Camera, CameraParameters
from plant.errors import InvalidParameterError

S = 10**15


def camera(seed: int = 1, **parameters: Any) -> Camera:
    generator = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed])))
    return Camera(generator, CameraParameters(**parameters))


def test_frames_never_drift() -> None:
    cam = camera()
    assert cam.exposure_fs(0) == 0
    assert cam.exposure_fs(1) == S // 30
    assert cam.exposure_fs(30 * 86400) == 86400 * S
    # not a rounded period added up or multiplied: exact after a year of frames
    assert cam.exposure_fs(946_080_001) == 31_536_000_033_333_333_333_333
    for index in (0, 1, 2, 29, 30, 31, 12345):
        t = cam.exposure_fs(index)
        assert cam.next_index(t) == index
        assert cam.next_index(t + 1) == index + 1


def test_a_frame_says_when_it_was_exposed_and_when_it_is_known() -> None:
    frame = camera(latency_s=0.04).capture(45, 0.0, 0.0, 0.0)
    assert (frame.number, frame.exposure_fs) == (45, 3 * S // 2)
    assert frame.available_fs - frame.exposure_fs == 4 * S // 100


def test_without_noise_the_pose_is_the_pose() -> None:
    cam = camera(led_noise_m=0.0, step_m=1e-9)
    for heading in (-3.0, -0.5, 0.0, 2.0, 9.0):
        frame = cam.capture(0, 1.234, -0.567, heading)
        assert frame.x_m == pytest.approx(1.234, abs=2e-9)
        assert frame.y_m == pytest.approx(-0.567, abs=2e-9)
        assert math.remainder(frame.heading_rad - heading, 2 * math.pi) == pytest.approx(
            0, abs=1e-7
        )


def test_noise_is_as_stated() -> None:
    cam = camera(led_noise_m=0.002)
    frames = [cam.capture(n, 1.0, 2.0, 0.7) for n in range(4000)]
    x = np.array([f.x_m for f in frames])
    psi = np.array([f.heading_rad for f in frames])
    # standard error of a standard deviation from 4000 samples: 1.1 %
    assert x.std() == pytest.approx(0.002 / math.sqrt(2), rel=0.05)
    assert psi.std() == pytest.approx(0.002 * math.sqrt(2) / 0.10, rel=0.05)
    assert x.mean() == pytest.approx(1.0, abs=1e-4)


def test_a_seed_makes_the_noise() -> None:
    one, same, other = camera(5), camera(5), camera(6)
    poses = [c.capture(3, 1.0, 2.0, 0.7) for c in (one, same, other)]
    assert poses[0] == poses[1]
    assert poses[0] != poses[2]


@pytest.mark.parametrize(
    "bad", [{"frames_per_s": 0}, {"frames_per_s": 29.97}, {"led_noise_m": -1.0}, {"step_m": 0.0}]
)
def test_nonsense_is_refused(bad: dict[str, Any]) -> None:
    with pytest.raises(InvalidParameterError, match="camera"):
        camera(**bad)
