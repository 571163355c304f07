"""Radio messages: octets by hand as a TinyOS nx_struct has them, sizes, ranges, blame."""

from __future__ import annotations

import math

import pytest

from radio_802154 import tinyos
from radio_802154.errors import LocalFrameError, RemoteFrameError
from radio_802154.messages import (
    AM_MESSAGES,
    BASE,
    ROBOT,
    TOSH_DATA_LENGTH,
    CommandReply,
    CommandStatus,
    Pose,
    PoseBatch,
    TailBeatCommand,
    TargetCommand,
    Telemetry,
    TelemetryFlag,
    decode,
    encode,
)

TELEMETRY = Telemetry(
    time_s=1.5,
    sequence=3,
    heading_rad=-math.pi / 2,
    gyro_z_rad_s=0.2,
    tail_bias_rad=0.1,
    battery_v=7.4,
    temperature_c=21.5,
    water_quality_ug_l=None,
    samples_stored=123,
    samples_lost=0,
    last_command_id=7,
    flags=TelemetryFlag.GPS_FIX,
)

# message, AM type, octets worked out by hand (big-endian)
VECTORS = [
    (TailBeatCommand(1, 0.0, 0.25, 0.9, 10.0), 0x10, "0001 0000 1388 0384 03e8"),
    (TargetCommand(2, 2.0, -2.0), 0x11, "0002 07d0 f830"),
    (Pose(0.5, 1.25, math.pi / 2, 100_000), 0x12, "01f4 04e2 4000 000186a0"),
    (
        PoseBatch.of([(1, Pose(0.5, 1.25, math.pi / 2, 100_000)), (20, Pose(-0.5, 0, 0, 100_000))]),
        0x13,
        "000186a0 0001 01f4 04e2 4000 0014 fe0c 0000 0000 ffff 0000 0000 0000",
    ),
    (CommandReply(2, CommandStatus.APPLIED), 0x20, "0002 01"),
    (
        TELEMETRY,
        0x21,
        "1f 000005dc 0003 c000 0190 07d0 1ce8 0866 0000 0000007b 00 0007 08",
    ),
]


@pytest.mark.parametrize(("message", "am_type", "octets"), VECTORS)
def test_vectors(message: object, am_type: int, octets: str) -> None:
    assert encode(message) == (am_type, bytes.fromhex(octets))
    assert decode(am_type, bytes.fromhex(octets)) == message


def test_every_message_fits_the_default_payload_of_tinyos() -> None:
    assert max(row.layout.size for row in AM_MESSAGES) <= TOSH_DATA_LENGTH
    assert len({row.kind for row in AM_MESSAGES}) == len(AM_MESSAGES)


def test_through_a_frame() -> None:
    am_type, payload = encode(TELEMETRY, ROBOT)
    packet = tinyos.AmPacket(destination=0, source=1, am_type=am_type, payload=payload)
    got = tinyos.decode(tinyos.encode(packet))
    assert decode(got.am_type, got.payload, ROBOT) == TELEMETRY


def test_blame() -> None:
    with pytest.raises(LocalFrameError, match="bias_rad"):
        encode(TailBeatCommand(1, 2.0, 0.25, 0.9, 10.0))
    with pytest.raises(LocalFrameError, match="sent by the base"):
        encode(TargetCommand(1, 0.0, 0.0), ROBOT)
    with pytest.raises(LocalFrameError, match="no radio message"):
        encode("hello")
    with pytest.raises(RemoteFrameError, match="0x99"):
        decode(0x99, b"")
    with pytest.raises(RemoteFrameError, match="0x21"):
        decode(0x21, bytes(27), BASE)
    with pytest.raises(RemoteFrameError, match="6 bytes"):
        decode(0x11, bytes(5))


def test_a_batch_has_the_poses_that_were_put_in() -> None:
    poses = tuple((address, Pose(0.25 * address, -1.0, 0.0, 7)) for address in (3, 9, 4))
    for count in (1, 2, 3):
        batch = decode(*encode(PoseBatch.of(poses[:count]), BASE), BASE)
        assert isinstance(batch, PoseBatch)
        assert batch.poses == poses[:count]
