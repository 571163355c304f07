"""Keeping the tail beating: a command that is wanted is refreshed before it runs out.

The navigation board stops the tail when no command is valid any more (its fail-safe). So a wanted
command is sent with a short validity and sent again at half of it, and a robot whose processing
board hangs, resets or loses its link comes to rest within that time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

from firmware_model.cpu import Flag
from procboard.applications.services import Services
from procboard.coroutines import Firmware
from spi_bus.errors import FieldError, LinkFull
from spi_bus.link import PeerReset
from spi_bus.messages import LINK_MESSAGES, CommandApplied, TailBeat

VALID_S: Final = 2.0
"""Validity of what is sent to the navigation board."""
REFRESH_S: Final = VALID_S / 2
ANSWER_S: Final = 1.0
"""How long the navigation board may take to report a command as applied."""

COMMAND_CYCLES: Final = 200
"""Encoding and queueing a command: about 65 instructions (estimate)."""


@dataclass(frozen=True, slots=True)
class TailBeatSetting:
    """What the tail is to do: α(t) = bias + amplitude · sin φ, φ̇ = 2π · frequency."""

    bias_rad: float
    amplitude_rad: float
    frequency_hz: float


Answer = Callable[[bool], None]
"""Hears whether a command was applied (True) or nothing was heard of it (False)."""


class Swimmer:
    """The one place that tells the navigation board what the tail does."""

    def __init__(self, services: Services) -> None:
        if services.link is None:
            raise ValueError("swimming needs a navigation board")
        self._services = services
        self._link = services.link
        self._alarms = services.alarms
        self._changed = Flag("swimmer: another command")
        self._wanted: TailBeat | None = None
        self._until_us: int | None = None
        # Numbers go on where another boot would not: an applied command tells its boot by them.
        self._next_id = services.boot * 251 & 0xFFFF
        self._answers: dict[int, tuple[int, Answer]] = {}
        self.applied: TailBeat | None = None
        """The last command that the navigation board reported as applied."""
        self._link.on(CommandApplied, self._on_applied)
        self._link.on(PeerReset, self._on_reset)
        services.cpu.spawn("swimmer", self._run())

    @property
    def wanted(self) -> TailBeat | None:
        """The command that is being kept up."""
        return self._wanted

    def command(
        self,
        setting: TailBeatSetting,
        valid_for_s: float | None = None,
        answer: Answer | None = None,
    ) -> Firmware[bool]:
        """Swim so from now on, for a time or until told otherwise; False where it is refused."""
        self._next_id = (self._next_id + 1) & 0xFFFF
        wanted = TailBeat(
            self._next_id,
            setting.bias_rad,
            setting.amplitude_rad,
            setting.frequency_hz,
            VALID_S if valid_for_s is None else min(VALID_S, valid_for_s),
        )
        yield COMMAND_CYCLES
        now_us = self._alarms.now_us()
        try:
            self._send(wanted)
        except FieldError:
            return False
        except LinkFull:
            pass  # the refreshment takes it along
        self._wanted = wanted
        self._until_us = None if valid_for_s is None else now_us + round(valid_for_s * 1e6)
        if answer is not None:
            self._answers[wanted.command_id] = (now_us + round(ANSWER_S * 1e6), answer)
        self._changed.set()
        return True

    def rest(self) -> None:
        """Let the present command run out; the fail-safe brings the tail to rest."""
        self._wanted = None
        self._changed.set()

    def _send(self, command: TailBeat) -> None:
        self._link.send(command)
        self._services.hooks.tail_beat(command)

    def _run(self) -> Firmware[None]:
        alarms = self._alarms
        while True:
            due_us = [deadline for deadline, _ in self._answers.values()]
            if self._wanted is not None:
                due_us.append(alarms.now_us() + round(REFRESH_S * 1e6))
            if not due_us:
                yield self._changed
                continue
            wanted = self._wanted
            alarm = alarms.after_us(max(0, min(due_us) - alarms.now_us()), self._changed)
            yield self._changed
            alarms.cancel(alarm)
            now_us = alarms.now_us()
            self._give_up_answers(now_us)
            if wanted is not None and wanted is self._wanted:
                yield COMMAND_CYCLES
                self._refresh(wanted, now_us)

    def _refresh(self, wanted: TailBeat, now_us: int) -> None:
        """Send a wanted command again, with what is left of its validity."""
        remaining_s = VALID_S
        if self._until_us is not None:
            remaining_s = min(VALID_S, (self._until_us - now_us) / 1e6)
            if remaining_s <= 0.01:  # the wire's resolution
                self._wanted = None
                return
        if self._link.link.queued < 4:  # an older one that still waits does as well
            self._send(replace(wanted, valid_for_s=remaining_s))

    def _give_up_answers(self, now_us: int) -> None:
        for command_id, (deadline_us, answer) in list(self._answers.items()):
            if now_us >= deadline_us:
                del self._answers[command_id]
                answer(False)

    def _on_applied(self, message: CommandApplied) -> Firmware[None]:
        self._services.hooks.sample(message, LINK_MESSAGES.encode(message))
        wanted = self._wanted
        if wanted is not None and wanted.command_id == message.command_id:
            self.applied = wanted
        waiting = self._answers.pop(message.command_id, None)
        if waiting is not None:
            waiting[1](True)
        yield 20

    def _on_reset(self, event: PeerReset) -> Firmware[None]:
        """The navigation board forgot what it was told: tell it again."""
        if self._wanted is not None and not event.unacknowledged:
            self._refresh(self._wanted, self._alarms.now_us())
        yield 20
