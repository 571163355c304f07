"""The operator's end against the emulated module, on one emulated clock; the air between is real.

Two XBees: the operator's, and one that a fish of the test carries and answers commands with.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from firmware_model.scheduler import Scheduler
from firmware_model.signals import constant
from firmware_model.time import FS_PER_S, from_seconds
from radio_802154 import messages, xbee
from radio_802154.medium import Antenna, Medium, MediumConfig
from radio_802154.messages import CommandReply, CommandStatus, TailBeatCommand, Telemetry
from radio_802154.xbee import RxPacket16, RxPacket64, TxRequest16, TxResult
from radio_802154.xbee_module import XBeeModule, resampled
from tools.teleop.module import MOST_IN_FLIGHT, ModuleSession, Phase, SetUp
from tools.teleop.pilot import Course, Pilot, Plan
from tools.teleop.setpoint import NEUTRAL, Bounds, End, Helm, Hold, Setpoint
from tools.teleop.status import result_lines, status

PLAIN = {"AP": 2, "MM": 2, "CH": 26, "ID": 0x22, "MY": 0}
TELEMETRY = Telemetry(1.0, 3, 0.5, None, 0.1, 7.9, 20.5, None, 0, 0, 0, 0)


class World:
    """Operator, module, air and a fish that answers; stepped by a millisecond."""

    def __init__(
        self,
        registers: dict[str, int] | None = None,
        set_up: SetUp | None = None,
        *,
        address: int = 1,
        fish: dict[str, int] | None = None,
        baud: int | None = None,
        valid_s: float = 1.0,
        **medium: object,
    ) -> None:
        self.scheduler = Scheduler()
        self.medium = Medium(self.scheduler, MediumConfig(**medium))  # type: ignore[arg-type]
        for name, x_m in (("base", 0.0), ("fish", 2.0)):
            self.medium.place(name, Antenna(x_m=constant(x_m)))
        self.to_operator = bytearray()
        self.baud = baud
        written = {**PLAIN, **(registers or {})}
        self.module = XBeeModule(self.scheduler, self.medium, "base", written, self._said)
        fish_written = {**PLAIN, "MY": 1, "BD": 7, "SL": 0x4000_0001, **(fish or {})}
        self.fish = XBeeModule(
            self.scheduler, self.medium, "fish", fish_written, self._fish_hears, seed=9
        )
        self.commands: list[tuple[float, TailBeatCommand]] = []
        self.answers = True
        self._fish_decoder = xbee.Decoder(escaped=True)
        session = ModuleSession(set_up or SetUp(), 0.0)
        self.pilot = Pilot(
            Helm(Bounds(), 0.25), session, Plan(address, valid_for_s=valid_s), first_id=65_530
        )
        self.plugged = True

    @property
    def now_s(self) -> float:
        return self.scheduler.now / FS_PER_S

    def _said(self, octets: bytes) -> None:
        if self.baud is not None:
            octets = resampled(octets, self.module.baud, self.baud)
        self.to_operator += octets

    def _fish_hears(self, octets: bytes) -> None:
        for frame in self._fish_decoder.receive(octets):
            if isinstance(frame, RxPacket16 | RxPacket64):
                assert frame.data[0] == 0x3F
                command = messages.decode(frame.data[1], frame.data[2:], messages.BASE)
                assert isinstance(command, TailBeatCommand)
                self.commands.append((self.now_s, command))
                if self.answers:
                    self.fish_says(CommandReply(command.command_id, CommandStatus.APPLIED))

    def fish_says(self, message: object, source: int = 0) -> None:
        am_type, payload = messages.encode(message)
        request = TxRequest16(0, source, 0, bytes((0x3F, am_type)) + payload)
        self.fish.receive(xbee.encode(request, escaped=True))

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        end = self.scheduler.now + from_seconds(seconds)
        pilot = self.pilot
        while self.scheduler.now < end and not until():
            self.scheduler.run(self.scheduler.now + from_seconds(0.001))
            if self.plugged and self.to_operator:
                data = bytes(self.to_operator)
                self.to_operator.clear()
                pilot.hear(data, self.now_s)
            pilot.tick(self.now_s)
            octets = pilot.module.data_to_send()
            if octets and self.plugged:
                if self.baud is not None:
                    octets = resampled(octets, self.baud, self.module.baud)
                self.module.receive(octets)

    def told(self) -> list[str]:
        return [text for _, text in self.pilot.events]


@pytest.mark.parametrize("api", [1, 2])
def test_commands_go_out_at_their_rate_and_every_one_is_answered(api: int) -> None:
    world = World({"AP": api})
    world.run(3.0, lambda: world.pilot.course is Course.DRIVING)
    info = world.pilot.module.info
    assert info is not None
    assert (info.api_mode, info.channel, info.pan_id, info.mac_mode) == (api, 26, 0x22, 2)
    began_s = world.now_s
    world.pilot.helm.take(Hold(frequency_hz=1.0, bias_rad=-0.3))
    world.run(5.0)
    pilot, module = world.pilot, world.pilot.module
    assert 50 <= pilot.commands <= 52  # ten a second
    world.run(0.09, lambda: not module.in_flight)
    assert dict(module.results) == {"success": pilot.commands}
    assert module.replies["applied"] >= pilot.commands - 1
    assert (pilot.late, module.skipped, module.errors) == (0, 0, 0)
    assert pilot.quality == 1.0
    assert module.rssi_dbm is not None
    assert -60 < module.rssi_dbm < -30
    at_s, last = world.commands[-1]
    assert (last.frequency_hz, last.bias_rad) == pytest.approx((1.0, -0.3))
    assert last.amplitude_rad == pytest.approx(0.25)
    assert last.valid_for_s == 1.0
    # 23 octets of request at 9600 baud are 24 ms, the air 2 ms, the status 7.3 ms.
    assert 0.030 < module.status_s.quantile_s(0.5) < 0.045
    steps = [b - a for (a, _), (b, _) in zip(world.commands, world.commands[1:], strict=False)]
    assert max(steps) < 0.12
    assert at_s > began_s
    ids = [command.command_id for _, command in world.commands]
    assert ids[:8] == [65530, 65531, 65532, 65533, 65534, 65535, 0, 1]


def test_the_operators_end_stops_the_fish_and_waits_for_its_answer() -> None:
    world = World()
    world.run(3.0, lambda: world.pilot.course is Course.DRIVING)
    world.pilot.helm.take(Hold(frequency_hz=1.0, bias_rad=-0.3))
    world.run(1.0)
    world.pilot.helm.take(End("the joystick is gone"))
    world.run(4.0, lambda: world.pilot.course is Course.OVER)
    assert world.pilot.course is Course.OVER
    assert world.pilot.stop_confirmed
    assert world.pilot.module.in_flight == 0
    stops = [c for _, c in world.commands[-world.pilot.stops_sent :]]
    assert len(stops) >= 3
    for stop in stops:
        assert (stop.frequency_hz, stop.amplitude_rad, stop.bias_rad) == (0.0, 0.0, 0.0)
    assert "the joystick is gone" in world.told()
    assert world.pilot.told == NEUTRAL
    assert "confirmed that it stopped" in result_lines(world.pilot)[-1]


def test_a_fish_that_does_not_answer_is_told_for_three_seconds_and_it_is_said() -> None:
    world = World()
    world.run(3.0, lambda: world.pilot.course is Course.DRIVING)
    world.pilot.helm.take(Hold(frequency_hz=1.0))
    world.run(1.0)
    world.answers = False
    world.run(0.2)
    world.pilot.helm.take(End("q was pressed"))
    world.run(2.8)
    assert world.pilot.course is Course.STOPPING
    world.run(1.0, lambda: world.pilot.course is Course.OVER)
    assert not world.pilot.stop_confirmed
    assert world.pilot.stops_sent >= 25
    assert "runs out 1 s after it came" in result_lines(world.pilot)[-1]


def test_an_end_before_anything_was_sent_is_the_end() -> None:
    world = World()
    world.pilot.helm.take(End("Ctrl-D was pressed"))
    world.run(0.5, lambda: world.pilot.course is Course.OVER)
    assert world.pilot.course is Course.OVER
    assert not world.commands


def test_the_module_restarts_midway_and_is_set_up_again() -> None:
    """What teleop had set without writing it is gone, and set again."""
    world = World({"CH": 15, "MM": 0}, SetUp(channel=26))
    world.run(3.0, lambda: world.pilot.course is Course.DRIVING)
    assert world.told()[:2] == [
        "CH of the module is set from 0xf to 0x1a, until its supply goes",
        "MM of the module is set from 0x0 to 0x2, until its supply goes",
    ]
    world.pilot.helm.take(Hold(frequency_hz=1.0))
    world.run(2.0)
    before = len(world.commands)
    assert before > 15
    world.module.switch(False)
    world.run(0.5)
    assert len(world.commands) == before
    world.module.switch(True)
    world.run(3.0, lambda: len(world.commands) > before + 10)
    assert world.pilot.module.restarts == 1
    assert world.pilot.course is Course.DRIVING
    assert len(world.commands) > before + 10
    assert world.module.registers["CH"] == 26
    results = world.pilot.module.results
    assert results["unanswered"] <= MOST_IN_FLIGHT
    assert results["success"] >= len(world.commands) - MOST_IN_FLIGHT


def test_nothing_is_piled_up_while_the_module_says_nothing() -> None:
    world = World()
    world.run(3.0, lambda: world.pilot.course is Course.DRIVING)
    world.run(1.0)
    sent = world.pilot.commands
    world.plugged = False
    world.run(1.0)
    assert world.pilot.commands <= sent + MOST_IN_FLIGHT
    assert world.pilot.module.skipped >= 6
    world.run(4.0)
    assert world.pilot.module.results["unanswered"] >= MOST_IN_FLIGHT
    world.plugged = True
    world.pilot.reopened(world.now_s)
    world.run(3.0, lambda: world.pilot.course is Course.DRIVING)
    at = len(world.commands)
    world.run(1.0)
    assert len(world.commands) >= at + 9


def test_over_a_lossy_air_what_is_acknowledged_has_come() -> None:
    world = World(loss_probability=0.35)
    world.run(3.0, lambda: world.pilot.course is Course.DRIVING)
    world.run(20.0)
    world.pilot.helm.take(End("done"))
    world.run(4.0, lambda: world.pilot.course is Course.OVER)
    results = world.pilot.module.results
    heard = {command.command_id for _, command in world.commands}
    assert results["no_ack"] > 3
    assert results["success"] <= len(heard)
    assert sum(results.values()) == world.pilot.commands
    assert 0.5 < world.pilot.quality < 1.0 if world.pilot.quality is not None else False
    assert world.pilot.stop_confirmed


def test_a_fish_with_a_64_bit_address() -> None:
    world = World(address=0x0013_A200_4000_0001, fish={"MY": 0xFFFF})
    world.run(3.0, lambda: world.pilot.course is Course.DRIVING)
    world.run(1.0)
    assert len(world.commands) >= 9
    assert world.pilot.module.replies["applied"] >= 8


def test_a_fish_that_is_not_there_is_seen_in_the_status_line() -> None:
    world = World(address=9)
    world.run(3.0, lambda: world.pilot.course is Course.DRIVING)
    world.pilot.helm.take(Hold(frequency_hz=1.0, bias_rad=-0.3))
    world.run(5.0)
    assert world.pilot.module.results["no_ack"] > 20
    assert world.pilot.quality == 0.0
    line = status(world.pilot, world.now_s).plain
    assert line.startswith("driving 1.0 Hz  left 17.2°  ±14.3°")
    assert "acked 0 %" in line


def test_telemetry_is_shown_and_grows_old() -> None:
    world = World()
    world.run(3.0, lambda: world.pilot.course is Course.DRIVING)
    world.fish_says(TELEMETRY)
    world.run(0.5)
    line = status(world.pilot, world.now_s).plain
    assert "fish: 29° 7.90 V 20.5 °C" in line
    assert "−4" in line  # dBm: two metres
    world.run(4.0)
    assert "silent for 4 s" in status(world.pilot, world.now_s).plain
    world.fish_says(replace(TELEMETRY, flags=1))
    world.run(0.5)
    assert "at rest" in status(world.pilot, world.now_s).plain


def test_packets_that_are_none_of_ours_are_counted() -> None:
    world = World()
    world.run(3.0, lambda: world.pilot.course is Course.DRIVING)
    for data in (b"hello", b"\x3f\x99", b"\x3f\x21short", b""):
        world.fish.receive(xbee.encode(TxRequest16(0, 0, 0, data), escaped=True))
        world.run(0.2)
    assert world.pilot.module.foreign == 4
    assert world.pilot.course is Course.DRIVING


# --- modules that are not as they should be ----------------------------------------------------


def test_a_transparent_module_is_named_with_the_remedy() -> None:
    world = World({"AP": 0, "DL": 1})
    world.fish.on_serial = lambda octets: None
    world.run(12.0, lambda: bool(world.pilot.failure))
    assert "transparent mode (AP = 0)" in world.pilot.failure
    assert "--set-api" in world.pilot.failure
    world.run(0.5)
    assert world.module.registers["AP"] == 0


def test_a_transparent_module_is_switched_where_that_is_asked_for() -> None:
    world = World({"AP": 0, "DL": 7}, SetUp(switch_to_api=True))
    world.run(12.0, lambda: world.pilot.course is Course.DRIVING)
    world.run(1.0)
    assert world.module.registers["AP"] == 2
    assert world.pilot.module.info is not None
    assert world.pilot.module.info.api_mode == 2
    assert len(world.commands) >= 9


@pytest.mark.parametrize("baud", [19_200, 57_600, 115_200])
def test_a_wrong_baud_rate_is_named_with_the_remedy(baud: int) -> None:
    world = World(baud=baud)
    for tenth in range(100):
        if tenth % 5 == 0:
            world.fish_says(TELEMETRY)
        world.run(0.2, lambda: bool(world.pilot.failure))
    assert "baud rate" in world.pilot.failure
    assert "octets came" in world.pilot.failure
    assert world.pilot.commands == 0


def test_nothing_at_all_is_named_after_some_patience() -> None:
    world = World()
    world.plugged = False
    world.run(14.0)
    assert not world.pilot.failure
    world.run(8.0, lambda: bool(world.pilot.failure))
    assert "nothing came" in world.pilot.failure
    assert "baud=9600" in world.pilot.failure


def test_a_module_that_comes_late_is_found() -> None:
    world = World()
    world.plugged = False
    world.run(9.0)
    world.plugged = True
    world.run(5.0, lambda: world.pilot.course is Course.DRIVING)
    assert world.pilot.course is Course.DRIVING


def test_the_first_question_is_the_same_in_both_modes_and_has_its_vector() -> None:
    """08 52 'AP': 0xFF − (0x08 + 0x52 + 0x41 + 0x50 mod 256) = 0x14."""
    session = ModuleSession(SetUp(), 0.0)
    session.handle_timer(0.0)
    assert session.data_to_send() == bytes.fromhex("7e 00 04 08 52 41 50 14")
    assert session.phase is Phase.PROBING


def test_the_manuals_escaping_vector() -> None:
    """7E 00 02 23 11 CB, in API mode 2 on the line: 7E 00 02 23 7D 31 CB."""
    decoder = xbee.Decoder(escaped=True)
    assert decoder.receive(bytes.fromhex("7e 00 02 23 7d 31 cb")) == [
        xbee.OtherFrame(0x23, b"\x11")
    ]
    assert xbee.encode(xbee.OtherFrame(0x23, b"\x11"), escaped=True) == bytes.fromhex(
        "7e 00 02 23 7d 31 cb"
    )


def test_a_frame_id_is_never_zero_and_never_that_of_one_under_way() -> None:
    session = ModuleSession(SetUp(), 0.0)
    session.phase = Phase.READY
    seen = []
    for number in range(600):
        assert session.send(1, TailBeatCommand(number, 0, 0, 0, 1), number, 0.0)
        [request] = xbee.Decoder(escaped=False).receive(session.data_to_send())
        assert isinstance(request, TxRequest16)
        seen.append(request.frame_id)
        if number % 3:
            session._sent(request.frame_id, TxResult.SUCCESS, 0.0)
        elif len(session._flights) == MOST_IN_FLIGHT:
            session._sent(next(iter(session._flights)), TxResult.SUCCESS, 0.0)
    assert 0 not in seen
    assert set(seen) <= set(range(1, 256))


def test_setpoints_of_the_status_line() -> None:
    world = World()
    world.pilot.told = Setpoint(1.25, 0.2, 0.1)
    assert "right 5.7°" in status(world.pilot, 0.0).plain
    world.pilot.told = NEUTRAL
    assert "straight" in status(world.pilot, 0.0).plain
    assert "looking for the module" in status(world.pilot, 0.0).plain
