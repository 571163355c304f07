"""The emulated XBee module: modes, registers, and what goes over the air, against other radios."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from firmware_model.scheduler import Scheduler
from firmware_model.signals import constant
from firmware_model.time import FS_PER_MS, FS_PER_S
from firmware_model.trace import Trace
from radio_802154 import mac, xbee
from radio_802154.medium import Antenna, Medium, MediumConfig
from radio_802154.xbee import (
    ApiFrame,
    AtCommand,
    AtCommandQueued,
    AtResponse,
    AtResult,
    ModemStatus,
    RxPacket16,
    RxPacket64,
    TxOption,
    TxRequest16,
    TxRequest64,
    TxResult,
    TxStatus,
)
from radio_802154.xbee_module import XBeeModule, resampled

A, B = 0x0013_A200_4000_000A, 0x0013_A200_4000_000B


class World:
    """Two modules a metre apart; what they say by their serial lines is kept as octets."""

    def __init__(self, first: dict[str, int], second: dict[str, int], **medium: object) -> None:
        self.scheduler = Scheduler()
        self.trace = Trace()
        self.air: list[bytes] = []
        channel = self.trace.channel("radio")
        channel.sink(lambda block: self.air.extend(value[4] for _, value in block))
        self.medium = Medium(self.scheduler, MediumConfig(**medium), channel=channel)  # type: ignore[arg-type]
        self.said: list[bytearray] = [bytearray(), bytearray()]
        self.modules = []
        for index, registers in enumerate((first, second)):
            name = "ab"[index]
            self.medium.place(name, Antenna(x_m=constant(float(index))))
            written = {"SL": 0x4000_000A + index, **registers}
            self.modules.append(
                XBeeModule(self.scheduler, self.medium, name, written, self._keep(index))
            )

    def _keep(self, index: int) -> Callable[[bytes], None]:
        return lambda octets: self.said[index].extend(octets)

    def run_ms(self, milliseconds: float) -> None:
        self.scheduler.run(self.scheduler.now + round(milliseconds * FS_PER_MS))
        self.trace.flush()

    def tell(self, index: int, frame: ApiFrame, ms: float = 200.0) -> list[ApiFrame]:
        """Give a module a frame; return what it said until some time later."""
        escaped = self.modules[index].registers["AP"] == 2
        self.modules[index].receive(xbee.encode(frame, escaped=escaped))
        self.run_ms(ms)
        return self.frames(index)

    def frames(self, index: int) -> list[ApiFrame]:
        escaped = self.modules[index].registers["AP"] == 2
        octets, self.said[index][:] = bytes(self.said[index]), b""
        decoder = xbee.Decoder(escaped=escaped)
        found = decoder.receive(octets)
        assert not decoder.error_count
        return found


PLAIN = {"AP": 2, "MM": 2, "CH": 26, "ID": 0x22}


def test_data_goes_from_one_to_the_other_and_is_acknowledged_on_the_air() -> None:
    world = World({**PLAIN, "MY": 1}, {**PLAIN, "MY": 2, "AP": 1})
    assert world.tell(0, TxRequest16(5, 2, 0, b"\x7e\x7dhello")) == [TxStatus(5, TxResult.SUCCESS)]
    [packet] = world.frames(1)
    assert isinstance(packet, RxPacket16)
    assert (packet.source, packet.options, packet.data) == (1, 0, b"\x7e\x7dhello")
    assert 30 < packet.rssi < 60  # a metre of air at 0 dBm: 40 dB
    data, ack = (mac.decode(psdu[:-2]) for psdu in world.air)
    assert data.frame_control == 0x8861  # as a TelosB's: plain IEEE 802.15.4
    assert data.payload == b"\x7e\x7dhello"
    assert mac.acknowledges(ack, data)


def test_64_bit_addresses_and_broadcast() -> None:
    world = World({**PLAIN, "MY": 0xFFFF}, {**PLAIN, "MY": 2})
    assert world.tell(0, TxRequest64(1, B, 0, b"a")) == [TxStatus(1, TxResult.SUCCESS)]
    [packet] = world.frames(1)
    assert isinstance(packet, RxPacket64)
    assert packet.source == A  # no short address of its own
    assert world.tell(0, TxRequest64(2, 0xFFFF, 0, b"b")) == [TxStatus(2, TxResult.SUCCESS)]
    [packet] = world.frames(1)
    assert isinstance(packet, RxPacket64)
    assert packet.options == 0x02
    assert len(world.air) == 3  # a broadcast is not acknowledged


def test_nobody_acknowledges_and_it_is_tried_four_times() -> None:
    world = World({**PLAIN, "MY": 1}, {**PLAIN, "MY": 2})
    assert world.tell(0, TxRequest16(9, 7, 0, b"?")) == [TxStatus(9, TxResult.NO_ACK)]
    assert len(world.air) == 4
    assert len(set(world.air)) == 1
    no_ack = TxRequest16(10, 7, TxOption.DISABLE_ACK, b"?")
    assert world.tell(0, no_ack) == [TxStatus(10, TxResult.SUCCESS)]
    assert world.tell(0, TxRequest16(0, 2, 0, b"!")) == []  # frame id 0 asks for no status
    assert len(world.frames(1)) == 1
    [response] = world.tell(0, AtCommand(1, b"EA"))
    assert response == AtResponse(1, b"EA", AtResult.OK, b"\0\1")


def test_every_packet_of_many_comes_over_a_lossy_air_or_is_reported() -> None:
    world = World({**PLAIN, "MY": 1, "BD": 7}, {**PLAIN, "MY": 2, "BD": 7}, loss_probability=0.3)
    outcomes, heard = {}, []
    for number in range(1, 200):
        for frame in world.tell(0, TxRequest16(number, 2, 0, bytes((number,))), ms=60.0):
            assert isinstance(frame, TxStatus)
            outcomes[frame.frame_id] = frame.status
        heard += [f.data[0] for f in world.frames(1) if isinstance(f, RxPacket16)]
    assert len(outcomes) == 199
    acknowledged = {number for number, status in outcomes.items() if status == TxResult.SUCCESS}
    assert acknowledged <= set(heard)  # nothing acknowledged is lost
    # Four attempts, each of which fails where data or ACK is lost: 0.51^4 = 6.8 %.
    assert 2 <= 199 - len(acknowledged) <= 28
    assert len(heard) > len(set(heard))  # a lost ACK repeats data: plain MAC modes do


def test_both_send_at_once_and_all_arrives() -> None:
    world = World({**PLAIN, "MY": 1, "RN": 3, "BD": 7}, {**PLAIN, "MY": 2, "RN": 3, "BD": 7})
    statuses = []
    for number in range(1, 31):
        for index in (0, 1):
            request = TxRequest16(number, 2 - index, 0, bytes(20))
            world.modules[index].receive(xbee.encode(request, escaped=True))
        world.run_ms(60.0)
        frames = world.frames(0) + world.frames(1)
        statuses += [frame.status for frame in frames if isinstance(frame, TxStatus)]
    assert statuses == [TxResult.SUCCESS] * 60


def test_a_strong_carrier_is_a_busy_channel() -> None:
    """CA is the threshold of CCA: the noise floor is above a threshold that low."""
    world = World({**PLAIN, "MY": 1, "CA": 0x50}, {**PLAIN, "MY": 2})
    world.medium.place("jammer", Antenna(x_m=constant(0.5)))

    class Jammer:
        def sfd_sent(self, _t: object) -> int:
            return 127

        def psdu(self, octets: int) -> bytes:
            return bytes(octets)

        def frame_control(self) -> int:
            return 0

        def sent(self, _t: object) -> None: ...

        def hears(self, _t: object) -> bool:
            return False

    port = world.medium.attach("jammer", Jammer())  # type: ignore[arg-type]
    world.scheduler.after(
        16 * FS_PER_MS, lambda: world.medium.transmit(port, 2480, 0.0, 5)
    )  # the request is heard at 13.5 ms
    for number in range(1, 12):
        world.scheduler.after(
            (16 + 4 * number) * FS_PER_MS + number * FS_PER_MS // 2,
            lambda: world.medium.transmit(port, 2480, 0.0, 5),
        )
    request = xbee.encode(TxRequest16(3, 2, 0, b"x" * 4), escaped=True)
    world.run_ms(4)
    world.modules[0].receive(request)
    world.run_ms(300)
    [status] = world.frames(0)
    assert status == TxStatus(3, TxResult.CCA_FAILURE)


def test_a_digi_header_is_taken_off_by_its_like_only() -> None:
    world = World({**PLAIN, "MY": 1, "MM": 0}, {**PLAIN, "MY": 2, "MM": 0})
    world.tell(0, TxRequest16(1, 2, 0, b"ab"))
    [packet] = world.frames(1)
    assert isinstance(packet, RxPacket16)
    assert packet.data == b"ab"
    world.tell(1, AtCommand(1, b"MM", b"\2"))
    world.tell(0, TxRequest16(1, 2, 0, b"ab"))
    [packet] = world.frames(1)
    assert isinstance(packet, RxPacket16)
    assert len(packet.data) == 4
    assert packet.data.endswith(b"ab")


def test_registers_answer_as_the_manual_has_them() -> None:
    world = World({**PLAIN, "MY": 1}, PLAIN)
    ok = AtResult.OK
    assert world.tell(0, AtCommand(1, b"ID")) == [AtResponse(1, b"ID", ok, b"\0\x22")]
    assert world.tell(0, AtCommand(2, b"CH")) == [AtResponse(2, b"CH", ok, b"\x1a")]
    assert world.tell(0, AtCommand(3, b"SH")) == [AtResponse(3, b"SH", ok, b"\0\x13\xa2\0")]
    assert world.tell(0, AtCommand(4, b"ZZ")) == [AtResponse(4, b"ZZ", AtResult.INVALID_COMMAND)]
    assert world.tell(0, AtCommand(5, b"CH", b"\x30")) == [
        AtResponse(5, b"CH", AtResult.INVALID_PARAMETER)
    ]
    assert world.tell(0, AtCommand(6, b"VR", b"\1")) == [AtResponse(6, b"VR", AtResult.ERROR)]
    assert world.tell(0, AtCommand(7, b"CH", b"\0\0\x0b")) == [AtResponse(7, b"CH", ok)]
    assert world.modules[0].registers["CH"] == 11
    assert world.tell(0, AtCommandQueued(8, b"CH", b"\x0c")) == [AtResponse(8, b"CH", ok)]
    assert world.modules[0].registers["CH"] == 11
    assert world.tell(0, AtCommand(9, b"AC")) == [AtResponse(9, b"AC", ok)]
    assert world.modules[0].registers["CH"] == 12
    assert world.tell(0, AtCommand(0, b"ID")) == []


def test_what_is_not_written_is_gone_after_a_restart_and_the_module_says_so() -> None:
    world = World({**PLAIN, "MY": 1}, PLAIN)
    world.tell(0, AtCommand(1, b"MY", b"\5"))
    world.tell(0, AtCommand(2, b"WR"))
    world.tell(0, AtCommand(3, b"MY", b"\6"))
    module = world.modules[0]
    module.switch(False)
    assert world.tell(0, AtCommand(4, b"MY")) == []  # nobody at home
    module.switch(True)
    world.run_ms(200)
    assert world.frames(0) == [ModemStatus(0)]
    assert module.registers["MY"] == 5
    assert world.tell(0, AtCommand(5, b"FR"), 300) == [
        AtResponse(5, b"FR", AtResult.OK), ModemStatus(1)
    ]  # fmt: skip


def test_transparent_mode_and_command_mode() -> None:
    """As a terminal program does it: guard time, +++, OK, ATAP1, and frames from then on."""
    world = World({**PLAIN, "AP": 0, "MY": 1, "DL": 2}, {**PLAIN, "MY": 2})
    module, said = world.modules[0], world.said[0]
    module.receive(b"plain text")
    world.run_ms(100)
    [packet] = world.frames(1)
    assert isinstance(packet, RxPacket16)
    assert packet.data == b"plain text"
    module.receive(b"+++")  # without the silence before it is data
    world.run_ms(1500)
    assert not said
    world.frames(1)
    module.receive(b"+++")
    world.run_ms(1500)
    assert bytes(said) == b"OK\r"
    said.clear()
    module.receive(b"ATAP\rATCH\rATXX\rhello\rATAP1\rATCN\r")
    world.run_ms(200)
    assert bytes(said) == b"0\r1A\rERROR\rERROR\rOK\rOK\r"
    said.clear()
    assert not world.frames(1)  # none of it went out
    assert world.tell(0, AtCommand(1, b"AP")) == [AtResponse(1, b"AP", AtResult.OK, b"\1")]


def test_command_mode_ends_by_itself() -> None:
    world = World({**PLAIN, "AP": 0, "DL": 2, "CT": 10}, {**PLAIN, "MY": 2})
    world.run_ms(1100)
    world.modules[0].receive(b"+++")
    world.run_ms(1200)
    assert bytes(world.said[0]) == b"OK\r"
    world.run_ms(1100)
    world.modules[0].receive(b"ATAP1\r")
    world.run_ms(100)
    [packet] = world.frames(1)
    assert isinstance(packet, RxPacket16)
    assert packet.data == b"ATAP1\r"


def test_the_serial_line_takes_its_time() -> None:
    world = World({**PLAIN, "MY": 1}, PLAIN)
    request = xbee.encode(AtCommand(1, b"MY"), escaped=True)
    world.modules[0].receive(request)
    answer = xbee.encode(AtResponse(1, b"MY", 0, b"\0\1"), escaped=True)
    exact_fs = (len(request) + len(answer)) * 10 * FS_PER_S // 9600
    world.scheduler.run(exact_fs - FS_PER_MS // 10)
    assert not world.said[0]
    world.scheduler.run(exact_fs + FS_PER_MS // 10)
    assert bytes(world.said[0]) == answer


@pytest.mark.parametrize("heard", [1200, 2400, 4800, 19200, 38400, 57600, 115200])
def test_at_another_baud_rate_no_frame_is_left(heard: int) -> None:
    octets = b"".join(
        xbee.encode(AtCommand(number, b"VR"), escaped=True) for number in range(1, 40)
    )
    garbage = resampled(octets, 9600, heard)
    for escaped in (False, True):
        decoder = xbee.Decoder(escaped=escaped)
        assert not decoder.receive(garbage)
    if heard > 9600:
        assert garbage  # edges are seen; a slow receiver may see one long break


def test_the_same_baud_rate_changes_nothing_and_a_near_one_neither() -> None:
    octets = bytes(range(256))
    assert resampled(octets, 9600, 9600) == octets
    assert resampled(octets, 9600, 9700) == octets  # 1 %: within what UARTs bear
