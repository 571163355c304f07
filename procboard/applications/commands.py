"""Commands from the radio: each is carried out once, and answered every time it comes.

A base station that hears no answer sends its command again, maybe after it was carried out. The
numbers of the last commands and what became of them are remembered, so a repetition is answered
and not obeyed.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Any, Final, TypeAlias

from procboard.applications.services import Services
from procboard.coroutines import Firmware
from procboard.network import Received, Sent
from radio_802154 import messages
from radio_802154.errors import RadioError
from radio_802154.messages import CommandReply, CommandStatus

REMEMBERED: Final = 16
"""Commands whose outcome is remembered, by source and number."""
DECODE_CYCLES: Final = 150
"""Reading the fields of a command: about 50 instructions (estimate)."""

Reply: TypeAlias = Callable[[CommandStatus], None]
CommandHandler: TypeAlias = Callable[[Any, Reply], Firmware[None]]
MessageHandler: TypeAlias = Callable[[int, Any], Firmware[None]]


def send_message(services: Services, destination: int, message: object) -> bool:
    """Queue a radio message; False where the queue is full."""
    am_type, payload = messages.encode(message)

    def done(sent: Sent) -> None:
        services.hooks.sent(destination, message, sent.status)

    return services.network.send(destination, am_type, payload, done)


def listen(services: Services, message_class: type, handler: MessageHandler, sender: str) -> None:
    """Hand radio messages of a class, decoded, to a sub-routine; damaged ones are dropped."""
    am_type = next(row.kind for row in messages.AM_MESSAGES if row.layout.message is message_class)

    def receive(packet: Received) -> Firmware[None]:
        yield DECODE_CYCLES
        try:
            message = messages.decode(am_type, packet.payload, sender)
        except RadioError:
            services.network.statistics.bad_frames += 1
            return
        services.hooks.received(packet.source, message)
        yield from handler(packet.source, message)

    services.network.on(am_type, receive)


class CommandDesk:
    """Takes commands of every kind that an application registers."""

    def __init__(self, services: Services) -> None:
        self._services = services
        self._outcomes: OrderedDict[tuple[int, int], CommandStatus | None] = OrderedDict()
        self.last_command_id = 0
        """Number of the last command that was carried out."""

    def on(self, message_class: type, handler: CommandHandler) -> None:
        """Carry out commands of a class by a sub-routine that gets the command and its reply."""

        def receive(source: int, command: Any) -> Firmware[None]:
            key = (source, command.command_id)
            if key in self._outcomes:
                outcome = self._outcomes[key]
                if outcome is not None:  # else the answer is on its way
                    self._answer(source, key[1], outcome)
                return
            self._outcomes[key] = None
            while len(self._outcomes) > REMEMBERED:
                self._outcomes.popitem(last=False)

            def reply(status: CommandStatus) -> None:
                self._outcomes[key] = status
                if status in (CommandStatus.ACCEPTED, CommandStatus.APPLIED):
                    self.last_command_id = command.command_id
                self._answer(source, command.command_id, status)

            yield from handler(command, reply)

        listen(self._services, message_class, receive, messages.BASE)

    def _answer(self, source: int, command_id: int, status: CommandStatus) -> None:
        reply = CommandReply(command_id, status)
        # A full queue loses the answer; the base station asks again.
        if send_message(self._services, source, reply):
            self._services.hooks.command(reply)
