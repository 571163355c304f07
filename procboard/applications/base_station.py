"""The base station's application: a host's commands to the robots, the robots' telemetry to a host.

The host writes into a mailbox and hears by callbacks, in place of the mote's USB port. A command is
sent until the robot has answered it, not only until its radio has acknowledged it: between the two
lies the robot's firmware. Poses are sent once; the next one is better than an old one repeated.

A base with a network layer is the root of its tree: the host hears of each record once, when it is
on the mote's flash, and can read there what a reset kept it from hearing.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

from firmware_model.cpu import Flag
from procboard.applications.commands import listen, send_message
from procboard.applications.services import Services
from procboard.coroutines import Firmware
from procboard.network import Sent
from procboard.routing.collection import RecordDelivered
from procboard.routing.machine import BROADCAST
from procboard.routing.sharing import ItemReceived
from radio_802154 import messages
from radio_802154.messages import (
    BATCH,
    CommandReply,
    CommandStatus,
    Pose,
    PoseBatch,
    TailBeatCommand,
    TargetCommand,
    Telemetry,
)

REPEAT_US: Final = 400_000
"""Wait for an answer before a command is sent again: all MAC retries take 0.16 s at most."""
ATTEMPTS: Final = 12
MAILBOX_CYCLES: Final = 200
"""Taking a message from the host's buffer (estimate)."""

Command = TailBeatCommand | TargetCommand


@dataclass(slots=True)
class PendingCommand:
    """A command on its way, for the host to look at."""

    robot: int
    command: Command
    attempts: int = 0
    status: CommandStatus | None = None
    """The robot's answer; None while there is none."""
    abandoned: bool = False
    """Whether all attempts went unanswered."""
    due_us: int = 0

    @property
    def settled(self) -> bool:
        """Whether nothing more will happen."""
        return self.status is not None or self.abandoned


def _nothing(*_arguments: object) -> None:
    """Stand in where the host does not listen."""


class BaseStationApp:
    """Application of the base-station mote, and the host's side of it."""

    def __init__(self) -> None:
        self.on_telemetry: Callable[[int, Telemetry], None] = _nothing
        """Called with robot address and message."""
        self.on_reply: Callable[[PendingCommand], None] = _nothing
        """Called when a command is answered or abandoned."""
        self.on_record: Callable[[int, int, bytes], None] = _nothing
        """Called with origin, number and octets of a record that came through the network."""
        self.on_item: Callable[[int, int, bytes], None] = _nothing
        """Called with origin, number and octets of a shared item; all again after a reset."""
        self._mailbox: deque[tuple[int, Pose] | PendingCommand] = deque()
        self._batches: deque[PoseBatch] = deque()
        self._pending: list[PendingCommand] = []
        self._batch_in_queue = False
        self._wake = Flag("base station: mail")
        self._services: Services | None = None
        self._last_id = 0

    # --- the host's side ----------------------------------------------------------------

    def send_command(self, robot: int, command: Command) -> PendingCommand:
        """Send a command until it is answered; a `command_id` of 0 is replaced by a fresh one."""
        if command.command_id == 0:
            self._last_id = self._last_id % 0xFFFF + 1
            command = replace(command, command_id=self._last_id)
        messages.encode(command, messages.BASE)  # refuse here what no radio could carry
        pending = PendingCommand(robot, command)
        self._mailbox.append(pending)
        self._wake.set()
        return pending

    def send_pose(self, robot: int, pose: Pose) -> None:
        """Send where the camera saw a robot."""
        messages.encode(pose, messages.BASE)
        self._mailbox.append((robot, pose))
        self._wake.set()

    def send_poses(self, poses: Sequence[tuple[int, Pose]]) -> None:
        """Broadcast where the camera saw robots at one exposure, in as many frames as needed.

        What is still to go of the poses before is old, and left out.
        """
        batches = [PoseBatch.of(poses[at : at + BATCH]) for at in range(0, len(poses), BATCH)]
        for batch in batches:
            messages.encode(batch, messages.BASE)
        self._batches.clear()
        self._batches.extend(batches)
        self._wake.set()

    @property
    def pending(self) -> tuple[PendingCommand, ...]:
        """Commands without an answer."""
        waiting = tuple(item for item in self._mailbox if isinstance(item, PendingCommand))
        return (*waiting, *self._pending)

    # --- the mote's side ------------------------------------------------------------------

    def start(self, services: Services) -> None:
        """Begin. Commands that a former boot left unanswered are the host's, and are sent again."""
        self._services = services
        self._wake = Flag("base station: mail")
        self._batch_in_queue = False
        for pending in self._pending:
            pending.due_us = 0  # the clock begins anew
        listen(services, CommandReply, self._on_reply, messages.ROBOT)
        listen(services, Telemetry, self._on_telemetry, messages.ROBOT)
        if services.routing is not None:
            services.routing.on(RecordDelivered, self._on_record)
            services.routing.on(ItemReceived, self._on_item)
        services.cpu.spawn("base station", self._run(services))

    def _run(self, services: Services) -> Firmware[None]:
        alarms = services.alarms
        while True:
            mailbox = self._mailbox
            while mailbox:
                item = mailbox.popleft()
                yield MAILBOX_CYCLES
                if isinstance(item, PendingCommand):
                    item.due_us = 0
                    self._pending.append(item)
                else:
                    send_message(services, *item)
            if self._batches and not self._batch_in_queue:
                yield MAILBOX_CYCLES
                self._send_batch(services)
            if not self._pending:
                yield self._wake
                continue
            now_us = alarms.now_us()
            for pending in list(self._pending):
                if pending.due_us <= now_us:
                    yield MAILBOX_CYCLES
                    self._attempt(services, pending, now_us)
            if self._pending and not mailbox:
                due_us = min(pending.due_us for pending in self._pending)
                alarm = alarms.after_us(max(0, due_us - alarms.now_us()), self._wake)
                yield self._wake
                alarms.cancel(alarm)

    def _send_batch(self, services: Services) -> None:
        """Hand one to the radio; the next follows when it is out, so commands need not wait."""
        if not self._batches:
            return
        batch = self._batches.popleft()

        def done(sent: Sent) -> None:
            self._batch_in_queue = False
            services.hooks.sent(BROADCAST, batch, sent.status)
            self._wake.set()

        self._batch_in_queue = services.network.send(BROADCAST, *messages.encode(batch), done)

    def _attempt(self, services: Services, pending: PendingCommand, now_us: int) -> None:
        if pending.attempts >= ATTEMPTS:
            self._pending.remove(pending)
            pending.abandoned = True
            self.on_reply(pending)
            return
        pending.due_us = now_us + REPEAT_US
        if send_message(services, pending.robot, pending.command):
            pending.attempts += 1

    def _on_reply(self, source: int, reply: CommandReply) -> Firmware[None]:
        for pending in list(self._pending):
            if pending.robot == source and pending.command.command_id == reply.command_id:
                self._pending.remove(pending)
                pending.status = CommandStatus(reply.status)
                self.on_reply(pending)
        yield 50

    def _on_record(self, event: RecordDelivered) -> Firmware[None]:
        self.on_record(event.origin, event.number, event.record)
        yield MAILBOX_CYCLES

    def _on_item(self, event: ItemReceived) -> Firmware[None]:
        self.on_item(event.origin, event.number, event.item)
        yield MAILBOX_CYCLES

    def _on_telemetry(self, source: int, telemetry: Telemetry) -> Firmware[None]:
        self.on_telemetry(source, telemetry)
        yield 50
