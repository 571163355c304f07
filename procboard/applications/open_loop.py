"""Open-loop swimming: a configured tail beat, until the base station commands another."""

from __future__ import annotations

from procboard.applications.commands import CommandDesk, Reply
from procboard.applications.services import Services
from procboard.applications.swimming import Swimmer, TailBeatSetting
from procboard.applications.telemetry import TelemetryConfig, TelemetryTask
from procboard.coroutines import Firmware
from radio_802154.messages import CommandStatus, TailBeatCommand


class OpenLoop:
    """Swims `initial` from the start (None: waits), then whatever is commanded."""

    def __init__(
        self, initial: TailBeatSetting | None = None, telemetry: TelemetryConfig | None = None
    ) -> None:
        self.initial = initial
        self.telemetry = telemetry or TelemetryConfig()

    def start(self, services: Services) -> None:
        """Begin."""
        swimmer = Swimmer(services)
        desk = CommandDesk(services)
        TelemetryTask(services, self.telemetry, swimmer, desk)
        desk.on(TailBeatCommand, tail_beat_handler(swimmer))
        if self.initial is not None:
            services.cpu.spawn("open loop", _begin(swimmer, self.initial))


def _begin(swimmer: Swimmer, setting: TailBeatSetting) -> Firmware[None]:
    yield from swimmer.command(setting)


class _TailBeatHandler:
    """Carries out tail-beat commands: answered when the navigation board has applied them."""

    def __init__(self, swimmer: Swimmer) -> None:
        self._swimmer = swimmer

    def __call__(self, command: TailBeatCommand, reply: Reply) -> Firmware[None]:
        def answer(applied: bool) -> None:
            reply(CommandStatus.APPLIED if applied else CommandStatus.UNREACHABLE)

        setting = TailBeatSetting(command.bias_rad, command.amplitude_rad, command.frequency_hz)
        validity_s = command.valid_for_s or None  # 0: until told otherwise
        taken = yield from self._swimmer.command(setting, validity_s, answer)
        if not taken:
            reply(CommandStatus.REFUSED)


def tail_beat_handler(swimmer: Swimmer) -> _TailBeatHandler:
    """Return what carries out a `TailBeatCommand`."""
    return _TailBeatHandler(swimmer)
